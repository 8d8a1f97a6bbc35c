"""Foreign nodes that send nonsense on the graph's topics."""

from __future__ import annotations

import random
import time
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from ballbot_ros.recording.messages.topics import (
    BLUETOOTH_TX,
    CLOCK,
    CMD_VEL,
    DIAGNOSTICS,
    JOY,
    LCD,
    LOCKSTEP_PUBLISHERS,
    OPERATING_STATE,
    PUSH,
    SOUND,
    VIEWER_JOY,
    Topic,
)
from campaign.fault import Verdict
from campaign.run import (
    Run,
    RunEnd,
    judge_completed,
    judge_end,
    judge_failed,
    judge_printed,
    judge_recording,
    ticks_of,
    undisturbed,
    undisturbed_duties,
)
from campaign.site import CampaignError, Site

STRANGER = 'stranger'
OPEN_TOPICS = (
    JOY, VIEWER_JOY, CMD_VEL, PUSH, DIAGNOSTICS, OPERATING_STATE, LCD, SOUND, BLUETOOTH_TX,
    Topic('somebody/s_camera', 'std_msgs/msg/UInt8MultiArray', None),
)  # fmt: skip
"""Topics open to all: nonsense on them must neither end nor change a run."""

LOOP_TOPICS = tuple(sorted(LOCKSTEP_PUBLISHERS))
"""Topics reserved for the participants."""

DURATION_S = 3.0
REFUSED = 2
"""Exit status of a run that does not begin."""
BOUND_S = 45.0
"""Time limit of a trial, in which even a publisher without a sample is detected [s]."""

PERIODS_S = (0.002, 0.02, 0.2)


class Content(Enum):
    """Kinds of messages."""

    NOTHING = 'an empty message'
    NAN = 'NaN'
    INFINITY = 'infinity'
    AT_LENGTH = 'NaN at length'
    HALF = 'half a message'
    NOISE = 'noise'


class Nonsense(NamedTuple):
    """A topic, a kind of message and a period.

    Attributes
    ----------
    topic : Topic
    content : Content
    period_s : float
    """

    topic: Topic
    content: Content
    period_s: float

    @classmethod
    def draw(cls, generator: random.Random, topic: Topic) -> Nonsense:
        """Draw the messages on a topic."""
        # Send no noise on cmd_vel: any 48 bytes are a valid velocity, which may drive the robot.
        contents = [each for each in Content if (topic, each) != (CMD_VEL, Content.NOISE)]
        content = generator.choice(contents)
        period_s = generator.choice(PERIODS_S)
        # Send long messages every 50 ms at most: more would fill the disk.
        return cls(topic, content, 0.05 if content is Content.AT_LENGTH else period_s)

    @property
    def words(self) -> tuple[object, ...]:
        """Arguments for ``campaign.sender``."""
        return self.topic.name, self.content.value, self.period_s

    def __str__(self) -> str:
        return f'{self.content.value} on {self.topic.name} every {1e3 * self.period_s:g} ms'


@dataclass(frozen=True)
class Stranger:
    """A foreign node that begins to send nonsense at some moment of a run.

    Attributes
    ----------
    sends : sequence of Nonsense
    delay_s : float
        Delay from the start of the command [s].
    in_the_loop : bool
        Whether it publishes on topics reserved for participants.
    """

    sends: Sequence[Nonsense]
    delay_s: float
    in_the_loop: bool

    def __str__(self) -> str:
        return f'after {self.delay_s:.3f} s: {", ".join(map(str, self.sends))}'

    @classmethod
    def draw(cls, generator: random.Random, index: int, *, in_the_loop: bool) -> Stranger:
        """Draw a stranger; its first topic alternates from trial to trial."""
        topics = LOOP_TOPICS if in_the_loop else OPEN_TOPICS
        chosen = [topics[index % len(topics)]]
        if not in_the_loop:
            chosen += generator.sample([topic for topic in topics if topic not in chosen], k=2)
        sends = [Nonsense.draw(generator, topic) for topic in chosen]
        return cls(sends, generator.uniform(0.0, 4.0), in_the_loop)

    def carry_out(self, site: Site) -> Verdict:
        """Send nonsense until the run ends, and judge the run."""
        run = Run(site, DURATION_S)
        time.sleep(self.delay_s)
        words = [word for each in self.sends for word in each.words]
        stranger = site.start(STRANGER, 'campaign.sender', *words)
        end = run.await_end(BOUND_S, beside=[stranger.pid])
        # The stranger must outlive the run, unless the run hung, and both were killed.
        if end.end.status is not None and stranger.status is not None:
            raise CampaignError(f'the stranger has ended: {stranger.text}')
        sha256 = undisturbed(site, ticks_of(DURATION_S)).duty_sha256
        failures = self.judge(end, undisturbed_duties(site, end.most_ticks), sha256)
        return Verdict(tuple(failures), end.end.took_s, BOUND_S)

    def judge(self, run: RunEnd, expected: list[tuple[float, float]], sha256: str) -> list[str]:
        """Return the broken guarantees.

        Parameters
        ----------
        run : RunEnd
        expected : list of tuple
            The duties of an undisturbed run.
        sha256 : str
            Hash of those duties.
        """
        failures = judge_printed(run.text) + judge_end(run.end, BOUND_S)
        if run.end.status is None:
            return failures
        if run.completed or not self.in_the_loop:
            return failures + judge_completed(run, sha256)
        if CLOCK in [each.topic for each in self.sends] and run.end.status == REFUSED:
            # A run is refused if the stranger publishes the clock before it: this looks like
            # another plant.
            return failures + judge_failed(run, [CLOCK.name], REFUSED)
        return (
            failures
            + judge_failed(run, [STRANGER])
            + judge_recording(run, expected, motors_off=True, beside_stranger=True)
        )
