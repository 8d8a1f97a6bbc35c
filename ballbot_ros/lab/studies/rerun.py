"""A run of a study once more, as a full run."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np

from ballbot_ros.controllers.codegen.implementation import compose_controller
from ballbot_ros.controllers.loading import is_installed
from ballbot_ros.engine.scenario.reader import load_scenario
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.engine.scenario.writer import scenario_data
from ballbot_ros.errors import StudyError, short_text
from ballbot_ros.lab.studies.events import fault_values, is_event, scenarios_of
from ballbot_ros.lab.studies.manifest import StudyRecord
from ballbot_ros.lab.studies.programs import with_values
from ballbot_ros.lab.studies.study_data import RunResults, StudyData
from ballbot_ros.lab.studies.variables import SEED, WITHOUT_EFFECT
from ballbot_ros.parameters import (
    CONTROLLER,
    DOCUMENTS_PROGRAM,
    NODES,
    ControllerParameters,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.files import format_parameters, read_parameter_file
from ballbot_ros.parameters.yaml_document import parse_value, yaml_text
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

RERUNS = 'reruns'
"""Name of the folder of the runs that were run again, in the study's folder."""

PARAMETER_FILE = 'parameters.yaml'
_OF_A_RUN = ('scenario', 'device', 'output', 'attachments', 'trajectory_file')


def parameter_text(parameters: ParameterSet) -> str:
    """Return the text of a parameter file with all values that a run does not set itself."""
    names = {name for node in NODES for name in parameters.of_node(node).values()}
    return format_parameters(parameters, NODES, names.difference(_OF_A_RUN))


def new_folder(study: Path, number: int) -> Path:
    """Return a folder for a run in the folder of its study; it does not exist yet."""
    folder, attempt = study / RERUNS / str(number), 1
    while folder.exists():
        attempt += 1
        folder = study / RERUNS / f'{number}_{attempt}'
    return folder


def choose_run(data: StudyData, number: int | None, worst: str | None) -> RunResults:
    """Return a run by its number, or the worst one of a measure; else the first not to pass.

    It raises StudyError if there is no such run or measure.
    """
    if number is None and worst is not None:
        number = next((each.number for each in data.worst(worst, 1)), None)
        if number is None:
            raise StudyError(f'{data.path}: no run has a value of {worst}')
    elif number is None:
        number = next(data.not_passed(), None)
        if number is None:
            raise StudyError(f'{data.path}: all runs passed')
    return data.row(number)


def study_parameters(
    record: StudyRecord, path: Path, controller: str | None = None
) -> ParameterSet:
    """Return the parameters of a study, with those of its scenario's file for what varies.

    It raises BallbotError if the run is not possible here.

    Parameters
    ----------
    path : Path
        A file to be written, for the scenario; the parameters are written next to it.
    controller : str, optional
        The user's reference to the study's controller. The files of a study can come from anyone,
        so by themselves they only select an installed controller.
    """
    parameter_file = path.with_name(PARAMETER_FILE)
    path.write_text(record.scenario, encoding='utf-8')
    parameter_file.write_text(record.parameters, encoding='utf-8')
    if controller is None:
        parameters = load_scenario(str(path)).parameters
        parameters.update(read_parameter_file(parameter_file))
        reference = parameters.of(ControllerParameters).implementation
        if reference not in DOCUMENTS_PROGRAM and not is_installed(reference):
            raise StudyError(
                f'the controller of the study {record.name} is {short_text(reference)}, which is '
                'not installed as a controller: name it by --controller of the command study rerun'
            )
    options = RunOptions(
        processes=Processes.NONE, parameter_file=parameter_file, controller=controller
    )
    return RunSpec.of_scenario(str(path), options).parameters


def rerun_spec(
    record: StudyRecord,
    row: RunResults,
    folder: Path,
    processes: Processes,
    controller: str | None = None,
) -> RunSpec:
    """Return a run of a study, ready to execute; for `controller` see :func:`study_parameters`.

    Its scenario and parameters are written into a new folder, which gets its recording, too; the
    command ``ballbot run SCENARIO --params PARAMETERS`` then is the run. It raises BallbotError if
    the folder can't be written, or the run is not possible here.
    """
    path = folder / f'{record.name}_{row.number}.yaml'
    parameter_file = folder / PARAMETER_FILE
    options = RunOptions(
        processes=processes, parameter_file=parameter_file, output=folder.resolve()
    )
    try:
        folder.mkdir(parents=True)
        parameters = study_parameters(record, path, controller)
        scenario = _scenario(path, row)
        values = {name: value for name, value in row.varied.items() if not is_event(name)}
        faults = fault_values(scenario, load_scenario(str(path)))
        changed = with_values(parameters, {**values, SEED: row.seed, **faults})
        compose_controller(changed)
        parameter_file.write_text(parameter_text(changed), encoding='utf-8')
        text = yaml_text(scenario_data(scenario, changed.of(PlantParameters)))
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise StudyError(f'{folder}: {error.strerror}; choose another --output') from None
    return RunSpec.of_scenario(str(path), options)


def scenario_spec(
    record: StudyRecord,
    row: RunResults,
    folder: Path,
    processes: Processes,
    controller: str | None = None,
) -> tuple[Path, RunSpec]:
    """Return a run of a study as :func:`rerun_spec` does, and the one file that has all of it.

    The command ``ballbot run SCENARIO`` then is the run.
    """
    rerun_spec(record, row, folder, processes, controller)
    path = folder / f'{record.name}_{row.number}.yaml'
    parameter_file = folder / PARAMETER_FILE
    usual = load_scenario(str(path)).parameters
    given = read_parameter_file(parameter_file)
    changed: dict[str, dict[str, Any]] = {}
    for node, name, value in given:
        if name not in WITHOUT_EFFECT and usual.of_node(node).values()[name] != value:
            changed.setdefault(node, {})[name] = list(value) if isinstance(value, tuple) else value
    if given.undeclared:
        changed.setdefault(CONTROLLER, {}).update(given.undeclared)
    data = cast('dict[str, Any]', parse_value(path.read_text(encoding='utf-8')))
    own: dict[str, Any] = data.get('parameters', {})
    for node, values in changed.items():
        own[node] = {**own.get(node, {}), **values}
    if own:
        data['parameters'] = own
    path.write_text(yaml_text(data), encoding='utf-8')
    parameter_file.unlink()
    options = RunOptions(processes=processes, output=folder.resolve())
    return path, RunSpec.of_scenario(str(path), options)


def _scenario(path: Path, row: RunResults) -> Scenario:
    """Return the study's scenario, in a file, with the pushes, sticks and faults of a run."""
    scenario = load_scenario(str(path))
    events = {name: np.array([value]) for name, value in row.varied.items() if is_event(name)}
    return scenarios_of(scenario, events, np.array([np.inf]), row.number)[0] if events else scenario
