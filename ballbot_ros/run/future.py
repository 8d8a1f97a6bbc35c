"""What is different in a branch of a recorded run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeAlias

from ballbot_ros.analysis.recorded_scenario import scheduled_pushes
from ballbot_ros.controllers.loading import public_reference, resolve_reference
from ballbot_ros.engine.scenario.reader import STICK_LIMIT, read_push
from ballbot_ros.engine.scenario.scenario import Scenario, ScheduledPush
from ballbot_ros.errors import ScenarioError, short_repr
from ballbot_ros.parameters import CONTROLLER, ParameterError, Value, value_text
from ballbot_ros.parameters.changes import checked_change
from ballbot_ros.robot.brick.bluetooth import Sticks
from ballbot_ros.robot.brick.faults import Fault, parse_faults

RECORDED: Literal['recorded'] = 'recorded'
"""The sticks of a branch that goes on with those of the recorded run."""

HeldSticks: TypeAlias = Sticks | Literal['recorded']
"""The sticks (vertical, horizontal) that are held, or :data:`RECORDED`."""

Names: TypeAlias = tuple[str, str, str, str]

DEFAULT_PUSH_S = 0.1
"""How long a push lasts, unless it says something else."""


@dataclass(frozen=True, kw_only=True)
class Future:
    """What is different in a branch; its pushes and faults are further ones.

    Attributes
    ----------
    at : float
        From when on, in seconds from the start of the run.
    values : mapping of str to Value
        New values of the controller's parameters, by name.
    sticks : tuple of int or 'recorded'
        The sticks (vertical, horizontal) that are held, or those of the recorded run go on.
    controller : str or None
        Reference to the controller that takes over; it has run along from the start, so that it
        knows the robot.
    is_live : bool
        Whether the user drives, in real time, until the run is stopped.
    names : tuple of str
        What errors call pushes, faults, values and sticks.
    """

    at: float
    pushes: tuple[ScheduledPush, ...] = ()
    faults: tuple[Fault, ...] = ()
    values: Mapping[str, Value] = field(default_factory=dict)
    sticks: HeldSticks = RECORDED
    controller: str | None = None
    is_live: bool = False
    names: Names = ('--push', '--fault', '--set', '--sticks')

    @property
    def told(self) -> tuple[str, ...]:
        """What it changes, as texts."""
        told = [
            f'push {each.strength}, {each.start:.3f} s to {each.end:.3f} s'
            for each in scheduled_pushes(Scenario(pushes=self.pushes))
        ]
        told += [f'fault {each}' for each in self.faults]
        told += [
            f'{CONTROLLER}.{name} = {value_text(value)}' for name, value in self.values.items()
        ]
        if self.sticks != RECORDED and not self.is_live:
            told.append(f'sticks {self.sticks[0]}, {self.sticks[1]}')
        if self.controller:
            told.append(f'{public_reference(self.controller)} takes over')
        if self.is_live:
            told.append('driven by hand')
        return tuple(told)


def given_future(
    at: float,
    *,
    pushes: Iterable[Mapping[str, object]],
    faults: str,
    values: Mapping[str, object],
    sticks: object,
    controller: str | None,
    names: Names,
) -> Future:
    """Return the future that somebody asks for.

    It raises BallbotError if one of them is not valid; the message is one line.

    Parameters
    ----------
    at : float
        Its beginning, and that of pushes and faults without a time [s].
    pushes : iterable of mapping
        As in a scenario; by default they last for 0.1 s.
    faults : str
        As in a parameter `faults`.
    values : mapping of str to object
        By ``controller.param``.
    names : tuple of str
        What errors call pushes, faults, values and sticks.
    """
    push_name, fault_name, value_name, stick_name = names
    return Future(
        at=at,
        names=names,
        pushes=tuple(
            read_push({'time': at, 'duration': DEFAULT_PUSH_S, **each}, push_name)
            for each in pushes
        ),
        faults=_faults(faults, at, fault_name),
        values=_values(values, value_name),
        sticks=_sticks(sticks, stick_name),
        controller=controller and resolve_reference(controller, Path.cwd()),
    )


def _faults(text: str, at: float, name: str) -> tuple[Fault, ...]:
    try:
        return tuple(
            fault if 'time=' in entry else replace(fault, time=at)
            for entry in text.split(';')
            for fault in parse_faults(entry)
        )
    except ParameterError as error:
        raise ParameterError(f'{name}: {error}') from None


def _values(given: Mapping[str, object], name: str) -> dict[str, Value]:
    values: dict[str, Value] = {}
    for target, value in given.items():
        node, _, parameter = target.partition('.')
        if node != CONTROLLER or not parameter:
            raise ParameterError(
                f'{name}: {target} is not of the form {CONTROLLER}.param; nothing else can change '
                'during a run'
            )
        values[parameter] = checked_change(parameter, value, f'{name}: ')
    return values


def _sticks(given: object, name: str) -> HeldSticks:
    if given == RECORDED:
        return RECORDED
    match given:
        case (int(vertical), int(horizontal)) if max(abs(vertical), abs(horizontal)) <= STICK_LIMIT:
            return vertical, horizontal
    raise ScenarioError(
        f'{name}: {short_repr(given)} is not {RECORDED}, neutral, or two whole numbers within '
        f'-{STICK_LIMIT} … {STICK_LIMIT}, such as -100,0'
    )
