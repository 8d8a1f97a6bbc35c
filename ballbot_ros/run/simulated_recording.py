"""The recording of a run without a graph."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

from ballbot_ros.controllers.interface import Program
from ballbot_ros.messages.outputs import Send
from ballbot_ros.messages.run_messages import RunMessages
from ballbot_ros.messages.topics import Topic
from ballbot_ros.parameters import ParameterSet, PlantParameters
from ballbot_ros.plant.ground_truth import Push
from ballbot_ros.recording.attachments import OUTCOME_KEYS, media_type
from ballbot_ros.recording.rosbag2 import RecordedTopic
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.simulation.closed_loop import Tick
from ballbot_ros.simulation.run_actions import RunSummary
from ballbot_ros.timing import SECOND_NS
from ballbot_ros.viewer.derived_channels import DerivedChannels
from ballbot_ros.viewer.derived_messages import DerivedMessages
from ballbot_ros.world.world import World


class SimulatedRecording:
    """Writes the messages that the nodes would have published, and those derived from them."""

    def __init__(
        self, path: Path, attachments: Mapping[str, bytes], parameters: ParameterSet
    ) -> None:
        self._writer = RecordingWriter(path)
        for name, data in attachments.items():
            self._writer.add_attachment(name, media_type(name), data)
        self._derived = DerivedChannels(self._writer, parameters.of(PlantParameters))
        # Cached, because plant and controller share the topic of the duties.
        self._messages = RunMessages(cache(self._make_send), parameters)
        self.plant = self._messages.plant
        self._flushed_ns = 0

    def _make_send(self, topic: Topic) -> Send:
        recorded: RecordedTopic | None = None

        def send(stamp_ns: int, data: bytes) -> None:
            nonlocal recorded
            if recorded is None:
                recorded = self._writer.add_topic(topic.resolved(), topic.type_name)
            self._writer.write(recorded, stamp_ns, data, recorded.count + 1)

        def send_source(stamp_ns: int, data: bytes) -> None:
            send(stamp_ns, data)
            self._derived.add(topic, stamp_ns, data)

        return send_source if topic in DerivedMessages.INPUTS else send

    def begin(self, start_ns: int, world: World | None, pushes: Iterable[Push]) -> None:
        """Write the messages at the start of a run."""
        self._messages.begin(start_ns, world, pushes)
        self._flushed_ns = start_ns

    def add(self, tick: Tick, program: Program) -> None:
        """Write the messages of a tick."""
        self._messages.tick(tick, program)
        now = tick.truth.stamp_ns
        if now - self._flushed_ns >= SECOND_NS:
            self._writer.flush()
            self._flushed_ns = now

    def close(self, summary: RunSummary) -> None:
        """Write how the run ended, and finish the file."""
        self._writer.add_outcome({key: str(getattr(summary, key)) for key in OUTCOME_KEYS})
        self._writer.close()
