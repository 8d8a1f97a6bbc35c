"""The plant: owns time, moves the robot, and waits for the duty of each tick."""

from __future__ import annotations

import math
import sys
import time
from array import array
from collections.abc import Mapping
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
from ballbot_ros.messages.plant_messages import PlantMessages
from ballbot_ros.messages.topics import (
    CLOCK,
    DIAGNOSTICS,
    MAX_LEAD_TICKS,
    MOTOR_DUTY,
    PLANT_IMU,
    PLANT_JOINT_STATES,
    PLANT_ODOM,
    PUSH,
    RECORDER_ACK,
    WALL_HIT,
)
from ballbot_ros.nodes.base import BallbotNode, run_node
from ballbot_ros.nodes.domain_lock import DomainLock
from ballbot_ros.nodes.participants import Participants
from ballbot_ros.nodes.plant_services import PlantServices
from ballbot_ros.parameters import PLANT, RECORDER, ParameterError
from ballbot_ros.plant.plant import Plant
from ballbot_ros.plant.truth import Push
from ballbot_ros.scenario.library import load_scenario
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.simulation.pacer import SLOWEST, Pacer
from ballbot_ros.simulation.timing import (
    FIRST_TICK_NS,
    FREE_RUNNING_SILENCE_S,
    TICK_NS,
    next_start_ns,
)
from ballbot_ros.simulation.trajectory import TrajectoryLog, save_trajectory
from ballbot_ros.world.world import World

RESEND_S = 0.1
WARN_S = 0.3
STARTUP_WARN_S = 5.0
SETTLE_S = 0.4
TICK_S = TICK_NS * 1e-9


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
        name = self.values['scenario']
        self._scenario = load_scenario(name) if name else Scenario()
        self._world = World.of(self.values)
        self._token = f'{time.time_ns():x}'
        self._run_number = 0
        self.summary: dict[str, Any] = {}
        self._messages = PlantMessages(self.output, self.values['ball_radius'])
        self._participants = Participants(self)
        self.control = PlantServices(self)
        self.pacer = Pacer()
        if 0.0 < self.values['real_time_factor'] < SLOWEST:
            raise ParameterError(f'{PLANT}.real_time_factor: not 0, and slower than {SLOWEST}')
        self._resent = self._free_overruns = 0
        self._ack_ns: int | None = None
        self._made_at = time.monotonic()
        self._reset_to(FIRST_TICK_NS)
        self.listen(MOTOR_DUTY, self._on_duty)
        self.listen(RECORDER_ACK, self._on_ack)
        self.listen(PUSH, self._on_push, depth=10)
        self.every(RESEND_S, self._watch)
        if not self._lockstep:
            factor = self.values['real_time_factor'] or 1.0
            self.every(TICK_S / factor, self._free_tick)

    def _reset_to(self, start_ns: int) -> None:
        """Put everything at the start of a run whose first tick is at `start_ns`."""
        self._start_ns = start_ns
        self._plant = Plant(self.values, start_ns, self._world)
        self._pushes = 0
        self.log = TrajectoryLog(keep=self.values['duration'] > 0.0)
        self._round_trips = array('d')
        self._duty: tuple[int, int] | None = None
        self._duty_at = 0.0
        self._free_duty = (0, 0)
        self._draining = False
        self._begun_at = self._ended_at = time.monotonic()
        self.pacer.restart()

    def _begin(self) -> None:
        """Announce a run and publish its first truth."""
        self._run_number += 1
        self._messages.begin(self._start_ns, f'{self._run_number} {self._token}', self._world)
        self.end_alarm()
        for push in self._scenario.pushes_from(self._start_ns):
            self._accept(push)
        self._publish_truth()

    def _accept(self, push: Push) -> None:
        """Let a push act, and tell what acts when, for the run to be repeated."""
        self._plant.push(push)
        self._pushes += 1
        self._messages.push(push, self._pushes)

    def reset(self) -> None:
        """Begin a new run at the next multiple of 100 ms."""
        self._reset_to(next_start_ns(self._plant.time_ns))
        self._begin()

    def _publish_truth(self) -> None:
        self._truth = self._plant.truth()
        if self._messages.truth(self._truth, wall_hit=self._plant.wall_hit):
            self._alarm_of_wall()
        self._asked_at = self._sent_at = time.monotonic()
        self.sampled(self._truth.stamp_ns)

    def _alarm_of_wall(self) -> None:
        """Begin or end the alarm of a hit; one that ends the run is told with its end."""
        if not self._plant.wall_hit:
            self.end_alarm()
        elif not self._plant.stopped:
            self.alarm(str(self._plant.newest_hit))

    def _on_duty(self, message: Any) -> None:
        duty = duty_values(message)
        if duty is None:
            self.get_logger().warning(f'{MOTOR_DUTY.name}: not whole numbers within -100 … 100 %')
            return
        if not self._lockstep:
            self._free_duty = duty
            self._duty_at = time.monotonic()
            return
        if self._duty is not None or stamp_ns(message) != self._plant.time_ns:
            return
        self._duty = duty
        self._duty_at = time.monotonic()
        if self.values['duration']:
            self._round_trips.append(self._duty_at - self._asked_at)
        self.advance()

    def _on_ack(self, header: Any) -> None:
        self._ack_ns = time_ns(header.stamp)
        if self._draining:
            self._finish_when_recorded()
        else:
            self.advance()

    def _on_push(self, message: Any) -> None:
        force, torque = push_forces(message)
        if not all(map(math.isfinite, (*force, *torque))):
            self.get_logger().warning(f'{PUSH.name}: a push that is not finite is ignored')
            return
        start = max(stamp_ns(message), self._plant.time_ns)
        end = start + round(self.values['push_duration'] * 1e9)
        self._accept(Push(start, end, force, torque))

    def advance(self) -> None:
        """Move on by a tick if its duty is here and nothing holds the plant back."""
        if self._duty is None or self._draining or self._recorder_lags():
            return
        if not self.control.may_advance():
            return
        if self.log.ticks == 0:
            self._begun_at = time.monotonic()
        self.pacer.wait(self.values['real_time_factor'])
        self._tick(self._duty)

    def _tick(self, duty: tuple[int, int]) -> None:
        self.log.add(self._truth, *duty)
        self._plant.tick(*duty)
        self._duty = None
        self.recover()
        self._participants.rest()
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
        now = self._plant.time_ns
        if self._ack_ns is None:
            return bool(self.values['require_recorder'])
        return now - self._ack_ns > MAX_LEAD_TICKS * TICK_NS

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
        if not self._lockstep:
            return
        if self.control.paused and self._duty is not None:
            return
        waits_for_recorder = self._draining or self._duty is not None
        silence = now - (self._duty_at if waits_for_recorder else self._sent_at)
        if waits_for_recorder and self._recorder_left():
            return
        limit = float(self.values['timeout' if self.log.ticks else 'startup_timeout'])
        if silence > (WARN_S if self.log.ticks else STARTUP_WARN_S):
            # Early, for those who live to have been heard when it is asked who is silent.
            self._participants.look()
            if silence <= limit:
                what = RECORDER if waits_for_recorder else 'the duty'
                self.warn(f'waiting for {what} at sim time {self._plant.time_ns * 1e-9:.3f} s')
        if not waits_for_recorder and now - self._asked_at > RESEND_S:
            sent_at = self._sent_at
            self._resent += 1
            self._publish_truth()
            self._sent_at = sent_at
        if WARN_S < silence <= limit:
            # Who waits is not to be taken for silent itself, on a busy machine neither.
            self.report()
        if silence > limit:
            self._silent(limit, recorder=waits_for_recorder)

    def _recorder_left(self) -> bool:
        """Go on without a recorder that has taken its leave; tell whether it has."""
        if self.values['require_recorder'] or self.count_publishers(RECORDER_ACK.name):
            return False
        self._ack_ns = None
        self.get_logger().warning('the recorder has left the run')
        if self._draining:
            self._finish_when_recorded()
        else:
            self.advance()
        return True

    def _silent(self, limit: float, *, recorder: bool) -> None:
        now = self._plant.time_ns
        who = self._participants.silent(now, recorder=recorder)
        problem = f'{who} silent for {limit:g} s at sim time {now * 1e-9:.3f} s'
        if self.values['on_timeout'] == 'wait':
            self.warn(problem + ': waiting for it')
            return
        self._plant.tick(0, 0)
        self._publish_truth()
        self._end('failed', problem, status=1)

    def _finish_when_recorded(self) -> None:
        last = self._truth.stamp_ns
        if not self._lockstep or self._ack_ns is None or self._ack_ns >= last:
            self._end('completed', '', status=0)

    def _end(self, outcome: str, reason: str, status: int) -> None:
        """End the run: report it and finish."""
        if self.summary:
            return
        if not self._draining:
            self._ended_at = time.monotonic()
        # A duty may still come; it is of no tick of this run.
        self._draining = True
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
        }
        self.finish()
        if reason:
            self.fail(reason)
        else:
            self.report()
        self.exit_status = status

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
        self._participants.rest()
        path = self.values['trajectory_file']
        if path:
            try:
                save_trajectory(Path(path), self.log.trajectory(), self.summary)
            except OSError as error:
                raise BallbotError(f'{path}: {error.strerror}') from None
        # The diagnostics hold the outcome, which the recorder notes.
        self.flush(CLOCK, PLANT_IMU, PLANT_JOINT_STATES, PLANT_ODOM, WALL_HIT, DIAGNOSTICS)
        self._lock.release()


def _in_words(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return the summary as the diagnostics have it."""
    words = {key: value for key, value in summary.items() if key != 'ticks'}
    if trips := words.pop('round_trip_ms', None):
        label = f'round trip {" / ".join(trips)} [ms]'
        words[label] = ' / '.join(f'{trip:.2f}' for trip in trips.values())
    return words


def main() -> None:
    """Run the node."""
    sys.exit(run_node(PlantSim))


if __name__ == '__main__':
    main()
