"""The shipped scenarios and profiles, and scenarios from the user's files."""

from __future__ import annotations

from pathlib import Path

from ballbot_ros.engine.scenario.reader import IDEAL, ScenarioReader
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.errors import ScenarioError, did_you_mean
from ballbot_ros.files import share_directory
from ballbot_ros.parameters import ParameterSet
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.parameters.yaml_document import YamlDocument


def scenario_names() -> list[str]:
    """Return the names of the shipped scenarios."""
    return sorted(path.stem for path in (share_directory() / 'config/scenarios').glob('*.yaml'))


def load_scenario(
    name_or_file: str, profile: str | None = None, map_file: Path | None = None
) -> Scenario:
    """Load a shipped scenario by its name, or a file by its path.

    `profile` is a device profile to use instead of the scenario's, and `map_file` an image to read
    instead of any that the scenario names.

    Raises
    ------
    ScenarioError, YamlError, ParameterError
        The message is one line that names file, line, key, and what is allowed.
    """
    shipped = share_directory() / 'config/scenarios' / f'{name_or_file}.yaml'
    if name_or_file in scenario_names():
        path = shipped
    elif name_or_file.endswith(('.yaml', '.yml')) or '/' in name_or_file:
        path = Path(name_or_file)
    else:
        raise ScenarioError(
            f'unknown scenario {name_or_file!r}{did_you_mean(name_or_file, scenario_names())}; '
            f'shipped: {", ".join(scenario_names())} '
            '(for your own scenario, give the path of its file, ending in .yaml)'
        )
    return ScenarioReader(YamlDocument(path), load_profile, map_file).scenario(profile)


def scenario_of(name_or_file: str) -> Scenario:
    """Load a scenario as :func:`load_scenario` does, or for '' return one without any events."""
    return load_scenario(name_or_file) if name_or_file else Scenario()


def load_profile(name: str) -> ParameterSet:
    """Return the values that the profile `name` sets; ``ideal`` sets none and keeps the defaults.

    Raises
    ------
    ScenarioError
        If the profile does not exist.
    """
    if name == IDEAL:
        return ParameterSet()
    folder = share_directory() / 'config/profiles'
    known = [IDEAL, *[path.stem for path in sorted(folder.glob('*.yaml'))]]
    if name not in known:
        hint = did_you_mean(name, known)
        raise ScenarioError(f'unknown profile {name!r}{hint}; known: {", ".join(known)}')
    return read_parameter_file(folder / f'{name}.yaml')
