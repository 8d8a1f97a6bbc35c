"""Parameter files in ROS format, for nodes and for runs without ROS."""

from __future__ import annotations

import os
from collections.abc import Container, Hashable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ballbot_ros.errors import os_errors
from ballbot_ros.parameters.controller import is_own
from ballbot_ros.parameters.parameter import ParameterError, Value
from ballbot_ros.parameters.parameter_set import ALL_NODES, NODES, ParameterSet, parameters_of
from ballbot_ros.parameters.yaml_document import YamlDocument, parse_value, yaml_text


def read_parameter_file(path: str | Path) -> ParameterSet:
    """Read a file of ``node: {ros__parameters: {name: value}}``; ``/**`` means every node.

    It raises YamlError or ParameterError if the file is not YAML or is malformed, or a parameter is
    unknown or has an invalid value. The message is one line, and names file and line.
    """
    document = YamlDocument(path)
    parameters = ParameterSet()
    for node, body in _mapping(document, document.data).items():
        names = _mapping(document, body, node)
        unknown = set(names) - {'ros__parameters'}
        if unknown or not names:
            raise ParameterError(
                f'{document.where(node)}: {node!r} must contain ros__parameters and nothing else'
            )
        values = _mapping(document, names['ros__parameters'], node, 'ros__parameters')
        target = '/**' if node == '/**' else str(node).removeprefix('/**/').strip('/')
        for keys, name, value in leaves(values):
            where = document.where(node, 'ros__parameters', *keys)
            parameters.set(target, name, value, where)
    return parameters


def leaves(
    values: Mapping[Any, object], *above: Hashable
) -> Iterator[tuple[tuple[Hashable, ...], str, object]]:
    """Yield keys, name and value of each parameter; a name with dots may be nested mappings."""
    for key, value in values.items():
        keys = (*above, key)
        name = '.'.join(map(str, keys))
        if isinstance(value, dict) and value and is_own(f'{name}.'):
            yield from leaves(value, *keys)
        else:
            yield keys, name, value


def _mapping(document: YamlDocument, data: object, *keys: Hashable) -> dict[Hashable, object]:
    if not isinstance(data, dict):
        what = ' '.join(map(repr, keys)) or 'the file'
        raise ParameterError(f'{document.where(*keys)}: {what} is not a mapping (`key: value`)')
    return data


def write_parameter_file(
    path: str | Path, parameters: ParameterSet, nodes: Iterable[str] = NODES
) -> None:
    """Write all parameters of `nodes` as :func:`read_parameter_file` reads them.

    It raises ParameterError if the file can't be written.
    """
    with os_errors(ParameterError, path):
        Path(path).write_text(format_parameters(parameters, nodes), encoding='utf-8')


def format_parameters(
    parameters: ParameterSet, nodes: Iterable[str] = NODES, names: Container[str] | None = None
) -> str:
    """Return the text of a parameter file with all parameters of `nodes`, or those of `names`."""
    return values_text({
        node: {
            name: value
            for name, value in parameters.of_node(node).values().items()
            if names is None or name in names
        }
        for node in nodes
    })  # fmt: skip


def values_text(values: Mapping[str, Mapping[str, Value]]) -> str:
    """Return the text of a parameter file with values by name, by node."""
    content = {
        f'/**/{node}': {
            'ros__parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in of_node.items()
            }
        }
        for node, of_node in values.items()
    }
    return yaml_text(content, has_inner_lines=False)


Parameters = Mapping[str, object] | str | os.PathLike[str]
"""Values of parameters by ``node.param``, such as ``{'plant_sim.body_mass': 0.6}``, or a file."""


def assign(parameters: ParameterSet, assignment: str) -> None:
    """Set the parameter that an assignment names, such as ``controller.k_thetadot=300``.

    It raises ParameterError if the text is malformed, or node, name or value are not allowed.
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

    It raises ParameterError if a node, name or value is not allowed.
    """
    for target, value in values.items():
        node, dot, name = target.partition('.')
        if not (dot and node and name):
            raise ParameterError(f'{target!r} is not of the form node.param')
        parameters.set(node, name, value)


def plain_values(given: Mapping[str, object]) -> dict[str, object]:
    """Return values by ``node.param`` without numpy's types, see :func:`plain_value`."""
    return {str(name): plain_value(value) for name, value in given.items()}


def plain_value(value: object) -> Any:
    """Return numbers and arrays of numpy as the numbers and lists that parameters are made of."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return [plain_value(each) for each in value] if isinstance(value, list | tuple) else value
