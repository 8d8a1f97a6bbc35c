"""A control program whose parameters change on the way."""

from __future__ import annotations

from copy import deepcopy

from ballbot_ros.controllers.codegen.implementation import Implementation
from ballbot_ros.parameters import Value
from ballbot_ros.parameters.changes import PendingChanges


class TunedProgram:
    """A program of an implementation, and the changes of its parameters in a run.

    The present `parameters` are those that it has, or that it glides to.
    """

    def __init__(self, implementation: Implementation, changes: PendingChanges) -> None:
        self._implementation, self.parameters = implementation, implementation.parameters
        self.program, self.changes = implementation.make(), changes

    def copy(self) -> TunedProgram:
        """Return an object in the same state, which goes on by itself.

        It raises TypeError if the program is one that can't be copied, such as a process.
        """
        implementation = self._implementation
        shared = {id(each): each for each in (implementation, implementation.loaded)}
        return deepcopy(self, shared)

    def advance(self, now_ns: int) -> dict[str, Value]:
        """Let the program take over what changes at the tick at `now_ns` [ns]; return what is new.

        It raises ParameterError if a parameter can't change during a run of this program, or not to
        this value.
        """
        values = self.changes.due(now_ns)
        if not values:
            return {}
        before = self.parameters.values()
        self.parameters = self._implementation.changed(self.parameters, values)
        after = self.parameters.values()
        new = {name: after[name] for name in values if after[name] != before[name]}
        if new:
            self.program.retune(self.parameters)
        return new
