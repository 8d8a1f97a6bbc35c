"""Which control program a recorded run is replayed with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ballbot_ros.parameters import CONTROLLER, parameters_of
from ballbot_ros.simulation.participants import Participant

PYTHON = 'python'
OUR_PACKAGE = 'ballbot_ros'


@dataclass(frozen=True)
class ReplayedController:
    """The control program that takes the place of a recorded one.

    Attributes
    ----------
    recorded : str
        What made the recording: a value of the parameter `implementation`, or of somebody else's
        controller what it said that it is.
    replayed : str
        A value of the parameter `implementation`.
    reason : str
        Why it is not the one that made the recording; empty if it is, or was asked for.
    """

    recorded: str
    replayed: str
    reason: str = ''


def choose_controller(
    participant: Participant | None,
    attached: str,
    asked: str | None,
    missing_tool: Callable[[str], str],
) -> ReplayedController:
    """Return what a run is replayed with: what was asked for, else what made the recording.

    Python stands in for what can't run here: the implementations are proven equal to the bit.

    Parameters
    ----------
    participant : Participant or None
        The run's controller as it announced itself; None where the recording does not tell.
    attached : str
        The parameter `implementation` as the recording has it attached.
    asked : str or None
        The implementation that the user wants.
    missing_tool : callable
        Tells what an implementation lacks on this machine; '' for nothing.
    """
    told: dict[str, object] = dict(participant.parameters) if participant else {}
    recorded = str(told.get('implementation', attached))
    reason = ''
    if participant and participant.implementation.split()[:1] != [OUR_PACKAGE]:
        recorded = participant.implementation
        reason = (
            f'the controller that made it, {recorded!r}, is not part of {OUR_PACKAGE}, whose own '
            'replays it'
        )
    elif recorded not in parameters_of(CONTROLLER)['implementation'].choices:
        reason = f'this version does not know its controller {recorded!r}; {PYTHON} replays it'
    elif missing := missing_tool(recorded):
        reason = (
            f'its controller {recorded!r} can not run here: {missing}; {PYTHON}, which is proven '
            'equal, replays it'
        )
    if asked:
        return ReplayedController(recorded, asked)
    return ReplayedController(recorded, PYTHON if reason else recorded, reason)
