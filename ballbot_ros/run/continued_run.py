"""A recorded run that goes on in this process, while somebody changes it."""

from __future__ import annotations

import threading
import time
from bisect import bisect_right
from collections.abc import Mapping
from contextlib import suppress
from copy import copy
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.controllers.codegen.implementation import implementation_for
from ballbot_ros.controllers.interface import Program
from ballbot_ros.engine.closed_loop import ClosedLoop, ExternalInputs, Tick
from ballbot_ros.engine.scenario.scenario import ScheduledPush
from ballbot_ros.engine.tuned_program import TunedProgram
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import (
    CONTROLLER,
    PLANT,
    ControllerParameters,
    ParameterSet,
    Value,
    value_text,
)
from ballbot_ros.parameters.changes import PendingChanges
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SECOND_NS, SLOW_PERIOD_NS, TICK_NS, TICK_S
from ballbot_ros.robot.brick.bluetooth import Sticks
from ballbot_ros.robot.brick.faults import Fault, faults_of, parse_faults
from ballbot_ros.robot.plant.ground_truth import Pair, Push
from ballbot_ros.run.branch import Past, branch_spec, prove
from ballbot_ros.run.execution import execute
from ballbot_ros.run.future import Future
from ballbot_ros.run.observer import RunObserver
from ballbot_ros.run.spec import RunSpec
from ballbot_ros.run.tick_timer import TickTimer

_REST_S, _TICKS_WITHOUT_REST = 1e-3, 25
"""States are made beside a page, which needs the interpreter, too."""

_MAX_STATES = 300
_LONGEST_WAIT_S = 5.0
"""For a state; a tick that does not return ends only in the main thread."""


class LiveInputs:
    """What somebody does to a robot, by the stamp of the tick at which it acts [ns].

    `sticks` are those that were held, and `received` those that the brick had received, maybe after
    a fault.
    """

    def __init__(self) -> None:
        self.sticks: dict[int, Sticks] = {}
        self.received: dict[int, Sticks] = {}
        self.pushes: list[Push] = []
        self.retunings: dict[int, dict[str, Value]] = {}
        self.faults: tuple[Fault, ...] = ()

    def forget(self, from_ns: int) -> None:
        """Forget what was done from a tick on."""
        for each in (self.sticks, self.received, self.retunings):
            for stamp_ns in [stamp_ns for stamp_ns in each if stamp_ns >= from_ns]:
                del each[stamp_ns]
        self.pushes = [each for each in self.pushes if each.start_ns < from_ns]
        self.faults = tuple(each for each in self.faults if _stamp(each.time) < from_ns)


class _DrivenInputs(NamedTuple):
    """The events of a recorded run, and the sticks that somebody holds instead."""

    recorded: ExternalInputs
    live: LiveInputs

    def sticks_at(self, time: float) -> Sticks:
        held = self.live.sticks.get(FIRST_TICK_NS + round(time * SECOND_NS))
        return held or self.recorded.sticks_at(time)

    def pushes_from(self, start_ns: int) -> list[Push]:
        return list(self.recorded.pushes_from(start_ns))


class _Robot:
    """The robot of a run, and what changes the parameters of its program."""

    def __init__(self, spec: RunSpec, tuned: TunedProgram, inputs: ExternalInputs) -> None:
        self.tuned = tuned
        self.loop = ClosedLoop(spec.parameters, inputs, program=tuned.program)

    @property
    def now_ns(self) -> int:
        return self.loop.plant.time_ns

    def copy(self, inputs: ExternalInputs) -> _Robot:
        twin = copy(self)
        twin.tuned = self.tuned.copy()
        twin.loop = self.loop.copy(twin.tuned.program, inputs)
        return twin

    def tick(self) -> Tick:
        self.tuned.advance(self.now_ns)
        return self.loop.tick()


class ContinuedRun:
    """A recorded run from any of its moments on, changed by pushes, sticks, parameters and faults.

    What was recorded later happens again, unless somebody takes the sticks. A thread makes states
    of the run, a second apart, or further in a long one, so that a moment is near. A program that
    can't be copied runs again from the start instead, and so does a robot that gets a fault, which
    may depend on what was before.

    The file of the run must stay open. `implementation` is its controller, with the parameters that
    it began with. It raises BallbotError if this controller can't run here.
    """

    def __init__(self, past: Past, scratch: Path) -> None:
        self._past, self._scratch = past, scratch
        self._live = LiveInputs()
        spec = branch_spec(past, Future(at=past.end), scratch)
        settings = spec.parameters.of(ControllerParameters)
        self.implementation = implementation_for(settings, spec.controller)
        self._push_ns = round(spec.plant.push_duration * SECOND_NS)
        self._duration = spec.plant.duration
        self._timer = TickTimer(spec.controller, spec.plant)
        self._period_ns = (1 + int(past.end / _MAX_STATES)) * SECOND_NS
        self._states: list[_Robot] = []
        self._later_states: list[_Robot] = []
        self._begun_ns = FIRST_TICK_NS
        self._spec = spec
        self._robot = self._new_robot(self._inputs)
        self._is_closed = self._is_awaited = False
        self._maker = threading.Thread(target=self._make_states, daemon=True)
        self._maker.start()

    def close(self) -> None:
        """Make no further states."""
        self._is_closed = True

    @property
    def _inputs(self) -> _DrivenInputs:
        return _DrivenInputs(self._spec.scenario, self._live)

    def _new_robot(self, inputs: ExternalInputs) -> _Robot:
        changes = PendingChanges.of(self._spec.parameters.of(ControllerParameters), FIRST_TICK_NS)
        tuned = TunedProgram(self.implementation, changes)
        return _Robot(self._spec, tuned, inputs)

    def _make_states(self) -> None:
        with suppress(BallbotError, TypeError):  # an error comes again when somebody gets there
            inputs = _DrivenInputs(self._spec.scenario, LiveInputs())
            robot = self._new_robot(inputs)
            while robot.now_ns <= self._past.inputs.last_ns and not self._is_closed:
                if robot.now_ns % self._period_ns == 0 or not self._states:
                    self._states.append(robot.copy(inputs))
                if robot.now_ns // TICK_NS % _TICKS_WITHOUT_REST == 0 and not self._is_awaited:
                    time.sleep(_REST_S)
                robot.tick()

    @property
    def begun(self) -> float:
        """When it began to be changed, from the start of the run [s]."""
        return _time(self._begun_ns)

    @property
    def time(self) -> float:
        """The present time, from the start of the run [s]."""
        return _time(self._robot.now_ns)

    @property
    def program(self) -> Program:
        """The control program."""
        return self._robot.tuned.program

    @property
    def pushes(self) -> list[Push]:
        """All pushes, recorded and new ones."""
        return [*self._robot.loop.pushes, *self._live.pushes]

    @property
    def wall_hit(self) -> str:
        """Description of the wall hit that has ended the run; '' if there is none."""
        plant = self._robot.loop.plant
        return str(plant.newest_hit) if plant.stopped else ''

    @property
    def parameters(self) -> ControllerParameters:
        """The present parameters of the controller."""
        return self._robot.tuned.parameters

    def go_to(self, time: float) -> None:
        """Go to a moment [s]: back in what has been done, or to any other of the recorded run.

        What has been done since is forgotten.
        """
        to_ns = _stamp(min(max(time, 0.0), max(self._past.end, self.time)))
        faults = self._live.faults
        if self._begun_ns < to_ns <= self._robot.now_ns:
            self._live.forget(to_ns)
        else:
            self._live.forget(0)
            self._begun_ns, self._later_states = to_ns, []
        self._later_states = [each for each in self._later_states if each.now_ns <= to_ns]
        if self._live.faults != faults:
            self._set_faults(self._live.faults)
        self._robot = self._robot_at(to_ns)

    def _robot_at(self, to_ns: int) -> _Robot:
        """Return the robot at a tick, after all that has been done."""
        robot = self._nearest(to_ns)
        with self._timer:
            while robot.now_ns < to_ns and not robot.loop.plant.stopped:
                self._tick(robot)
        return robot

    def _nearest(self, to_ns: int) -> _Robot:
        states = self._later_states
        if not self._live.faults and not states:
            limit_ns = min(to_ns, self._begun_ns)
            self._await_states(limit_ns)
            states = self._states[: bisect_right(self._states, limit_ns, key=attrgetter('now_ns'))]
        if not states:
            return self._new_robot(self._inputs)
        return states[-1].copy(self._inputs)

    def _await_states(self, until_ns: int) -> None:
        """Wait for the last state before a tick, which is made faster meanwhile."""
        self._is_awaited, end_s = True, time.monotonic() + _LONGEST_WAIT_S
        while self._maker.is_alive() and time.monotonic() < end_s:
            if self._states and self._states[-1].now_ns > until_ns - self._period_ns:
                break
            self._maker.join(_REST_S)
        self._is_awaited = False

    def advance(self) -> Tick | None:
        """Make a tick; None if the run has ended at a wall."""
        robot = self._robot
        if robot.loop.plant.stopped:
            return None
        if robot.now_ns % SECOND_NS == 0 and robot.now_ns > self._begun_ns:
            with suppress(TypeError):
                latest = self._later_states[1 - _MAX_STATES :]
                self._later_states = [*latest, robot.copy(self._inputs)]
        with self._timer:
            return self._tick(robot)

    def _tick(self, robot: _Robot) -> Tick:
        now_ns, live = robot.now_ns, self._live
        for push in live.pushes:
            if push.start_ns == now_ns:
                robot.loop.plant.push(push)
        if now_ns in live.retunings:
            robot.tuned.changes.add(now_ns, live.retunings[now_ns])
        tick = robot.tick()
        if tick.inputs.sticks is not None:
            live.received[now_ns] = tick.inputs.sticks
        return tick

    def push(self, force: Pair) -> None:
        """Push the body with a force [N] in plane signs, from the next tick on."""
        now_ns = self._robot.now_ns
        self._live.pushes.append(Push(now_ns, now_ns + self._push_ns, force, (0.0, 0.0)))

    def hold(self, sticks: Pair) -> None:
        """Hold the sticks at the next tick: forward and rightward, each −1 ... 1."""
        now_ns = self._robot.now_ns
        if now_ns % SLOW_PERIOD_NS == 0:
            forward, rightward = sticks
            self._live.sticks[now_ns] = round(-100.0 * forward), round(100.0 * rightward)

    @property
    def is_driven(self) -> bool:
        """Whether somebody has taken the sticks."""
        return bool(self._live.sticks)

    def retune(self, values: Mapping[str, object]) -> None:
        """Change parameters of the controller at the next tick; BallbotError if they can't be."""
        new = self.implementation.changed(self.parameters, values).values()
        retuned = self._live.retunings.setdefault(self._robot.now_ns, {})
        retuned.update({name: new[name] for name in values})

    def add_fault(self, text: str) -> None:
        """Begin a fault at the next tick, as in a scenario; BallbotError if it can't be."""
        now_ns = self._robot.now_ns
        before = self._live.faults
        new = [replace(each, time=_time(now_ns)) for each in parse_faults(text)]
        try:
            self._set_faults((*before, *new))
            self._robot = self._robot_at(now_ns)
        except BallbotError:
            self._set_faults(before)
            raise

    def _set_faults(self, faults: tuple[Fault, ...]) -> None:
        """Let the robot have faults from the start on, which begin later."""
        self._live.faults = faults
        # One may begin after the recorded end.
        end = max([self._duration, *(each.time + TICK_S for each in faults)])
        past = self._past._replace(parameters=self._parameters(end))
        self._spec = branch_spec(past, Future(at=self.begun, faults=faults), self._scratch)
        tasks = [task.name for task in self.implementation.tasks]
        faults_of(self._spec.parameters.of(ControllerParameters), tasks)
        self._later_states = []

    def _parameters(self, duration: float) -> ParameterSet:
        """Return the recorded parameters, for another duration of the run [s]."""
        parameters = ParameterSet(self._past.parameters)
        parameters.set(PLANT, 'duration', duration)
        return parameters

    def keep(self, observer: RunObserver) -> Path | None:
        """Write the recording of what has been done; return it, or None if it was interrupted.

        It raises BallbotError if it can't be written, or its beginning is not the recorded one.
        """
        result = execute(self._branch(), observer)
        if result.recording is None or result.failure_status > 128:
            return None
        if problem := prove(self._past, result.recording, self.begun).problem:
            raise BallbotError(problem)
        return result.recording

    def _branch(self) -> RunSpec:
        """Return the run of what has been done, up to the present."""
        past, live, end_ns = self._past, self._live, self._robot.now_ns
        inputs = past.inputs
        begun = faults = tuple(each for each in live.faults if _stamp(each.time) < end_ns)
        retunings = {
            stamp_ns: {**inputs.retunings.get(stamp_ns, {}), **live.retunings.get(stamp_ns, {})}
            for stamp_ns in {*inputs.retunings, *live.retunings}
            if stamp_ns < end_ns
        }
        # The planned ones go on after the recorded end.
        later = [at for at in range(FIRST_TICK_NS, end_ns, SLOW_PERIOD_NS) if at > inputs.last_ns]
        sticks = {**inputs.sticks, **{at: self._spec.scenario.sticks_at(_time(at)) for at in later}}
        if live.sticks:
            # What has passed the faults of the gamepad is sent now, so they do not act again.
            sticks = {at: each for at, each in sticks.items() if at < self._begun_ns}
            sticks |= live.received
            faults = tuple(each for each in faults if each.component != 'gamepad')
        lived = past._replace(
            inputs=replace(
                inputs,
                last_ns=end_ns - TICK_NS,
                sticks=sticks,
                retunings=retunings,
                pushes=[each for each in inputs.pushes if each.start_ns < end_ns],
            ),
            parameters=self._parameters(_time(end_ns)),
        )
        pushes = tuple(
            ScheduledPush(_time(each.start_ns), self._push_ns / SECOND_NS, force=each.force)
            for each in live.pushes
            if each.start_ns < end_ns
        )
        future = Future(at=self.begun, pushes=pushes, faults=faults)
        spec = branch_spec(lived, future, self._scratch)
        told = list(replace(future, faults=begun).told)
        told += [
            f'{CONTROLLER}.{name} = {value_text(value)} at {_time(stamp_ns):.3f} s'
            for stamp_ns, values in sorted(live.retunings.items())
            for name, value in values.items()
        ]
        told += ['driven by hand'] if live.sticks else []
        assert spec.parent is not None
        return replace(spec, parent=replace(spec.parent, changes=tuple(told)))


def _stamp(time: float) -> int:
    """Return the stamp of the tick nearest to a time from the start of the run [s]."""
    return FIRST_TICK_NS + round(time * SECOND_NS / TICK_NS) * TICK_NS


def _time(stamp_ns: int) -> float:
    return (stamp_ns - FIRST_TICK_NS) / SECOND_NS
