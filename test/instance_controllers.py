"""Controllers that tests pass as classes or instances.

A process of a study imports this module, which therefore imports little.
"""

from dataclasses import dataclass

from ballbot_ros.controllers import Controller, quantity


@dataclass(frozen=True)
class Gains:
    """The parameters of the controllers below."""

    duty: float = quantity(0.0, '%', (-100, 100), 'duty')


class Constant(Controller[Gains]):
    """Returns its parameter, from 1 s on."""

    def tick(self, readings):
        return (round(self.parameters.duty) if readings.elapsed_ms >= 1000 else 0), 0


class Failing(Controller):
    """Fails at 0.4 s."""

    def tick(self, readings):
        return 1 // (400 - readings.elapsed_ms), 0


class FailingAtOnce(Controller):
    """Fails at its first tick."""

    def tick(self, readings):
        raise RuntimeError('no')


class Hanging(Controller):
    """Does not return at 0.4 s."""

    def tick(self, readings):
        while readings.elapsed_ms == 400:
            pass
        return 0, 0
