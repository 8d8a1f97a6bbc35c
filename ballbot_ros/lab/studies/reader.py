"""Reading study files; every error message names file and line."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, ClassVar, cast

from ballbot_ros.controllers.design.redesign import LIMITS, OPTIONS, SIGNALS, Method, Redesign
from ballbot_ros.controllers.loading import public_reference, resolve_reference
from ballbot_ros.engine.rows import robot_parameter
from ballbot_ros.engine.scenario.metrics import METRICS
from ballbot_ros.engine.scenario.properties import OF_MOTION, Property
from ballbot_ros.engine.scenario.reader import (
    Keys,
    load_profile,
    load_scenario,
    scenario_names,
    window_fault,
)
from ballbot_ros.engine.scenario.scenario import Expectation
from ballbot_ros.errors import BallbotError, StudyError, short_repr
from ballbot_ros.files import read_text, shipped_names
from ballbot_ros.lab.studies.columns import OTHERS
from ballbot_ros.lab.studies.events import event_part, extreme_scenarios, is_event
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.lab.studies.study import (
    CASE,
    GAINS,
    K_F,
    MAX_RUNS,
    Sampling,
    Study,
    grid_shape,
    nearest_grid,
)
from ballbot_ros.lab.studies.variables import (
    CONE_RAYS,
    DURATION,
    GRID,
    LIST,
    SEED,
    DistributionReader,
    Levels,
    Variable,
    find_variable,
    fixed_identities,
    identity,
)
from ballbot_ros.parameters import (
    CONTROLLER,
    DOCUMENTS_PROGRAM,
    PLANT,
    ControllerParameters,
    ParameterSet,
    PlantParameters,
    suggest,
)
from ballbot_ros.parameters.files import leaves
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.parameters.yaml_document import YamlDocument, is_yaml_path
from ballbot_ros.robot.brick.faults import WORDS, Fault, all_faults, fault_texts
from ballbot_ros.robot.world.floor_map import is_file_name
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

STUDY_KEYS = frozenset({
    'purpose', 'scenario', 'profile', 'controller', 'parameters', 'faults', 'runs', 'repeats',
    'seed', 'sampling', 'vary', 'redesign', 'metrics', 'expectations', 'properties',
})  # fmt: skip
MAX_SEED = 2**63 - 1
MAX_HYPERCUBE = 20_000_000
"""Largest number of numbers in a Latin hypercube, which is kept as a whole."""

_HOLD_TIME = f'{PLANT}.hold_time'
_IMPLEMENTATION = f'{CONTROLLER}.implementation'
_PEAK = 'peak_pitch_deg'
_CLEARANCE = 'wall_clearance_m'


class StudyReader(DistributionReader):
    """Reads and checks one document; for the other arguments see :func:`read_studies`."""

    what: ClassVar[str] = 'the study'
    keys: ClassVar[frozenset[str]] = STUDY_KEYS
    error_class: ClassVar[type[BallbotError]] = StudyError

    def __init__(
        self,
        document: YamlDocument,
        runs: int | None = None,
        seed: int | None = None,
        controller: str | None = None,
        parameter_file: Path | None = None,
    ) -> None:
        super().__init__(document)
        for option, value, low, high in (('runs', runs, 1, MAX_RUNS), ('seed', seed, 0, MAX_SEED)):
            if value is not None and not low <= value <= high:
                raise StudyError(f'--{option} {value}: not within {low} … {high}')
        self._runs = runs
        self._seed = seed
        self._controller = controller
        self._parameter_file = parameter_file

    def studies(self) -> Iterator[Study]:
        """Yield the study in the document, or that of each of its scenarios and controllers.

        It raises BallbotError; the message is one line that names file and line.
        """
        data = self._content()
        if self._controller is not None and isinstance(data.get('controller'), list):
            data['controller'] = [self._controller]
        for required in ('purpose', 'scenario'):
            if required not in data:
                raise self._error((), f'{required} is missing')
        self._check_lines_of_text(data, ('purpose', 'profile'))
        keys = [each for each in CASE if isinstance(data.get(each), list) and data[each]]
        for words in product(*(cast('list[object]', data[each]) for each in keys)):
            case = {**data, **dict(zip(keys, words, strict=True))}
            self._check_lines_of_text(case, CASE)
            yield self._study(case).of_several() if keys else self._study(case)

    def _content(self) -> dict[str, object]:
        """Return the keys of a study with their values."""
        return dict(self._mapping(self._document.data, (), self.keys))

    def _study(self, data: Mapping[str, object]) -> Study:
        fixed, values = self._fixed(data.get('parameters', {}))
        if 'controller' in data and _IMPLEMENTATION in values:
            raise self._error(('controller',), f'{_IMPLEMENTATION} is also set by parameters')
        options = self._options(data, values)
        reference = self._scenario(str(data['scenario']), data)
        spec = self._spec(reference, data, options)
        sampling = self._sampling(data.get('sampling', Sampling.RANDOM.value))
        fixed_keys = fixed_identities(fixed)
        variables = self._variables(data.get('vary', {}), spec, fixed_keys, sampling)
        redesign = self._redesign(data, spec, {*values, *(each.name for each in variables)})
        seed_key = identity(SEED, robot_parameter(SEED))
        varied_keys = {identity(each.name, each.parameter) for each in variables}
        draws_seeds = seed_key not in varied_keys | fixed_keys
        if not (variables or draws_seeds):
            raise self._error(('vary',), f'nothing varies: {SEED} is fixed, too')
        plant = _shortest(spec.plant, variables)
        self._check_events(spec, variables, plant.duration)
        expectations = self._study_expectations(data, spec, plant)
        if sampling is Sampling.GRID and self._runs is not None:
            variables = tuple(nearest_grid(variables, self._runs, repeats=draws_seeds))
        runs = self._number_of_runs(data, sampling, variables, draws_seeds)
        if sampling is Sampling.LATIN_HYPERCUBE and runs * len(variables) > MAX_HYPERCUBE:
            raise self._error(
                ('sampling',),
                f'a Latin hypercube has at most {MAX_HYPERCUBE} numbers, runs times variables; '
                'use sobol',
            )
        return Study(
            name=self._document.path.stem,
            purpose=str(data['purpose']),
            text=read_text(self._document.path),
            runs=runs,
            seed=self._seed_of(data),
            sampling=sampling,
            variables=variables,
            draws_seeds=draws_seeds,
            metrics=self._metrics(data, spec, expectations),
            expectations=expectations,
            properties=self._study_properties(data, spec),
            spec=spec,
            redesign=redesign,
        )

    @contextmanager
    def _naming(self, *keys: Hashable) -> Iterator[None]:
        """Add file and line to the message of an error."""
        try:
            yield
        except BallbotError as error:
            raise self._error(keys, str(error)) from None

    def _beside(self, name: str) -> str:
        """Return a path that is one from the study's folder."""
        return str((self._document.path.parent / name).resolve())

    def _redesign(
        self, data: Mapping[str, object], spec: RunSpec, given: Collection[str]
    ) -> Redesign | None:
        """Return how gains are designed; `given` are the names of what is set or varies."""
        if 'redesign' not in data:
            return None
        key = 'redesign'
        content = data[key] if isinstance(data[key], dict) else {'method': data[key]}
        methods = Method.LQR, Method.DLQR
        method = cast('dict[str, object]', content).get('method')
        if method not in methods:
            raise self._error(
                (key,), f'{key}: {short_repr(method)} is not one of {", ".join(methods)}'
            )
        options = dict(self._mapping(content, (key,), ('method', *OPTIONS[Method(method)])))
        controller = spec.parameters.of(ControllerParameters).implementation
        if controller not in DOCUMENTS_PROGRAM:
            other = public_reference(controller)
            raise self._error((key,), f"{key}: {other} is not the document's program")
        if taken := sorted({K_F, *GAINS}.intersection(given)):
            raise self._error((key,), f'{key}: {taken[0]} is designed for each robot: omit it')
        numbers: dict[str, Any] = {}
        for option, value in options.items():
            if option == 'q':
                numbers[option] = weights = tuple(self._each(value, (key, option), self._weight))
                if len(weights) != SIGNALS:
                    text = f'q: {SIGNALS} numbers are needed, not {len(weights)}'
                    raise self._error((key, option), text)
            elif option != 'method':
                numbers[option] = self._weight(value, (key, option))
        return Redesign(Method(str(method)), **numbers)

    def _weight(self, value: object, keys: Keys) -> float:
        """Return a number of a design."""
        number, limit = self._number(value, keys), LIMITS[str(keys[1])]
        if not limit.is_allowed(number):
            raise self._error(keys, f'{keys[1]}: {number:g} is not {limit.wanted}')
        return number

    def _check_events(self, spec: RunSpec, variables: Sequence[Variable], end: float) -> None:
        """Refuse pushes, sticks and faults that a run could not have."""
        names = {each.name for each in variables}
        for kind in sorted(each for each in names if is_event(each) and each.endswith('.kind')):
            if not names.isdisjoint(kind.replace('.kind', f'.{word}') for word in WORDS):
                raise self._error(('vary', kind), f'{kind} is a component and its type')
        varied = [
            (event_part(each.name, spec.scenario), each.distribution)
            for each in variables
            if is_event(each.name)
        ]
        words = [
            [(part, (word, word)) for word in each.levels]
            for part, each in varied
            if isinstance(each, Levels) and isinstance(each.levels[0], str)
        ]
        ends = [(part, each.ends) for part, each in varied]
        faults: dict[Fault, None] = {}
        with self._naming('vary'):
            for chosen in product(*words):
                for each in extreme_scenarios(spec.scenario, [*ends, *chosen], end):
                    faults |= dict.fromkeys(each.faults)
            all_faults(_with_faults(spec, faults).parameters.of)

    def _fixed(self, data: object) -> tuple[ParameterSet, dict[str, object]]:
        """Return the fixed parameters, and their values by ``node.param``."""
        fixed = ParameterSet()
        values: dict[str, object] = {}
        folder = self._document.path.parent
        for node, content in self._mapping(data, ('parameters',)).items():
            for inner, name, value in leaves(self._mapping(content, ('parameters', node))):
                keys = ('parameters', node, *inner)
                if name == 'scenario':
                    raise self._error(keys, 'a study cannot set the parameter scenario')
                if name == 'implementation' and isinstance(value, str):
                    value = resolve_reference(value, folder)
                if name == 'map' and isinstance(value, str) and is_file_name(value):
                    value = self._beside(value)
                fixed.set(str(node), name, value, self._document.where(*keys))
                values[f'{node}.{name}'] = value
        return fixed, values

    def _options(self, data: Mapping[str, object], values: Mapping[str, object]) -> RunOptions:
        profile, controller = self._profile(data), data.get('controller')
        if profile is not None:
            with self._naming('profile'):
                load_profile(profile)
        if self._controller is not None:
            controller = resolve_reference(self._controller, Path.cwd())
        elif controller is not None:
            controller = resolve_reference(str(controller), self._document.path.parent)
        return RunOptions(
            processes=Processes.NONE,
            profile=profile,
            values=values,
            parameter_file=self._parameter_file,
            controller=controller,
            record=False,
        )

    def _profile(self, data: Mapping[str, object]) -> str | None:
        """Return the device profile, if there is one; a path is one from the study's folder."""
        profile = data.get('profile')
        if isinstance(profile, str) and is_yaml_path(profile):
            return self._beside(profile)
        return None if profile is None else str(profile)

    def _scenario(self, reference: str, data: Mapping[str, object]) -> str:
        """Return the name of a shipped scenario unchanged, or the path of a file."""
        if reference not in scenario_names() and is_yaml_path(reference):
            reference = self._beside(reference)
        with self._naming('scenario'):
            load_scenario(reference, self._profile(data))
        return reference

    def _spec(self, reference: str, data: Mapping[str, object], options: RunOptions) -> RunSpec:
        # The scenario alone is valid.
        with self._naming('controller' if 'controller' in data else 'parameters'):
            spec = RunSpec.of_scenario(reference, options)
        return _with_faults(spec, self._faults(data, spec.plant.duration))

    def _sampling(self, value: object) -> Sampling:
        known = [each.value for each in Sampling]
        if value not in known:
            raise self._error(
                ('sampling',), f'sampling: {value!r} is not one of {", ".join(known)}'
            )
        return Sampling(value)

    def _variables(
        self,
        data: object,
        spec: RunSpec,
        fixed: Collection[Hashable],
        sampling: Sampling,
    ) -> tuple[Variable, ...]:
        variables: dict[Hashable, Variable] = {}
        for key, content in self._mapping(data, ('vary',)).items():
            variable = self._variable(str(key), content, ('vary', key), spec)
            self._check_sampling(content, ('vary', key), sampling)
            same = identity(variable.name, variable.parameter)
            if same in fixed:
                raise self._error(('vary', key), f'{key} is also fixed by parameters')
            if same in variables:
                raise self._error(
                    ('vary', key), f'{key} is the same parameter as {variables[same].name}'
                )
            variables[same] = variable
        return tuple(variables.values())

    def _variable(
        self, name: str, data: object, keys: tuple[Hashable, ...], spec: RunSpec
    ) -> Variable:
        with self._naming(*keys):
            parameter = find_variable(name, spec)
        variable = Variable(name, parameter, self._distribution(data, keys, parameter))
        low, _ = variable.distribution.ends
        if name == DURATION and low < TICK_S:
            raise self._error(keys, f'{name}: a run must last at least {TICK_S:g} s')
        if name == CONE_RAYS:
            levels = variable.distribution
            if not isinstance(levels, Levels) or not all(each % 2 for each in levels.levels):
                raise self._error(keys, f'{name}: needs a list of odd numbers')
        if is_event(name) and name.endswith('.duration') and low == 0.0:
            raise self._error(keys, f'{name}: a push must last longer than 0 s')
        return variable

    def _check_sampling(self, data: object, keys: tuple[Hashable, ...], sampling: Sampling) -> None:
        given = self._mapping(data, keys)
        if sampling is Sampling.GRID and not (GRID in given or LIST in given):
            raise self._error(keys, f'{keys[-1]}: sampling grid needs {GRID} or {LIST}')
        if sampling is not Sampling.GRID and GRID in given:
            raise self._error(
                (*keys, GRID), f'{keys[-1]}: {GRID} needs `sampling: grid`; this is {sampling}'
            )

    def _number_of_runs(
        self,
        data: Mapping[str, object],
        sampling: Sampling,
        variables: tuple[Variable, ...],
        draws_seeds: bool,
    ) -> int:
        if sampling is Sampling.GRID:
            return self._runs_of_grid(data, prod(grid_shape(variables)), draws_seeds)
        if 'repeats' in data:
            raise self._error(('repeats',), 'repeats is only for `sampling: grid`; give runs')
        if 'runs' in data:
            given = self._whole(data['runs'], ('runs',), 1, MAX_RUNS)
            return given if self._runs is None else self._runs
        if self._runs is None:
            raise self._error((), 'runs is missing')
        return self._runs

    def _runs_of_grid(self, data: Mapping[str, object], points: int, draws_seeds: bool) -> int:
        if 'runs' in data:
            raise self._error(
                ('runs',), f'the grid has {points} points: give repeats instead of runs'
            )
        repeats = self._whole(data.get('repeats', 1), ('repeats',), 1, MAX_RUNS)
        if self._runs is not None:
            repeats = max(1, round(self._runs / points))
        if repeats > 1 and not draws_seeds:
            raise self._error(('repeats',), f'repeats would be equal: {SEED} is given')
        if points * repeats > MAX_RUNS:
            raise self._error(('vary',), f'{points * repeats} runs are more than {MAX_RUNS}')
        return points * repeats

    def _seed_of(self, data: Mapping[str, object]) -> int:
        given = self._whole(data.get('seed', 1), ('seed',), 0, MAX_SEED)
        return given if self._seed is None else self._seed

    def _whole(self, value: object, keys: tuple[Hashable, ...], low: int, high: int) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self._error(
                keys, f'{keys[-1]}: {short_repr(value)} is not a whole number, {low} … {high}'
            )
        return value

    def _study_expectations(
        self, data: Mapping[str, object], spec: RunSpec, plant: PlantParameters
    ) -> tuple[Expectation, ...]:
        if 'expectations' in data:
            return tuple(self._expectations(data['expectations'], plant))
        for expectation in spec.scenario.expectations:
            if fault := window_fault(expectation, plant):
                raise self._error(
                    ('scenario',), f"{fault}: give `expectations` in place of the scenario's"
                )
        return spec.scenario.expectations

    def _study_properties(self, data: Mapping[str, object], spec: RunSpec) -> tuple[Property, ...]:
        found = spec.scenario.properties
        if 'properties' in data or 'expectations' in data:  # its own requirements
            given = data.get('properties', {})
            found = self._properties(given, spec.plant, spec.scenario.events)
        for each in found:
            known = *OF_MOTION, *OTHERS
            if missing := next((name for name in each.signals if name not in known), ''):
                keys = ('properties', each.name) if 'properties' in data else ('scenario',)
                raise self._error(
                    keys, f'{each.name!r}: studies lack {missing}; known: {", ".join(known)}'
                )
        return found

    def _metrics(
        self, data: Mapping[str, object], spec: RunSpec, expectations: tuple[Expectation, ...]
    ) -> tuple[str, ...]:
        if 'metrics' not in data:
            return tuple(dict.fromkeys([*(each.metric for each in expectations), _PEAK]))
        names: list[str] = []
        listed = self._each(data['metrics'], ('metrics',), lambda each, _: each)
        for index, given in enumerate(listed):
            keys = ('metrics', index)
            name = given if isinstance(given, str) else short_repr(given)
            if name not in METRICS:
                raise self._error(keys, f'unknown metric {name!r}; {suggest(name, METRICS)}')
            if name == _CLEARANCE and not spec.plant.map:
                raise self._error(keys, f'{name} needs a map')
            if name in names:
                raise self._error(keys, f'{name} is doubled')
            names.append(name)
        if not names:
            raise self._error(('metrics',), 'metrics: the list is empty')
        return tuple(names)


def _with_faults(spec: RunSpec, faults: Collection[Fault]) -> RunSpec:
    """Return a run with further faults."""
    texts = fault_texts((*all_faults(spec.parameters.of), *faults))
    values = {f'{node}.faults': text for node, text in texts.items() if faults}
    scenario = replace(spec.scenario, faults=(*spec.scenario.faults, *faults))
    return replace(spec, scenario=scenario, parameters=with_values(spec.parameters, values))


def _shortest(plant: PlantParameters, variables: tuple[Variable, ...]) -> PlantParameters:
    """Return the parameters of the plant with the shortest run and the latest release."""
    for each in variables:
        if each.name == DURATION:
            plant = replace(plant, duration=float(each.distribution.ends[0]))
        elif each.name == _HOLD_TIME:
            plant = replace(plant, hold_time=float(each.distribution.ends[1]))
    return plant


def study_names() -> list[str]:
    """Return the names of the shipped studies."""
    return shipped_names('studies')


def read_study(reference: str, **options: Any) -> Study:
    """Read a study, as :func:`read_studies`; of several scenarios or controllers the first."""
    return next(read_studies(reference, **options))


def read_studies(
    reference: str,
    runs: int | None = None,
    seed: int | None = None,
    controller: str | None = None,
    parameter_file: Path | None = None,
) -> Iterator[Study]:
    """Read a shipped study by its name, or a file by its path; a study for each case.

    Parameters
    ----------
    runs : int or None
        Number of runs in place of the file's; for a grid about this number, by other levels.
    seed : int or None
        Seed of the samples in place of the file's.
    controller : str or None
        Controller in place of the file's.
    parameter_file : Path or None
        File of parameters whose values take the place of the study's.

    Raises
    ------
    BallbotError
        The message is one line that names file, line, key, and what is allowed.
    """
    document = YamlDocument.named(reference, 'studies', 'study', StudyError)
    return StudyReader(document, runs, seed, controller, parameter_file).studies()
