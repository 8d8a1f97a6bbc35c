"""A controller as a control program: readings in, duty out, every mistake reported on one line."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ballbot_ros.brick.brick import UINT32_MASK, Brick, DeviceInputs, DeviceOutputs
from ballbot_ros.brick.schedule import Schedule
from ballbot_ros.brick.units import NO_DATA_CM, NO_ECHO_CM
from ballbot_ros.controllers.controller import (
    IDLE,
    MAX_DUTY,
    TICK,
    TICK_MS,
    Controller,
    Duty,
    Readings,
    whole_number,
)
from ballbot_ros.controllers.errors import ControllerError
from ballbot_ros.controllers.interface import Estimates, OperatingState, PlaneEstimates
from ballbot_ros.controllers.loading import LoadedController, shown_path
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.plant.model import PhysicalParameters

NANOSECONDS_PER_MILLISECOND = 1_000_000
NOTABLE_SHARE = 0.01
NOTABLE_MS = 25 * TICK_MS


@dataclass
class TickTimes:
    """How long the ticks of a controller take, against the 4 ms of the brick.

    Attributes
    ----------
    ticks, slow : int
        Number of ticks, and of those that took longer than 4 ms.
    longest_ms : float
        Wall time of the longest tick [ms].
    longest_at_s : float
        When it was, from the start of the run [s].
    """

    ticks: int = 0
    slow: int = 0
    longest_ms: float = 0.0
    longest_at_s: float = 0.0

    def reset(self) -> None:
        """Forget all ticks: another run begins."""
        self.ticks = self.slow = 0
        self.longest_ms = self.longest_at_s = 0.0

    def add(self, elapsed_ms: int, took_ns: int) -> None:
        """Count a tick at `elapsed_ms` that took `took_ns` of wall time."""
        took_ms = took_ns / NANOSECONDS_PER_MILLISECOND
        self.ticks += 1
        self.slow += took_ms > TICK_MS
        if took_ms > self.longest_ms:
            self.longest_ms, self.longest_at_s = took_ms, elapsed_ms / 1000

    @property
    def problem(self) -> str:
        """That the ticks take too long; '' if few of them do, as on any busy machine."""
        if self.slow <= NOTABLE_SHARE * self.ticks and self.longest_ms <= NOTABLE_MS:
            return ''
        return (
            f'{self.slow} of {self.ticks} ticks took longer than {TICK_MS} ms, the longest '
            f'{self.longest_ms:.1f} ms at {self.longest_at_s:.3f} s: the brick could not keep up'
        )


class ControllerProgram:
    """Runs a controller on the brick.

    Parameters
    ----------
    loaded : LoadedController
    parameters, model, settings : object
        Arguments of the controller's class.
    times : TickTimes
        Receives how long each tick takes.

    Raises
    ------
    ControllerError
        If the controller's constructor fails. Its methods raise it likewise.
    """

    def __init__(
        self,
        loaded: LoadedController,
        parameters: Any,
        model: PhysicalParameters,
        settings: ControllerParameters,
        times: TickTimes,
    ) -> None:
        self._loaded = loaded
        self._name = loaded.cls.__name__
        self._times = times
        times.reset()
        self._schedule = Schedule(loaded.tasks)
        self._start_ms: int | None = None
        self._readings = Readings(0, (0, 0), (0, 0), 0)
        self._controller: Controller[Any] = self._call(
            lambda: loaded.cls(parameters, model, settings), f'{self._name} at the start'
        )
        self._brick: Brick = self._controller._brick
        self._methods = {
            name: getattr(self._controller, name) for name, _, _ in loaded.tasks if name != IDLE
        }

    @property
    def x(self) -> PlaneEstimates:
        """Plane x."""
        return self._controller.x

    @property
    def y(self) -> PlaneEstimates:
        """Plane y."""
        return self._controller.y

    @property
    def operating_state(self) -> OperatingState:
        """The state of figure 7-1."""
        return self._controller.operating_state

    def tick(self, elapsed_ms: int, systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks due `elapsed_ms` after the start on the inputs of that time."""
        return self.run(self._schedule.due(elapsed_ms), systick_ms, inputs)

    def run(self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks with these names, in this order, on the inputs of a tick."""
        if self._start_ms is None:
            self._start_ms = systick_ms
        elapsed_ms = (systick_ms - self._start_ms) & UINT32_MASK
        before = self._readings
        self._readings = readings = Readings(
            elapsed_ms,
            inputs.gyro,
            inputs.revolutions,
            before.battery_mv if inputs.battery_mv is None else inputs.battery_mv,
            before.distance_cm if inputs.sonar_cm is None else _distance_cm(inputs.sonar_cm),
            before.sticks if inputs.sticks is None else inputs.sticks,
        )
        self._brick.sonar_cm = readings.distance_cm
        started_ns = time.perf_counter_ns()
        outputs = self._brick.tick(
            systick_ms, inputs, lambda: self._run_tasks(tasks, readings, elapsed_ms)
        )
        self._times.add(elapsed_ms, time.perf_counter_ns() - started_ns)
        return outputs

    def _run_tasks(self, tasks: Sequence[str], readings: Readings, elapsed_ms: int) -> None:
        for name in tasks:
            if name == IDLE:
                continue
            method = self._methods[name]
            where = f'{self._name}.{name} at {elapsed_ms / 1000:.3f} s'
            answer = self._call(lambda: method(readings), where)  # noqa: B023
            if answer is not None or name == TICK:
                line = line_of(method)
                self._brick.duty = _duty(answer, line, where)
        self._check_state()

    def _check_state(self) -> None:
        """Refuse what can't be published."""
        controller = self._controller
        for name, plane in (('x', controller.x), ('y', controller.y)):
            if not isinstance(plane, Estimates):
                raise ControllerError(f'{self._name}.{name}: {plane!r} is not an Estimates')
            for key, value in vars(plane).items():
                if not isinstance(value, float | int | np.number):
                    raise ControllerError(f'{self._name}.{name}.{key}: {value!r} is not a number')
        if not isinstance(controller.operating_state, OperatingState):
            raise ControllerError(
                f'{self._name}.operating_state: {controller.operating_state!r} is not an '
                'OperatingState'
            )

    def _call(self, function: Callable[[], Any], where: str) -> Any:
        """Call a function of the controller; an error names file and line of the user's code."""
        try:
            return function()
        except (Exception, SystemExit) as error:
            raise ControllerError(f'{self._loaded.code.describe(error)} ({where})') from None


def line_of(method: Any) -> str:
    """Return file and line of a method's definition."""
    code = method.__func__.__code__
    return f'{shown_path(code.co_filename)}:{code.co_firstlineno}'


def _duty(answer: Any, line: str, where: str) -> Duty:
    """Return a controller's answer as a duty; ControllerError if it is none."""
    try:
        x, y = answer
    except (TypeError, ValueError):
        raise ControllerError(
            f'{line}: returned {answer!r}, not the duties of two motors ({where})'
        ) from None
    try:
        return whole_number(x, -MAX_DUTY, MAX_DUTY), whole_number(y, -MAX_DUTY, MAX_DUTY)
    except ControllerError as error:
        raise ControllerError(f'{line}: returned {answer!r}: {error} ({where})') from None


def _distance_cm(sonar_cm: int) -> int:
    """Return the sonar's distance [cm]; that of no echo if the sensor does not answer."""
    return NO_ECHO_CM if sonar_cm == NO_DATA_CM else sonar_cm
