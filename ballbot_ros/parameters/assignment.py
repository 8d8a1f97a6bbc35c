"""Assignments of parameters: ``node.param=value``, or values by ``node.param``."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from ballbot_ros.parameters.parameter import ParameterError
from ballbot_ros.parameters.parameter_set import ParameterSet
from ballbot_ros.parameters.table import ALL_NODES, parameters_of
from ballbot_ros.yaml_document import parse_value

Parameters = Mapping[str, object] | str | os.PathLike[str]
"""Values of parameters by ``node.param``, such as ``{'plant_sim.body_mass': 0.6}``, or a file."""


def assign(parameters: ParameterSet, assignment: str) -> None:
    """Set the parameter that an assignment names, such as ``controller.k_thetadot=300``.

    Raises
    ------
    ParameterError
        If the text is malformed, or node, name or value are not allowed.
    """
    target, equals, text = assignment.partition('=')
    node, dot, name = target.partition('.')
    if not (equals and dot and node and name):
        raise ParameterError(f'--set {assignment}: not of the form node.param=value')
    row = parameters_of(node).get(name) if node in ALL_NODES else None
    is_text = row is not None and isinstance(row.default, str)
    value = text if is_text else parse_value(text)
    parameters.set(node, name, value, f'--set {assignment}')


def assign_values(parameters: ParameterSet, values: Mapping[str, object]) -> None:
    """Set parameters to values by ``node.param``, such as ``{'controller.k_thetadot': 300}``.

    Raises
    ------
    ParameterError
        If a node, name or value is not allowed.
    """
    for target, value in values.items():
        node, dot, name = target.partition('.')
        if not (dot and node and name):
            raise ParameterError(f'{target!r} is not of the form node.param')
        parameters.set(node, name, value)


def plain_values(given: Mapping[str, object]) -> dict[str, object]:
    """Return values by ``node.param`` without numpy's types, see :func:`plain_value`."""
    return {str(name): plain_value(value) for name, value in given.items()}


def plain_value(value: Any) -> Any:
    """Return numbers and arrays of numpy as the numbers and lists that parameters are made of."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return [plain_value(each) for each in value] if isinstance(value, list | tuple) else value
