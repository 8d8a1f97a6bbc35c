"""The code of the controllers of a study's runs: the document's program, or another law."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import groupby
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ballbot_ros.controllers.codegen.implementation import (
    check_load,
    compose_controller,
    processor_load,
)
from ballbot_ros.controllers.controller import LawController
from ballbot_ros.controllers.controller_program import design_model, user_parameters
from ballbot_ros.controllers.document.program import INITIAL_STATE, TASK_NUMBERS
from ballbot_ros.controllers.loading import LoadedController
from ballbot_ros.engine.compilation import (
    NO_COMPILER,
    CompilationError,
    can_compile,
    compiled_and_kept,
    is_kept,
)
from ballbot_ros.engine.law_runs import LawCode, has_law, initial_state, kinds_of
from ballbot_ros.engine.rows import (
    Column,
    RobotRows,
    Rows,
    program_rows,
    robot_parameter,
    rows_of,
    split_element,
    whole_values,
)
from ballbot_ros.engine.run import simulate_runs
from ballbot_ros.errors import BallbotError, StudyError
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet
from ballbot_ros.parameters.controller import MODEL, USER
from ballbot_ros.parameters.files import assign_values, plain_values
from ballbot_ros.robot.brick.schedule import TaskTiming
from ballbot_ros.run.spec import RunSpec

Values = Mapping[str, Column]
"""Values of parameters by ``node.param``, one for each run."""


MOST_CODES = 8
"""Most codes for the runs of a study: each takes 20 s to compile."""


class ProgramRows(NamedTuple):
    """The programs of consecutive runs that need the same code.

    Attributes
    ----------
    first : int
        Which run is the first one.
    simulate : callable
        :func:`~ballbot_ros.engine.run.simulate_runs` with these programs.
    constants : Rows
        One for each run.
    states : Rows
        The initial ones: for each run, or one for all.
    """

    first: int
    simulate: Callable[..., Any]
    constants: Rows
    states: Rows

    def parts(self, size: int) -> Iterator[tuple[slice, Rows, Rows]]:
        """Yield at most so many runs at a time: which they are, their constants and states."""
        for begin in range(0, len(self.constants), size):
            part = slice(begin, begin + size)
            constants = self.constants[part]
            runs = slice(self.first + begin, self.first + begin + len(constants))
            yield runs, constants, self.states if len(self.states) == 1 else self.states[part]


class Programs:
    """The control programs of runs, as the compiled code needs them: here the document's.

    Attributes
    ----------
    are_users : bool
        Whether they are written by a user. A run may then never end, so that only a process of its
        own can be ended; and it may use what the compiler does otherwise than the interpreter.
    tasks : int
        Number of tasks of each.
    """

    are_users = False
    tasks = len(TASK_NUMBERS)

    def problem(self) -> str:
        """Return why their code can't be compiled, on one line; '' if it can."""
        return '' if can_compile() else NO_COMPILER

    @property
    def is_kept(self) -> bool:
        """Whether their code is on disk."""
        return is_kept(simulate_runs)

    def of_robots(self, values: Values) -> Values:
        """Return those of the values that are not of the controller's class; here it has none."""
        return values

    def rows(
        self, rows: RobotRows, values: Values, count: int, first: int
    ) -> Sequence[ProgramRows]:
        """Return the programs of all runs.

        Parameters
        ----------
        rows : RobotRows
            The parameters of all runs, without those of the controller's class.
        values : Values
            What distinguishes the runs.
        first : int
            Number of the first run, for error messages.

        Raises
        ------
        CompilationError
            If the runs need too many codes.
        BallbotError
            If a value is not allowed, or a controller can't be made.
        """
        check_loads(rows[ControllerParameters], first)
        constants, states = program_rows(rows[ControllerParameters]), rows_of([INITIAL_STATE])
        return [ProgramRows(0, compiled_and_kept(simulate_runs), constants, states)]


class _Settings(ControllerParameters):
    """Settings that note the names of those that are read: a law depends on few."""

    read: ClassVar[set[str]] = set()

    def __getattribute__(self, name: str) -> Any:
        value = super().__getattribute__(name)
        # Whoever copies them may read them all.
        read = super().__getattribute__('__dict__') if name.startswith('__') else (name,)
        super().__getattribute__('read').update(read)
        return value


class _Laws(Programs):
    """The law of a specification's controller, with the parameters of each run."""

    tasks = 1

    def __init__(self, spec: RunSpec, loaded: LoadedController) -> None:
        self._spec, self._loaded = spec, loaded
        self._code = LawCode(self._controller({}, set()))
        self._codes: dict[Any, Callable[..., Any]] = {}
        self.are_users = not loaded.code.is_ours

    def problem(self) -> str:
        """Return why the law can't be compiled; those of this package can."""
        if self.are_users or not can_compile():
            return self._code.problem()
        return ''

    @property
    def is_kept(self) -> bool:
        """Whether the code is on disk."""
        return self._code.is_kept

    def of_robots(self, values: Values) -> Values:
        """Return the other values."""
        return {name: each for name, each in values.items() if not is_own(name)}

    def rows(
        self, rows: RobotRows, values: Values, count: int, first: int
    ) -> Sequence[ProgramRows]:
        """Return the programs, each made once for all runs for which it is equal."""
        check_loads(rows[ControllerParameters], first, self._loaded.tasks)
        columns = {
            name: column.tolist()
            for name, column in values.items()
            if is_own(name) or CONTROLLER in robot_parameter(name).nodes
        }
        names = {name: split_element(name)[0].partition('.')[2] for name in columns}
        read = {names[name] for name in filter(is_own, columns)}  # and settings, as they are read

        def distinction(of_run: Mapping[str, object]) -> str:
            # Unlike the values, a text tells -0.0 from 0.0.
            return repr([each for name, each in of_run.items() if names[name] in read])

        controllers: list[LawController[Any]] = []
        numbers: dict[str, int] = {}
        of_runs = list[int]()
        for run in range(count):
            of_run = {name: column[run] for name, column in columns.items()}
            if distinction(of_run) not in numbers:
                with naming_run(first + run):
                    controllers.append(self._controller(of_run, read))
                numbers[distinction(of_run)] = len(controllers) - 1
            of_runs.append(numbers[distinction(of_run)])
        codes = list(map(self._code_of, controllers))
        programs, begin = list[ProgramRows](), 0
        for code, alike in groupby(of_runs, codes.__getitem__):
            used, places = np.unique(list(alike), return_inverse=True)
            constants = rows_of([controllers[each].in_force for each in used])
            states = list(map(initial_state, (controllers[each] for each in used)))
            of_states = places if len(set(states)) > 1 else slice(1)
            own = constants[places], rows_of(states)[of_states]
            programs.append(ProgramRows(begin, code, *own))
            begin += len(places)
        return programs

    def _code_of(self, controller: LawController[Any]) -> Callable[..., Any]:
        """Return the code of a controller: others may have other numbers of states or constants."""
        kinds = kinds_of(controller)
        if kinds not in self._codes:
            if len(self._codes) == MOST_CODES:
                raise CompilationError('the runs differ too often in their states or constants')
            self._codes[kinds] = LawCode(controller).compile()
        return self._codes[kinds]

    def _controller(self, values: Mapping[str, object], read: set[str]) -> LawController[Any]:
        """Return a controller, and add the names of the settings that it reads."""
        parameters = with_values(self._spec.parameters, values)
        loaded = self._loaded
        compose_controller(parameters, loaded)
        settings, watched = parameters.of(ControllerParameters), parameters.of(_Settings)
        object.__setattr__(watched, 'read', read)
        controller = loaded.cls(user_parameters(loaded, settings), design_model(settings), watched)
        assert isinstance(controller, LawController)
        return controller


@contextmanager
def naming_run(number: int) -> Iterator[None]:
    """Add the number of a run to an error's message."""
    try:
        yield
    except BallbotError as error:
        raise StudyError(f'{error} (run {number})') from None


def check_loads(controllers: Rows, first: int, own_tasks: Sequence[TaskTiming] = ()) -> None:
    """Raise StudyError if the processor of a robot, counted from `first`, can't bear its tasks."""
    columns = controllers.view(np.recarray)
    load = sum(processor_load(columns, own_tasks))
    is_late = columns.link_time > columns.interrupt_time
    for run in np.flatnonzero(columns.kernel & ((load > 1.0) | is_late)).tolist():
        with naming_run(first + run):
            check_load(columns[run], own_tasks)


def is_own(target: str) -> bool:
    """Return whether ``node.param`` is a parameter of the class of a controller."""
    return target.startswith((f'{CONTROLLER}.{USER}', f'{CONTROLLER}.{MODEL}'))


def programs_of(spec: RunSpec) -> Programs | None:
    """Return the programs of a specification's runs; None if they can never be compiled."""
    if spec.parameters.of(ControllerParameters).implementation == 'python':
        return Programs()
    loaded = _loaded_controller(spec)
    return _Laws(spec, loaded) if loaded and has_law(loaded.cls) else None


def _loaded_controller(spec: RunSpec) -> LoadedController | None:
    """Return the controller of a specification, which may have only its name; None for the C."""
    return compose_controller(with_values(spec.parameters, {}), spec.controller)


def may_hang(spec: RunSpec) -> bool:
    """Return whether a run of a specification may need a process that can be ended."""
    programs = programs_of(spec)
    return programs is None or programs.are_users or bool(programs.problem())


def why_not_compiled(spec: RunSpec) -> str:
    """Return why a specification's runs are not compiled, on one line; '' if they are."""
    programs = programs_of(spec)
    if programs is not None:
        return programs.problem()
    if loaded := _loaded_controller(spec):
        return f'{loaded.cls.__name__} has no law, see docs/controllers.md'
    return 'the generated C is no function on numbers'


def with_values(parameters: ParameterSet, values: Mapping[str, object]) -> ParameterSet:
    """Return parameters with other values for some, by ``node.param`` or element of it."""
    changed = ParameterSet(parameters)
    if any(map(is_own, values)):
        changed.drop_designed()  # so that it is designed from them
    assign_values(changed, whole_values(changed, plain_values(values)))
    return changed
