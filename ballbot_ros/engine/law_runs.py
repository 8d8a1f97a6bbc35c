"""Runs of controllers whose law is a function on numbers, by compiled code.

The first functions stand for those of :mod:`ballbot_ros.engine.run` with their names, which are the
document's program.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from inspect import unwrap
from types import FunctionType
from typing import Any, NamedTuple

from ballbot_ros.controllers.controller import (
    MAX_DUTY,
    NO_READINGS,
    Controller,
    Law,
    LawController,
    Readings,
    next_readings,
)
from ballbot_ros.controllers.controller_program import line_of
from ballbot_ros.controllers.policy import policy
from ballbot_ros.engine.compilation import (
    NO_COMPILER,
    can_compile,
    compilation_problem,
    compiled,
    compiled_and_kept,
    functions_sha256,
    has_kept_code,
)
from ballbot_ros.engine.rows import has_column, kind_of, row_functions_of, rows_of
from ballbot_ros.engine.run import simulate_run, simulate_runs
from ballbot_ros.errors import short_repr
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.arithmetic import Ints
from ballbot_ros.robot.brick.brick import NO_SAMPLE, Inputs
from ballbot_ros.robot.brick.fault_effects import TICK_TASK
from ballbot_ros.robot.brick.job_times import JobTimes
from ballbot_ros.robot.brick.kernel import set_task
from ballbot_ros.robot.compiler_hints import inlined, with_globals

FAULTS = (ValueError, ArithmeticError, LookupError)
"""What compiled laws raise, like those of the interpreter."""


class LawState(NamedTuple):
    """The state of a controller on the brick; `own` is that of its law."""

    duty_x: int
    duty_y: int
    readings: Readings
    own: Any


def begin_program(program: Any, begun_ms: int) -> tuple[Any, int]:
    """Return the constants of the law, read from its row, and 0, since it has no timers."""
    return read_constants(program), 0


def due_tasks(timers: int, elapsed_ms: int) -> tuple[int, int]:
    """Return the only task, as a bit, and the timers."""
    return 1, timers


@inlined
def run_tasks(
    constants: Any,
    program: Any,
    state: LawState,
    inputs: Inputs,
    tasks: int,
    elapsed_ms: int,
    systick_ms: int,
) -> LawState:
    """Return the state after a tick, perhaps without the task; ValueError if there is no duty."""
    duty_x, duty_y, readings, own = state
    readings = next_readings(readings, elapsed_ms, inputs)
    if tasks:
        own, (duty_x, duty_y) = law(constants, own, readings)
        if not (-MAX_DUTY <= duty_x <= MAX_DUTY and -MAX_DUTY <= duty_y <= MAX_DUTY):
            raise ValueError('no duty')
    return LawState(duty_x, duty_y, readings, own)


def restarted(state: LawState, initial: LawState) -> LawState:
    """Return the state of a law that starts anew, with the newest samples."""
    return LawState(0, 0, state.readings, initial.own)


def set_tasks(kernel: Ints, timers: int) -> None:
    """Set the only task in a kernel."""
    set_task(kernel, 0, 1, TICK_MS)


def time_of_job(times: JobTimes, task: int, state: LawState) -> float:
    """Return how long a tick takes [µs]."""
    return times.own


def made_for_each_law(*arguments: Any) -> Any:
    """Stand for a function that takes the place of one of these names."""
    raise NotImplementedError


read_constants = law = read_program_state = write_program_state = made_for_each_law


def some_ticks(program: Any, robot: Any) -> None:
    """Make ticks without readings: what a law that compiles can do."""
    constants, timers = begin_program(program, 0)
    state = read_program_state(robot)
    for tick in range(2):
        tasks, timers = due_tasks(timers, tick * TICK_MS)
        state = run_tasks(constants, program, state, NOTHING_READ, tasks, tick * TICK_MS, 0)
    write_program_state(robot, state)


NOTHING_READ = Inputs(0, 0, 0, 0, NO_SAMPLE, NO_SAMPLE, NO_SAMPLE, NO_SAMPLE)


class LawCode:
    """The compiled runs of a controller with a law, before its first tick.

    Others with the same law need the same code if they have the same :func:`kinds_of`.
    """

    def __init__(self, controller: LawController[Any]) -> None:
        self._law = type(controller).law
        self._constants, self._state = controller.in_force, initial_state(controller)
        self._kinds = kinds_of(controller)
        self._obstacle = obstacle(self._law, controller)
        self._of_law = self._name = ''
        if not self._obstacle:
            kinds = hashlib.sha256(repr(self._kinds).encode()).hexdigest()
            self._of_law = f'{self._law.__name__}_{functions_sha256(self._law)[:16]}'
            self._name = f'{self._of_law}_{kinds[:16]}'

    @property
    def kept(self) -> str:
        """Name of the code on disk."""
        return f'{simulate_runs.__qualname__}_{self._name}'

    @property
    def is_kept(self) -> bool:
        """Whether code of the law is on disk, be it for other kinds."""
        return not self._obstacle and has_kept_code(
            f'{simulate_runs.__qualname__}_{self._of_law}_*'
        )

    def compile(self) -> Callable[..., Any]:
        """Return :func:`~ballbot_ros.engine.run.simulate_runs` with the law as the program."""
        run = with_globals(simulate_run, self._places())
        return compiled_and_kept(simulate_runs, self._name, {simulate_run.__name__: run})

    def problem(self) -> str:
        """Return why the code can't be compiled, on one line; '' if it can."""
        if not can_compile():
            return NO_COMPILER
        if self._obstacle or self.is_kept:
            return self._obstacle
        if self._name not in _problems:
            rows = rows_of([self._constants])[0], rows_of([self._state])[0]
            problem = compilation_problem(with_globals(some_ticks, self._places()), *rows)
            if 'Cannot unify LawState' in problem:
                problem = f'{line_of(self._law)}: {OTHER_TYPES}'
            _problems[self._name] = problem
        return _problems[self._name]

    def _places(self) -> dict[str, object]:
        """Return what takes the places of functions and tasks of the document's program."""
        read_own, _ = row_functions_of(self._kinds[0])
        read, write = row_functions_of(self._kinds[1])
        return {
            'begin_program': with_globals(begin_program, {'read_constants': read_own}),
            'due_tasks': due_tasks,
            'run_tasks': with_globals(run_tasks, {'law': compiled(self._law)}),
            'restarted': restarted,
            'set_tasks': set_tasks,
            'time_of_job': time_of_job,
            'DUTY_TASK': 0,
            'BUS_TASK': -1,
            'FIRST_TASK': TICK_TASK,
            'read_program_state': read,
            'write_program_state': write,
        }


_problems: dict[str, str] = {}

OTHER_TYPES = (
    'it returns a state with other types than the initial one has, or a duty that is no whole '
    'number'
)


def obstacle(law: Law, controller: LawController[Any]) -> str:
    """Return why a law can't be compiled whatever it computes, on one line; '' if it may be."""
    name = type(controller).__name__
    own = unwrap(law)
    if own is policy:
        return f'{name} has no policy on numbers, see docs/learning.md'
    if not isinstance(own, FunctionType):
        return f'{name}.law is no function'
    if own.__closure__:
        return f'{line_of(own)}: it reads variables of the function around it'
    for what, value in (('constants', controller.in_force), ('initial state', controller.state)):
        if not hasattr(value, '_fields'):
            return f'the {what} of {name}: {short_repr(value)} is no named tuple'
        if strange := first_strange(value):
            return f'the {what} of {name}: {short_repr(strange)} is no number, switch or tuple'
    return ''


def first_strange(value: Any) -> Any:
    """Return the first member of a tuple, or of one in it, that has no place in a row."""
    for each in value:
        if isinstance(each, tuple):
            if strange := first_strange(each):
                return strange
        elif not has_column(kind_of(each)):
            return each
    return None


def initial_state(controller: LawController[Any]) -> LawState:
    """Return the state of a controller before its first tick."""
    return LawState(0, 0, NO_READINGS, controller.state)


def kinds_of(controller: LawController[Any]) -> tuple[Any, Any]:
    """Return the kinds of the constants and of the initial state of a controller."""
    return kind_of(controller.in_force), kind_of(initial_state(controller))


def has_law(cls: type[Controller[Any]]) -> bool:
    """Return whether a class of controllers has a law that tells all about its duties."""
    return issubclass(cls, LawController) and cls.tick is LawController.tick
