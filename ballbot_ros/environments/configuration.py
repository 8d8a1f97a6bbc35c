"""The parameters of an environment."""

from __future__ import annotations

import os
from collections.abc import Mapping

from ballbot_ros.environments.errors import EnvironmentConfigurationError
from ballbot_ros.parameters import (
    GYRO,
    PLANT,
    ControllerParameters,
    EncoderParameters,
    GyroParameters,
    ParameterError,
    ParameterSet,
    PlantParameters,
    SonarParameters,
)
from ballbot_ros.parameters.assignment import assign_values, plain_value
from ballbot_ros.parameters.controller import is_own
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.scenario.library import load_profile
from ballbot_ros.scenario.reader import IDEAL
from ballbot_ros.timing import TICK_MS

Parameters = Mapping[str, object] | str | os.PathLike[str]
"""Values of parameters by ``node.param``, or a file, as for ``ballbot_ros.simulate``."""

STEPS_MS = (TICK_MS, 5 * TICK_MS)
"""The periods that an environment can have [ms]."""

MAX_DURATION_S = 1e5

CLASSES = (
    PlantParameters, GyroParameters, EncoderParameters, SonarParameters, ControllerParameters,
)  # fmt: skip
"""The nodes whose parameters have an effect."""

_NODES = {cls.node for cls in CLASSES}
_OF_AN_EPISODE = {
    f'{GYRO}.seed': 'the seed or the options of reset',
    f'{SonarParameters.node}.seed': 'the seed or the options of reset',
    f'{PLANT}.start_pitch_x': 'the options of reset',
    f'{PLANT}.start_pitch_y': 'the options of reset',
    f'{PLANT}.duration': 'the argument duration',
}


def parameters_of_environment(profile: str | None, given: Parameters | None) -> ParameterSet:
    """Return the parameters of a device profile with other values for some.

    Raises
    ------
    BallbotError
        If a profile, file or value is not valid, or a value has no effect.
    """
    parameters = ParameterSet()
    parameters.update(load_profile(IDEAL if profile is None else profile))
    if isinstance(given, Mapping):
        values = {str(name): plain_value(value) for name, value in given.items()}
        _check_effect(values)
        assign_values(parameters, values)
    elif given is not None:
        parameters.update(read_parameter_file(os.fspath(given)))
    return parameters


def _check_effect(values: Mapping[str, object]) -> None:
    for target in values:
        if target in _OF_AN_EPISODE:
            raise ParameterError(f'{target} has no effect here: use {_OF_AN_EPISODE[target]}')
        node, _, name = target.partition('.')
        if is_own(name) or (node and name and node not in _NODES and node != '/**'):
            raise ParameterError(
                f'{target} has no effect here; only the parameters of {", ".join(sorted(_NODES))}'
            )


def check_step(step_ms: int) -> int:
    """Return the period of an environment [ms]; refuse one that it can't have."""
    if isinstance(step_ms, bool) or step_ms not in STEPS_MS:
        allowed = ' or '.join(map(str, STEPS_MS))
        raise EnvironmentConfigurationError(f'step_ms: {step_ms!r} is not {allowed}')
    return int(step_ms)


def steps_of(duration: float, step_ms: int) -> int:
    """Return the number of steps in an episode of `duration` [s]."""
    try:
        in_bounds = step_ms / 1000.0 <= duration <= MAX_DURATION_S
    except TypeError:
        in_bounds = False
    if not in_bounds or isinstance(duration, bool):
        raise EnvironmentConfigurationError(
            f'duration: {duration!r} is not within {step_ms / 1000.0:g} … {MAX_DURATION_S:g} s'
        )
    return round(duration * 1000.0 / step_ms)


def fingerprint(parameters: ParameterSet) -> tuple[tuple[str, object], ...]:
    """Return the values of all parameters that have an effect and are the same in all episodes."""
    return tuple(
        (target, value)
        for cls in CLASSES
        for name, value in parameters.of(cls).values().items()
        if (target := f'{cls.node}.{name}') not in _OF_AN_EPISODE
    )
