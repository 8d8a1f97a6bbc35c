"""The plant: owns time, moves the robot, and waits for the duty of each tick."""

from __future__ import annotations

import sys
import time
from array import array
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy

from ballbot_ros.errors import BallbotError
from ballbot_ros.messages.conversions import (
    duty_values,
    push_forces,
    stamp_ns,
    time_ns,
)
from ballbot_ros.messages.motor_stop import is_stop
from ballbot_ros.messages.plant_messages import PlantMessages
from ballbot_ros.messages.raw import decoder, same_content, stamp_of
from ballbot_ros.messages.topics import (
    CLOCK,
    DIAGNOSTICS,
    MAP,
    MAX_LEAD_TICKS,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    PUSH,
    RECORDER_ACK,
    RUN_STATUS,
    WALL_HIT,
)
from ballbot_ros.nodes.base import BallbotNode, run_node
from ballbot_ros.nodes.domain_lock import DomainLock
from ballbot_ros.nodes.one_shot import OneShot
from ballbot_ros.nodes.plant_participants import PlantParticipants
from ballbot_ros.nodes.plant_services import PlantServices
from ballbot_ros.parameters import PLANT, RECORDER
from ballbot_ros.plant.plant import Plant
from ballbot_ros.plant.truth import Push, Truth
from ballbot_ros.recording.attachments import OUTCOME_KEYS
from ballbot_ros.scenario.library import scenario_of
from ballbot_ros.simulation.pacer import Pacer
from ballbot_ros.simulation.participants import Objection, Participant, State
from ballbot_ros.simulation.sample_history import DEPTH, Sample, SampleHistory
from ballbot_ros.simulation.timing import (
    FIRST_TICK_NS,
    FREE_RUNNING_SILENCE_S,
    SLOW_NS,
    TICK_NS,
    next_start_ns,
)
from ballbot_ros.simulation.trajectory import TrajectoryLog, save_trajectory
from ballbot_ros.world.world import World

RESEND_S = 0.1
WARN_S = 0.3
STARTUP_WARN_S = 5.0
STILL_S = 1.0
"""While the plant stands still it tells so often where, for who comes late."""

SETTLE_S = 0.4
TICK_S = TICK_NS * 1e-9

MOST_PUSHES = 100
"""Pushes from outside that act or are to come: each costs time in every step."""


class PlantSim(BallbotNode):
    """Publishes the truth of a tick, waits for its duty, advances.

    Attributes
    ----------
    log : TrajectoryLog
        What the present run did so far.
    summary : dict
        Outcome and measurements of the run, once it has ended.
    """

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        # Before the node is one of the domain's participants.
        self._lock = DomainLock(rclpy.get_default_context().get_domain_id())
        super().__init__(PLANT, values)
        self._lockstep = self.values['lockstep']
        self._scenario = scenario_of(self.values['scenario'])
        self._world = World.of(self.values)
        self._token = f'{time.time_ns():x}'
        self._run_number = 0
        self.summary: dict[str, Any] = {}
        self._messages = PlantMessages(self.output)
        self._recent: deque[Truth] = deque(maxlen=MAX_LEAD_TICKS + 1)
        self._participants = PlantParticipants(self, self._on_news)
        self._duties = SampleHistory(same_content(MOTOR_DUTY.type_name))
        self._decode_duty = decoder(MOTOR_DUTY.type_name)
        self.control = PlantServices(self)
        self.pacer = Pacer()
        self._pace_timer = OneShot(self, self.advance)
        self._resent = self._free_overruns = 0
        self._made_at = time.monotonic()
        self._reset_to(FIRST_TICK_NS)
        # Deep enough to see each of several duties of one tick.
        depth = DEPTH if self._lockstep else 1
        self.listen(MOTOR_DUTY, self._on_duty, depth=depth, raw=True)
        self.listen(RECORDER_ACK, self._on_ack)
        self.listen(PUSH, self._on_push, depth=10)
        self.every(RESEND_S, self._watch)
        self._free_timer = None if self._lockstep else self.every(TICK_S, self._free_tick)
        self.on_live_values()

    def check(self, values: Mapping[str, Any]) -> None:
        """Find out whether there is such a scenario and a place to start from on such a map."""
        scenario_of(values['scenario'])
        World.of(values)

    def on_live_values(self) -> None:
        """Go on at another pace."""
        if self._free_timer is not None:
            factor = self.values['real_time_factor'] or 1.0
            self._free_timer.timer_period_ns = round(TICK_NS / factor)
        self.pacer.restart()
        if self._pace_timer.is_running:
            self._pace_timer.cancel()
            self.advance()

    def take_values(self) -> None:
        """Let everything act that was asked for: a run begins."""
        before = self.values
        super().take_values()
        if self.values != before:
            self._scenario = scenario_of(self.values['scenario'])
            self._world = World.of(self.values)

    def _reset_to(self, start_ns: int) -> None:
        """Put everything at the start of a run whose first tick is at `start_ns`."""
        self.take_values()
        self._messages.ball_radius = self.values['ball_radius']
        self._start_ns = start_ns
        self._plant = Plant(self.values, start_ns, self._world)
        self._pushes = 0
        self.log = TrajectoryLog(keep=self.values['duration'] > 0.0)
        self._round_trips = array('d')
        self._recent.clear()
        self._duties.clear()
        self._duty: tuple[int, int] | None = None
        self._is_open = self._is_held = False
        self._ack_ns: int | None = None
        self._recorder: Participant | None = None
        self._newest_recorder: Participant | None = None
        self._sync_ns = start_ns
        self._duty_at = 0.0
        self._free_duty = (0, 0)
        self._draining = False
        self._begun_at = self._ended_at = time.monotonic()
        self.pacer.restart()
        self._pace_timer.cancel()

    def _begin(self) -> None:
        """Announce a run; in lockstep it opens when every participant has joined it."""
        self._run_number += 1
        run = f'{self._run_number} {self._token}'
        self._sent_at = time.monotonic()
        self._waits_for: list[str] = []
        self._participants.gather(run, self._start_ns)
        if self._world is None:
            # That of an earlier run is none of this one.
            self.forget(MAP)
        self._messages.announce(self._start_ns, run)
        self.end_alarm()
        if not self._lockstep:
            self._open()

    def _open(self) -> None:
        """Begin the run with those who are there: publish its first truth."""
        self._is_open = True
        self._participants.fix()
        self._recorder = self._newest_recorder = self._participants.member(RECORDER)
        self.get_logger().info(f'run {self._run_number} begins at sim time {self._start_s:.3f} s')
        self._messages.begin(self._start_ns, self._world)
        for push in self._scenario.pushes_from(self._start_ns):
            self._accept(push)
        self._publish_truth()

    def _accept(self, push: Push) -> None:
        """Let a push act, and tell what acts when, for the run to be repeated."""
        self._plant.push(push)
        self._pushes += 1
        self._messages.push(push, self._pushes)
        self.get_logger().info(str(push))

    def reset(self) -> None:
        """Begin a new run at the next multiple of 100 ms."""
        self.get_logger().info(f'reset: run {self._run_number} ends {self._how_far()}')
        self._reset_to(next_start_ns(self._plant.time_ns))
        self._begin()

    def _publish_truth(self, *, again: bool = False) -> None:
        self._truth = self._asked_for = self._plant.truth()
        if not again:
            self._recent.append(self._truth)
        if self._messages.truth(self._truth, wall_hit=self._plant.wall_hit, again=again):
            self._alarm_of_wall()
        self._asked_at = self._sent_at = time.monotonic()
        self.sampled(self._truth.stamp_ns)

    def _alarm_of_wall(self) -> None:
        """Begin or end the alarm of a hit; one that ends the run is told with its end."""
        if not self._plant.wall_hit:
            self.end_alarm()
        elif not self._plant.stopped:
            self.alarm(str(self._plant.newest_hit))

    def _on_duty(self, data: bytes) -> None:
        stamp, now = stamp_of(data), self._plant.time_ns
        if not self._is_open or stamp < self._start_ns:
            return
        try:
            duty = duty_values(self._decode_duty(data))
        except ValueError:
            duty = None
        if duty is None:
            self.get_logger().warning(f'{MOTOR_DUTY.name}: not whole numbers within -100 … 100 %')
            return
        if not self._lockstep:
            self._free_duty = duty
            self._duty_at = time.monotonic()
            return
        if is_stop(data):
            # The controller leaves; another may come.
            return
        if stamp > now or self._duties.judge(stamp, data) is Sample.CONTRADICTING:
            self._participants.object(Objection.to_sample(MOTOR_DUTY.name, stamp, 'duty'))
            return
        if self._duty is not None or stamp != now:
            return
        self._duty = duty
        self._duty_at = time.monotonic()
        if self.values['duration']:
            self._round_trips.append(self._duty_at - self._asked_at)
        self.advance()

    def _on_ack(self, header: Any) -> None:
        ack = time_ns(header.stamp)
        if not self._is_open or ack < self._start_ns:
            return
        if ack > self._plant.time_ns:
            text = f'{RECORDER_ACK.name!r} is ahead of the run'
            self._participants.object(Objection(text, RECORDER_ACK.name, ack))
            return
        self._ack_ns = ack
        if self._draining:
            self._finish_when_recorded()
        else:
            self.advance()
        if self._is_behind() and self._asked_for.stamp_ns <= ack and not self.finished:
            self._ask_again()

    def _on_push(self, message: Any) -> None:
        if not self._is_open:
            return
        force, torque = push_forces(message)
        now = self._plant.time_ns
        start = max(stamp_ns(message), now)
        push = Push(start, start + round(self.values['push_duration'] * 1e9), force, torque)
        problem = push.problem(now)
        if not problem and self._plant.pushes >= MOST_PUSHES:
            problem = f'there are {MOST_PUSHES} already'
        if problem:
            self.get_logger().warning(
                f'{PUSH.name}: a push is ignored: {problem}', throttle_duration_sec=1.0
            )
        else:
            self._accept(push)

    def advance(self) -> None:
        """Move on by a tick if its duty is here and nothing holds the plant back."""
        if self._duty is None or self._draining or self._is_held or self._recorder_lags():
            return
        if self._pace_timer.is_running:
            return
        factor = self.values['real_time_factor']
        if not self.control.paused and (delay_s := self.pacer.delay_s(factor)):
            self._pace_timer.start(delay_s)
            return
        if not self.control.may_advance():
            return
        if self.log.ticks == 0:
            self._begun_at = time.monotonic()
        self.pacer.ticked(factor)
        self._tick(self._duty)

    def _tick(self, duty: tuple[int, int]) -> None:
        self.log.add(self._truth, *duty)
        self._plant.tick(*duty)
        self._duty = None
        self.recover()
        self._participants.end_silence()
        if self._plant.stopped:
            self._publish_truth()
            self._end('failed', str(self._plant.newest_hit), status=1)
        elif self._plant.time_ns - self._start_ns >= self._duration_ns():
            self._draining = True
            self._duty_at = self._ended_at = time.monotonic()
            self._finish_when_recorded()
        else:
            self._publish_truth()

    def _duration_ns(self) -> float:
        duration = self.values['duration']
        return round(duration * 1e9) if duration else float('inf')

    def _recorder_lags(self) -> bool:
        """Tell whether the recorder has to catch up first.

        A stream keeps nothing for who comes late. Hence the recorder has to have all of a tick
        from which on nothing may be missed: the first one, that is, and each that was asked for
        again.
        """
        now = self._plant.time_ns
        if self._recorder is None:
            return False
        if self._ack_ns is None or self._ack_ns < self._sync_ns:
            return now >= self._sync_ns
        return now - self._ack_ns > MAX_LEAD_TICKS * TICK_NS

    def _meet_recorder(self) -> None:
        """Let a recorder that has come begin at a tick of which every driver sends something."""
        recorder = self._participants.member(RECORDER)
        if recorder != self._newest_recorder and not self._draining:
            self._recorder = self._newest_recorder = recorder
            self._ack_ns, self._duty_at = None, time.monotonic()
            self._sync_ns = -(-self._plant.time_ns // SLOW_NS) * SLOW_NS
            self.advance()

    def _watch(self) -> None:
        """Ask again after a silence; in the end find out who is silent."""
        now = time.monotonic()
        if self.finished:
            return
        if self.log.ticks == 0 and self.count_publishers(CLOCK.name) > 1:
            self._end('failed', 'another plant publishes /clock in this ROS domain', status=2)
            return
        if self._run_number == 0:
            # Time to discover another plant, whose run a second clock would disturb.
            if now - self._made_at > SETTLE_S:
                self._begin()
            return
        if not self._may_go_on(calling=True) or self.finished:
            return
        has_duty = self._duty is not None or not self._lockstep
        if has_duty and (self.control.paused or self._pace_timer.is_running):
            self._stand_still(now)
            return
        if not self._lockstep:
            return
        waits_for_recorder = self._draining or self._duty is not None or self._is_behind()
        since = self._duty_at if waits_for_recorder else self._sent_at
        silence = now - since
        if waits_for_recorder and self._recorder_left():
            return
        limit = float(self.values['timeout' if self.log.ticks else 'startup_timeout'])
        silent: list[str] = []
        if silence > min(WARN_S if self.log.ticks else STARTUP_WARN_S, limit):
            found = self._participants.silences_s(
                since, self._asked_for.stamp_ns, recorder=waits_for_recorder
            )
            silent = [role for role in found if found[role] > limit]
            # Early, for those who live to have answered when it is asked who is silent.
            self._participants.call_roll()
            if waits_for_recorder:
                # Of what it has not heard it acknowledges nothing.
                self._participants.tell({})
            if not silent:
                what = RECORDER if waits_for_recorder else 'the duty'
                self.warn(f'waiting for {what} at sim time {self._plant.time_ns * 1e-9:.3f} s')
        if now - self._asked_at > RESEND_S:
            if has_duty:
                self._participants.call_roll()
            self._ask_again()
        if silence > WARN_S and not silent:
            # Who waits is not to be taken for silent itself, on a busy machine neither.
            self.report()
        if silent:
            self._give_up(silent, limit)

    def _stand_still(self, now: float) -> None:
        """Tell who comes late where the robot stands; let a recorder go that leaves."""
        if now - self._asked_at > STILL_S:
            self._publish_truth(again=True)
        if self._lockstep and self._recorder_lags():
            self._recorder_left()

    def go_on(self) -> None:
        """Go on after a pause, in which nobody was silent."""
        self._duty_at = self._sent_at = time.monotonic()
        self._participants.end_silence()
        self.pacer.restart()
        self.advance()

    def _ask_again(self) -> None:
        """Ask again for the first tick of which something is missing; the silence goes on.

        The controller may have all that a driver has sent before it was killed, and the recorder
        not: what a reader has not taken yet of a dead process the middleware throws away.
        """
        sent_at = self._sent_at
        self._resent += 1
        if self._ack_ns is not None:
            # Who answers only now may not have been found by the recorder yet.
            self._sync_ns = self._plant.time_ns
        missing = self._first_missing()
        if missing.stamp_ns < self._plant.time_ns:
            self._messages.ask(missing)
            self._asked_for, self._asked_at = missing, time.monotonic()
        else:
            self._publish_truth(again=True)
        self._sent_at = sent_at

    def _first_missing(self) -> Truth:
        """Return the first tick that the recorder lacks, or the newest.

        Ticks of a controller that is gone are not among them: no other can answer for it.
        """
        if self._recorder is None or self._ack_ns is None:
            return self._truth
        first_ns = max(self._ack_ns + TICK_NS, self._participants.controller_since_ns())
        return next((truth for truth in self._recent if truth.stamp_ns >= first_ns), self._truth)

    def _is_behind(self) -> bool:
        """Tell whether an earlier tick than the newest is asked for."""
        return self._recorder is not None and self._asked_for.stamp_ns < self._truth.stamp_ns

    def _on_news(self) -> None:
        """Look at once where the run waits for this very news."""
        if self._run_number and not self._is_open:
            self._may_go_on()

    def _may_go_on(self, *, calling: bool = False) -> bool:
        """Tell whether the run has its participants and nobody else; hold or end it if not.

        With `calling` the roll is called while that is not clear.
        """
        if self.finished:
            return False
        now = time.monotonic()
        standing = self._participants.standing(self._plant.time_ns)
        if standing.state is State.REFUSED:
            self._end('failed', standing.reason, status=1)
        elif standing.state is State.WAITING:
            self._is_held = self._is_open and (self._lockstep or self._draining)
            if calling:
                self._wait(now, standing.reason)
        elif not self._is_open:
            self._open()
        else:
            self._meet_recorder()
            self._release()
        return standing.state is State.COMPLETE

    def _release(self) -> None:
        """Go on with a run that was held, if it was."""
        if self._is_held:
            self._is_held = False
            self._sent_at = self._duty_at = time.monotonic()
            self.recover()
            self._participants.end_silence()
            if self._draining:
                self._finish_when_recorded()
            elif self._duty is None:
                self._ask_again()
            else:
                self.advance()

    def _wait(self, now: float, reason: str) -> None:
        """Call the roll until it is clear who takes part, within bounds before the first tick."""
        self._participants.call_roll()
        counted = self._participants.waited_s(self._sent_at)
        limit = float(self.values['startup_timeout'])
        missing = self._participants.missing()
        if missing and missing != self._waits_for:
            self._waits_for = missing
            self.get_logger().info(f'run {self._run_number} waits for {", ".join(missing)}')
        # Who waits is not to be taken for silent itself, on a busy machine neither.
        self.report()
        if self._is_held:
            self.warn(reason)
        elif self._is_open:
            return
        elif counted > limit and missing and self.values['on_timeout'] != 'wait':
            who = ', '.join(missing)
            self._end('failed', f'{who} silent for {limit:g} s before the first tick', status=1)
        elif now - self._sent_at > STARTUP_WARN_S:
            self.warn(reason)

    def _recorder_left(self) -> bool:
        """Go on without a recorder that has taken its leave; tell whether it has."""
        if self.values['require_recorder'] or self.count_publishers(RECORDER_ACK.name):
            return False
        self._recorder = self._ack_ns = None
        reason = self._participants.last_words(RECORDER)
        self.get_logger().warning(f'the recorder has left the run{reason and ": "}{reason}')
        if self._draining:
            self._finish_when_recorded()
        else:
            self.advance()
        return True

    def _give_up(self, silent: Sequence[str], limit: float) -> None:
        now_s = self._plant.time_ns * 1e-9
        problem = f'{", ".join(silent)} silent for {limit:g} s at sim time {now_s:.3f} s'
        if self.values['on_timeout'] == 'wait':
            self.warn(problem + ': waiting for it')
            return
        self._end('failed', problem, status=1)

    def _finish_when_recorded(self) -> None:
        last = self._truth.stamp_ns
        is_recorded = (
            not self._lockstep
            or self._recorder is None
            or (self._ack_ns is None and self._sync_ns > last)
            or (self._ack_ns is not None and self._ack_ns >= last)
        )
        # With a last look at who has taken part.
        if is_recorded and self._may_go_on():
            problem = self._participants.restarted_controller()
            if problem:
                self._end('failed', problem, status=1)
            else:
                self._end('completed', '', status=0)

    def _end(self, outcome: str, reason: str, status: int) -> None:
        """End the run: report it and finish."""
        if self.summary:
            return
        if not self._draining:
            self._ended_at = time.monotonic()
        # A duty may still come; it is of no tick of this run.
        self._draining = True
        if outcome != 'completed' and self._is_open:
            self._messages.stop_motors(self._truth.stamp_ns)
        wall = self._ended_at - self._begun_at
        trips = np.array(self._round_trips[1:]) * 1e3 if len(self._round_trips) > 1 else None
        self.summary = {
            'outcome': outcome,
            'reason': reason,
            'ticks': self.log.ticks,
            'duty_sha256': self.log.duty_sha256,
            'real_time_factor': self.log.ticks * TICK_S / wall if wall else 0.0,
            'missed_ticks': self._overruns(),
            'asked_again': self._resent,
            'round_trip_ms': None
            if trips is None
            else {
                'p50': float(np.percentile(trips, 50)),
                'p99': float(np.percentile(trips, 99)),
                'max': float(trips.max()),
            },
            'participants': self._participants.as_json(),
        }
        self._participants.tell({key: self.summary[key] for key in OUTCOME_KEYS})
        if self._run_number:
            self.get_logger().info(f'run {self._run_number} {outcome} {self._how_far()}')
        self.finish()
        if reason:
            self.fail(reason)
        else:
            self.report()
        self.exit_status = status

    @property
    def _start_s(self) -> float:
        return self._start_ns * 1e-9

    def _how_far(self) -> str:
        if self.log.ticks == 0:
            return 'before its first tick'
        return f'after {self.log.ticks} ticks, duties {self.log.duty_sha256[:12]}'

    def stop(self) -> None:
        """End a run that was told to stop."""
        self._end('stopped', '', status=0)

    def _free_tick(self) -> None:
        """Advance on the wall clock with the newest duty, or none after a silence."""
        now = time.monotonic()
        if self._draining or self.control.paused or self._run_number == 0:
            return
        factor = self.values['real_time_factor'] or 1.0
        if self.log.ticks == 0:
            # Plant and controller begin together, or the calibration is cut short.
            if not self._duty_at and now - self._made_at < self.values['startup_timeout']:
                if now - self._sent_at > RESEND_S:
                    self._publish_truth()
                return
            self._begun_at = now
        elif now - self._sent_at > 2.0 * TICK_S / factor:
            self._free_overruns += 1
        silent = now - self._duty_at > FREE_RUNNING_SILENCE_S
        self._tick((0, 0) if silent else self._free_duty)

    def _overruns(self) -> int:
        return self.pacer.late + self._free_overruns

    def diagnose(self) -> Mapping[str, Any]:
        """Return the state of the run."""
        return {
            'run': self._run_number,
            'sim time [s]': f'{self._plant.time_ns * 1e-9:.3f}',
            'ticks': self.log.ticks,
            'overruns': self._overruns(),
            'asked again': self._resent,
            'fallen': self._plant.fallen,
            'paused': self.control.paused,
            **_in_words(self.summary),
        }

    def close(self) -> None:
        """Save the trajectory, and let the last messages reach their readers."""
        self.stop()
        path = self.values['trajectory_file']
        if path:
            try:
                save_trajectory(Path(path), self.log.trajectory(), self.summary)
            except OSError as error:
                raise BallbotError(f'{path}: {error.strerror}') from None
        # The status of the run holds the outcome, which the recorder notes.
        self.flush(
            CLOCK, PLANT_IMU, PLANT_JOINT_STATES, PLANT_ODOM, WALL_HIT, MOTOR_DUTY, RUN_STATUS,
            DIAGNOSTICS,
        )  # fmt: skip
        self._lock.release()


def _in_words(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return the summary as the diagnostics have it."""
    words = {key: summary[key] for key in summary if key not in ('ticks', 'participants')}
    if trips := words.pop('round_trip_ms', None):
        label = f'round trip {" / ".join(trips)} [ms]'
        words[label] = ' / '.join(f'{trip:.2f}' for trip in trips.values())
    return words


def main() -> None:
    """Run the node."""
    sys.exit(run_node(PlantSim))
