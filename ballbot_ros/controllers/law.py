"""Controllers whose law is a function on numbers, which studies compile."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from dataclasses import fields
from functools import cache
from typing import Any, ClassVar

from ballbot_ros.controllers.controller import Controller, Duty, P, Readings
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.robot.plant.model import PhysicalParameters

Law = Callable[[Any, Any, Readings], tuple[Any, Duty]]
"""Returns the next state and the duty for constants, a state, and the readings of a tick."""


class LawController(Controller[P]):
    """A controller whose law is a function on numbers: subclass it, and set `law`.

    The same function runs here and, compiled, in studies: then several hundred times as fast, with
    the same duties. It calls only functions of numbers, of its own module and of this package, and
    those of ``math``.

    Attributes
    ----------
    law : callable
        ``law(constants, state, readings) -> (state, duty)``. It must not depend on anything else.
    state, in_force : named tuple
        The state after the newest tick, and the constants.
    """

    law: ClassVar[Law]

    @classmethod
    def initial_state(cls, constants: Any) -> Any:
        """Return the state before the first tick as a named tuple.

        It has numbers, switches, tuples and named tuples of them; the law returns the same types.
        """
        raise NotImplementedError

    @classmethod
    def constants(cls, parameters: P, model: PhysicalParameters, _: ControllerParameters) -> Any:
        """Return the constants of the law as a named tuple; by default the own parameters.

        Parameters
        ----------
        parameters, model, _ : object
            As the attributes `parameters`, `model` and `settings` of :class:`Controller`.
        """
        return as_numbers(parameters)

    def start(self) -> None:
        """Set the initial state."""
        self._set_constants()
        self.state = self.initial_state(self.in_force)

    def retune(self, parameters: P, settings: ControllerParameters) -> None:
        """Take over values that change during the run."""
        super().retune(parameters, settings)
        self._set_constants()

    def _set_constants(self) -> None:
        self.in_force = self.constants(self.parameters, self.model, self.settings)

    def tick(self, readings: Readings) -> Duty:
        """Return the duty for the readings of a tick."""
        before = self.state
        self.state, duty = type(self).law(self.in_force, before, readings)
        self.report(before, readings)
        return duty

    def report(self, before: Any, readings: Readings) -> None:
        """Publish what the state tells: estimates, operating state, tones, log; nothing by default.

        It is called after each tick of a run, but not in studies, so no duty may depend on it.

        Parameters
        ----------
        before : named tuple
            The state before the tick; the one after it is `self.state`.
        """


def as_numbers(parameters: Any) -> Any:
    """Return a dataclass as a named tuple of its numbers and switches, without its texts."""
    values = {
        each.name: value
        for each in fields(parameters)
        if not isinstance(value := getattr(parameters, each.name), str)
    }
    return _numbers_class(type(parameters).__name__, tuple(values))(**values)


@cache
def _numbers_class(name: str, members: tuple[str, ...]) -> Any:
    return namedtuple(name, members)
