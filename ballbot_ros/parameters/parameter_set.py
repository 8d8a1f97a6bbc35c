"""Parameter values of all nodes, checked when they are set."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from ballbot_ros.parameters.parameter import NodeParameters, ParameterError, Value
from ballbot_ros.parameters.table import ALL_NODES, CLASSES, parameters_of, suggest_names

_Node = TypeVar('_Node', bound=NodeParameters)


class ParameterSet:
    """A value for every parameter of every node; unset ones have their defaults."""

    def __init__(self) -> None:
        self._values: dict[tuple[str, str], Value] = {}

    def __iter__(self) -> Iterator[tuple[str, str, Value]]:
        """Yield node, name and value of all parameters that were set."""
        for (node, name), value in self._values.items():
            yield node, name, value

    def set(self, node: str, name: str, value: object, where: str = '') -> None:
        """Set `name` of `node`, or for ``'/**'`` of every node that has it.

        Raises
        ------
        ParameterError
            If the node or the parameter is unknown, or the value is not allowed; the message begins
            with `where`, such as a file and line, or an option.
        """
        prefix = f'{where}: ' if where else ''
        if node == '/**':
            nodes = [known for known in ALL_NODES if name in parameters_of(known)]
            if not nodes:
                raise ParameterError(f'{prefix}no node has a parameter {name!r}')
        elif node in ALL_NODES:
            nodes = [node]
        else:
            raise ParameterError(f'{prefix}unknown node {node!r}; known: {", ".join(ALL_NODES)}')
        for each in nodes:
            row = parameters_of(each).get(name)
            if row is None:
                raise ParameterError(
                    f'{prefix}{each} has no parameter {name!r}; {suggest_names(name, each)}'
                )
            checked = row.check(value, f'{prefix}{each}.')
            # Set a shared parameter in all nodes that share it: they must agree on its value.
            for sharer in row.nodes:
                self._values[sharer, name] = checked

    def is_set(self, node: str, name: str) -> bool:
        """Return whether a parameter was set, rather than left at its default."""
        return (node, name) in self._values

    def update(self, other: ParameterSet) -> None:
        """Apply everything that was set in `other`."""
        self._values.update(other._values)

    def of(self, cls: type[_Node]) -> _Node:
        """Return the parameters of the node whose parameter class is `cls`."""
        given = {name: value for (node, name), value in self._values.items() if node == cls.node}
        return cls(**given)

    def of_node(self, node: str) -> NodeParameters:
        """Return the parameters of a node by its name."""
        return self.of(CLASSES[node])
