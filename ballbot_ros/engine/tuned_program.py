"""A control program whose parameters change on the way."""

from __future__ import annotations

from ballbot_ros.controllers.codegen.implementation import Implementation
from ballbot_ros.parameters import Value
from ballbot_ros.parameters.changes import PendingChanges


class TunedProgram:
    """A program of an implementation, and the changes of its parameters in a run.

    Attributes
    ----------
    program : Program
    changes : PendingChanges
    """

    def __init__(self, implementation: Implementation, changes: PendingChanges) -> None:
        self._implementation, self._parameters = implementation, implementation.parameters
        self.program, self.changes = implementation.make(), changes

    def advance(self, now_ns: int) -> dict[str, Value]:
        """Let the program take over what changes at the tick at `now_ns` [ns].

        Returns
        -------
        dict of str to Value
            The values that are new, by name.

        Raises
        ------
        ParameterError
            If a parameter can't change during a run of this program, or not to this value.
        """
        values = self.changes.due(now_ns)
        if not values:
            return {}
        before = self._parameters.values()
        self._parameters = self._implementation.changed(self._parameters, values)
        after = self._parameters.values()
        new = {name: after[name] for name in values if after[name] != before[name]}
        if new:
            self.program.retune(self._parameters)
        return new
