"""Parameter files in ROS format, for nodes and for runs without ROS."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import asdict
from pathlib import Path

import yaml

from ballbot_ros.parameters.parameter import ParameterError
from ballbot_ros.parameters.parameter_set import ParameterSet
from ballbot_ros.parameters.table import NODES, parameters_of
from ballbot_ros.yaml_document import YamlDocument


def read_parameter_file(path: str | Path) -> ParameterSet:
    """Read a file of ``node: {ros__parameters: {name: value}}``; ``/**`` means every node.

    Raises
    ------
    YamlError, ParameterError
        If the file is not YAML or is malformed, or a parameter is unknown or has an invalid value.
        The message is one line, and names file and line.
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
        for name, value in values.items():
            where = document.where(node, 'ros__parameters', name)
            parameters.set(str(node).removeprefix('/**/').strip('/') if node != '/**' else node,
                           str(name), value, where)  # fmt: skip
    return parameters


def _mapping(document: YamlDocument, data: object, *keys: Hashable) -> dict[Hashable, object]:
    if not isinstance(data, dict):
        what = ' '.join(map(repr, keys)) or 'the file'
        raise ParameterError(f'{document.where(*keys)}: {what} is not a mapping (`key: value`)')
    return data


def write_parameter_file(
    path: str | Path, parameters: ParameterSet, nodes: Iterable[str] = NODES
) -> None:
    """Write all parameters of `nodes`, in the format of :func:`read_parameter_file`.

    Raises
    ------
    ParameterError
        If the file can't be written.
    """
    try:
        Path(path).write_text(format_parameters(parameters, nodes), encoding='utf-8')
    except OSError as error:
        raise ParameterError(f'{path}: {error.strerror}') from None


def format_parameters(parameters: ParameterSet, nodes: Iterable[str] = NODES) -> str:
    """Return the text of a parameter file with all parameters of `nodes`."""
    content = {
        f'/**/{node}': {
            'ros__parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in asdict(parameters.of_node(node)).items()
            }
        }
        for node in nodes
        if parameters_of(node)
    }
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, default_flow_style=None)
