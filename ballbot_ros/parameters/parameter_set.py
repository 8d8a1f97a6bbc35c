"""Values for the parameters of every node, checked as they are set."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from ballbot_ros.parameters.parameter import NodeParameters, ParameterError, Value
from ballbot_ros.parameters.table import ALL_NODES, CLASSES, nearest, parameters_of

_Node = TypeVar('_Node', bound=NodeParameters)


class ParameterSet:
    """A value for every parameter of every node; unset ones have the table's default."""

    def __init__(self) -> None:
        self._values: dict[tuple[str, str], Value] = {}

    def __iter__(self) -> Iterator[tuple[str, str, Value]]:
        """Yield node, name and value of everything that was set."""
        for (node, name), value in self._values.items():
            yield node, name, value

    def set(self, node: str, name: str, value: object, where: str = '') -> None:
        """Set `name` of `node`, or of every node that has it where `node` is ``'/**'``.

        Raises
        ------
        ParameterError
            If the node or the parameter is unknown, or the value is not allowed; `where` (a
            file and line) begins the message.
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
                    f'{prefix}{each} has no parameter {name!r}; {nearest(name, each)}'
                )
            checked = row.check(value, f'{prefix}{each}.')
            # A shared parameter is one value: its nodes must never disagree.
            for sharer in row.nodes:
                self._values[sharer, name] = checked

    def is_set(self, node: str, name: str) -> bool:
        """Tell whether a parameter was set, rather than left at its default."""
        return (node, name) in self._values

    def update(self, other: ParameterSet) -> None:
        """Take over everything that was set in `other`."""
        self._values.update(other._values)

    def of(self, cls: type[_Node]) -> _Node:
        """Return the parameters of the node that `cls` describes."""
        given = {name: value for (node, name), value in self._values.items() if node == cls.node}
        return cls(**given)

    def of_node(self, node: str) -> NodeParameters:
        """Return the parameters of the node with a name."""
        return self.of(CLASSES[node])
