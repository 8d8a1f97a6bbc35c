"""A controller as a control program: parameters, readings in, duty out, mistakes on one line."""

from __future__ import annotations

import inspect
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import lru_cache
from types import FrameType
from typing import Any, NoReturn

from ballbot_ros.controllers.controller import (
    IDLE,
    MAX_DUTY,
    NO_READINGS,
    TICK,
    Controller,
    Duty,
    Readings,
    next_readings,
    whole_number,
    with_design,
)
from ballbot_ros.controllers.interface import SAME_TICK, Estimates, Glide, OperatingState
from ballbot_ros.controllers.loading import LoadedController, shown_line
from ballbot_ros.errors import ControllerError, one_line, short_repr
from ballbot_ros.parameters import (
    CONTROLLER,
    MAX_DESIGNED,
    PLANT,
    ControllerParameters,
    Parameter,
    ParameterError,
    ParameterSet,
    TakesEffect,
    Value,
    declared_in,
    parameters_of,
)
from ballbot_ros.parameters.controller import MODEL, USER
from ballbot_ros.parameters.timing import MILLISECOND_NS, TICK_MS
from ballbot_ros.robot.brick.brick import (
    UINT32_MASK,
    Brick,
    DeviceInputs,
    DeviceOutputs,
    as_numbers,
)
from ballbot_ros.robot.brick.job_times import JobTimes
from ballbot_ros.robot.plant.model import PhysicalParameters


@lru_cache(maxsize=8)
def own_rows(loaded: LoadedController) -> tuple[Parameter, ...]:
    """Return the parameters of a controller: those of its class, and the physical values.

    It raises ControllerError if its class does not declare its parameters as it should.
    """
    try:
        _check_settings(loaded)
        return (*_user_rows(loaded), *_model_rows())
    except ControllerError as error:
        raise ControllerError(f'{loaded.code.shown}: {error}') from None
    except Exception as error:  # of annotations and defaults, which are the user's
        cls = loaded.cls.parameters_class
        name = getattr(cls, '__name__', short_repr(cls))
        raise ControllerError(f'{loaded.code.shown}: {name}: {one_line(error)}') from None


def _check_settings(loaded: LoadedController) -> None:
    """Check the names of the settings that the class takes over during a run."""
    rows = parameters_of(CONTROLLER).values()
    allowed = [row.name for row in rows if row.is_live]
    for name in loaded.cls.tunable_settings:
        if name not in allowed:
            raise ControllerError(
                f'tunable_settings: {short_repr(name)} is not one of {", ".join(allowed)}'
            )


def _user_rows(loaded: LoadedController) -> Iterator[Parameter]:
    cls = loaded.cls.parameters_class
    name = getattr(cls, '__name__', short_repr(cls))
    is_class = isinstance(cls, type) and is_dataclass(cls)
    if not is_class or not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        raise ControllerError(f'{name} is not a dataclass with frozen=True')
    for each in fields(cls):
        if not each.metadata or each.default is MISSING:
            raise ControllerError(
                f'{name}.{each.name} is not declared by quantity, setting or designed'
            )
    for row in declared_in(cls, CONTROLLER, USER):
        if row.is_designed:
            yield row
            continue
        is_whole = isinstance(row.default, int) and not isinstance(row.default, bool)
        if is_whole and not all(abs(each) < 2**63 for each in (row.default, *(row.bounds or ()))):
            raise ControllerError(f'{name}.{row.name}: a whole number has at most 63 bits')
        if isinstance(row.default, tuple) and len(row.default) > MAX_DESIGNED:
            raise ControllerError(f'{name}.{row.name}: more than {MAX_DESIGNED} numbers')
        try:
            yield replace(row, default=row.check(row.default, 'default of '))
        except ParameterError as error:
            raise ControllerError(str(error)) from None


def _model_rows() -> Iterator[Parameter]:
    known = parameters_of(PLANT)
    for each in fields(PhysicalParameters):
        row = known[each.name]
        yield replace(
            row,
            nodes=(CONTROLLER,),
            name=MODEL + row.name,
            description=f'{row.description}, to design for',
            takes_effect=TakesEffect.NEXT_RUN,
        )


def user_parameters(loaded: LoadedController, parameters: ControllerParameters) -> Any:
    """Return an instance of the class of the controller's parameters."""
    values = _with_prefix(parameters.values(), USER)
    try:
        return loaded.cls.parameters_class(**values)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise ControllerError(loaded.code.describe(error)) from None


def design_model(parameters: ControllerParameters) -> PhysicalParameters:
    """Return the physical values to design for."""
    return PhysicalParameters(**_with_prefix(parameters.values(), MODEL))  # type: ignore[arg-type]


def _with_prefix(values: Mapping[str, Value], prefix: str) -> dict[str, Value]:
    return {
        name.removeprefix(prefix): value
        for name, value in values.items()
        if name.startswith(prefix)
    }


def missing_design(parameters: ControllerParameters, rows: Iterable[Parameter]) -> list[str]:
    """Return the names of the parameters that have to be designed first."""
    values = parameters.values()
    return [row.name for row in rows if row.is_designed and not values[row.name]]


def design(loaded: LoadedController, parameters: ParameterSet) -> None:
    """Design the values that are not set, and set them.

    It raises ControllerError or ParameterError if the design fails, or gives values that are not
    allowed.
    """
    given = parameters.of(ControllerParameters)
    missing = missing_design(given, own_rows(loaded))
    if not missing:
        return
    user = user_parameters(loaded, given)
    where = f'{loaded.cls.__name__}.{Controller.design.__name__}'
    try:
        designed = _with_design(loaded.cls, user, design_model(given))  # type: ignore[arg-type]
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise ControllerError(f'{loaded.code.describe(error)} ({where})') from None
    for name in missing:
        value = getattr(designed, name.removeprefix(USER))
        parameters.set(CONTROLLER, name, value, f'{loaded.code.shown}: {where}')


_with_design = lru_cache(maxsize=256)(with_design)  # many runs of a study may have the same

SECOND_MS = 1000
_ESTIMATES = tuple(each.name for each in fields(Estimates))
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
        took_ms = took_ns / MILLISECOND_NS
        self.ticks += 1
        self.slow += took_ms > TICK_MS
        if took_ms > self.longest_ms:
            self.longest_ms, self.longest_at_s = took_ms, elapsed_ms / SECOND_MS

    @property
    def problem(self) -> str:
        """That the ticks take too long; '' if few of them do, as on any busy machine."""
        if self.slow <= NOTABLE_SHARE * self.ticks and self.longest_ms <= NOTABLE_MS:
            return ''
        return (
            f'{self.slow} of {self.ticks} ticks took longer than {TICK_MS} ms of wall time, the '
            f'longest {self.longest_ms:.1f} ms at {self.longest_at_s:.3f} s: the controller is '
            'slow here, or this machine was busy'
        )


class ControllerProgram:
    """Runs a controller on the brick.

    It raises ControllerError if the controller's constructor fails. Its methods raise it likewise.

    Parameters
    ----------
    parameters, model, settings : object
        Arguments of the controller's class.
    times : TickTimes
        Receives how long each tick takes; also an attribute.

    Attributes
    ----------
    controller : Controller
        The instance of the class that runs.
    x, y : Estimates
        Of the planes.
    operating_state : OperatingState
        The state of figure 7-1.
    """

    def __init__(
        self,
        loaded: LoadedController,
        parameters: object,
        model: PhysicalParameters,
        settings: ControllerParameters,
        times: TickTimes,
    ) -> None:
        self.loaded = loaded
        self._name = loaded.cls.__name__
        self.times = times
        times.reset()
        self.tasks = loaded.tasks
        self._user, self._model = parameters, model
        self._glide = Glide(settings)
        self._readings = NO_READINGS
        self.restart()

    def restart(self) -> None:
        """Begin with a new controller, and with the newest samples."""
        self._start_ms: int | None = None
        self._task = ''
        loaded = self.loaded
        try:
            settings = self._glide.parameters
            self.controller: Controller[Any] = loaded.cls(self._user, self._model, settings)
            self._brick: Brick = self.controller._brick
            self._methods = {
                name: getattr(self.controller, name) for name, _, _ in loaded.tasks if name != IDLE
            }
            self._take_state()
        except BaseException as error:
            raise self._error(error, f'{self._name} at the start') from None

    def retune(self, parameters: ControllerParameters) -> None:
        """Take over parameters that change during a run, from the next tick on."""
        self._glide.move_to(parameters)

    def _move(self, elapsed_ms: int) -> None:
        """Let the controller take over the values of the next tick."""
        settings = self._glide.tick()
        try:
            self._user = user_parameters(self.loaded, settings)
        except ControllerError:
            if not self._glide.is_moving:
                raise
            # Its class does not allow every value on the way.
        try:
            self.controller.retune(self._user, settings)
        except BaseException as error:
            at = f'{self._name}.retune at {elapsed_ms / SECOND_MS:.3f} s'
            raise self._error(error, at) from None

    def run(
        self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs, flags: int = 0
    ) -> DeviceOutputs:
        """Run the tasks with these names, in this order, on the inputs of a tick.

        The bus does not matter: the readings of the sonar reach a controller by themselves.
        """
        if self._start_ms is None:
            self._start_ms = systick_ms
        elapsed_ms = (systick_ms - self._start_ms) & UINT32_MASK
        self._readings = readings = next_readings(self._readings, elapsed_ms, as_numbers(inputs))
        self._brick.sonar_cm = readings.distance_cm
        started_ns = time.perf_counter_ns()
        is_same_tick = bool(flags & SAME_TICK)
        if self._glide.is_moving and not is_same_tick:
            self._move(elapsed_ms)
        try:
            outputs = self._brick.tick(
                systick_ms,
                inputs,
                lambda: self._run_tasks(tasks, readings),
                is_same_tick=is_same_tick,
            )
        except BaseException as error:
            duty = ', '.join(map(str, self._brick.duty))
            at = f'{self._name}.{self._task} at {elapsed_ms / SECOND_MS:.3f} s'
            raise self._error(error, f'{at}; {readings}; last duty {duty}') from None
        self.times.add(elapsed_ms, time.perf_counter_ns() - started_ns)
        return outputs

    def job_time(self, task: str, outputs: DeviceOutputs, times: JobTimes) -> float:
        """Return the declared time of a task, whatever it calls [µs]."""
        return 0.0 if task == IDLE else times.own

    def _run_tasks(self, tasks: Sequence[str], readings: Readings) -> None:
        for name in tasks:
            if name == IDLE:
                continue
            self._task = name
            answer = self._methods[name](readings)
            if answer is not None or name == TICK:
                self._brick.duty = self._duty(answer, self._methods[name])
        self._take_state()

    def _duty(self, answer: Any, method: object) -> Duty:
        """Return a controller's answer as a duty."""
        try:
            try:
                x, y = answer
            except (TypeError, ValueError):
                raise ControllerError('not the duties of two motors') from None
            return whole_number(x, -MAX_DUTY, MAX_DUTY), whole_number(y, -MAX_DUTY, MAX_DUTY)
        except ControllerError as error:
            line = line_of(method) or self.loaded.code.public
            raise InvalidAnswerError(f'{line}: returned {short_repr(answer)}: {error}') from None

    def _take_state(self) -> None:
        """Take over what is published; refuse what can't be."""
        controller = self.controller
        self.x = self._estimates('x', controller.x)
        self.y = self._estimates('y', controller.y)
        self.operating_state = controller.operating_state
        if not isinstance(self.operating_state, OperatingState):
            self._refuse('operating_state', self.operating_state, 'an OperatingState')

    def _estimates(self, plane: str, estimates: object) -> Estimates:
        """Return a copy, whose values are exact floats."""
        if not isinstance(estimates, Estimates):
            self._refuse(plane, estimates, 'an Estimates')
        values = {}
        for name in _ESTIMATES:
            value = getattr(estimates, name)
            try:
                values[name] = float(value * 1.0)
            except (TypeError, ValueError, OverflowError):
                self._refuse(f'{plane}.{name}', value, 'a number')
        return Estimates(**values)

    def _refuse(self, name: str, value: object, wanted: str) -> NoReturn:
        place = f'{self.loaded.code.public}: {self._name}.{name}'
        raise InvalidAnswerError(f'{place}: {short_repr(value)} is not {wanted}')

    def _error(self, error: BaseException, where: str) -> ControllerError:
        """Return an error of the user's code, with its file and line."""
        if isinstance(error, InvalidAnswerError):
            return ControllerError(f'{error} ({where})')
        return ControllerError(f'{self.loaded.code.describe(error)} ({where})')


def running_tick(frame: FrameType | None) -> FrameType | None:
    """Return the frame of the tick whose user's code a frame belongs to; None if there is none.

    Its variable `self` is the program. A tick has a frame of its own, but may have two if gains
    move in it.
    """
    while frame and frame.f_code not in _USERS_CODE:
        frame = None if frame.f_code is ControllerProgram._error.__code__ else frame.f_back
    return frame


_USERS_CODE = (ControllerProgram._run_tasks.__code__, ControllerProgram._move.__code__)


class InvalidAnswerError(ControllerError):
    """An answer of a controller that can't be used; the text says where it is from."""


def line_of(method: Any) -> str:
    """Return file and line of a method's definition; '' if it is not written in Python."""
    function = inspect.unwrap(getattr(method, '__func__', method))
    code = getattr(function, '__code__', None)
    return shown_line(code.co_filename, code.co_firstlineno) if code else ''
