"""The choice of the control program that replays a recorded run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ballbot_ros.controllers.loading import OUR_PACKAGE
from ballbot_ros.parameters import DOCUMENTS_PROGRAM
from ballbot_ros.simulation.participants import Participant

PYTHON = 'python'


@dataclass(frozen=True)
class ReplayedController:
    """The control program that stands in for a recorded one.

    Both are values of the parameter `implementation`; a foreign recorded controller has its
    announced name. The reason says why they differ; empty if they don't, or if one was requested.
    A controller that is not portable may compute other duties on another machine.
    """

    recorded: str
    replayed: str
    reason: str = ''
    is_portable: bool = True


def choose_controller(
    participant: Participant | None,
    attached: str,
    requested: str | None,
    missing_tool: Callable[[str], str],
) -> ReplayedController:
    """Return the program for a replay of the document's: the requested, or else the recorded one.

    Python replaces an implementation that can't run here, since the two are proven bit-identical.
    `participant` is the run's controller as announced, if known; `attached` is the parameter
    `implementation` in the attached parameters. `missing_tool` returns the tool that an
    implementation lacks on this machine; '' for none.
    """
    parameters: dict[str, object] = dict(participant.parameters) if participant else {}
    recorded = str(parameters.get('implementation', attached))
    reason = ''
    if participant and participant.is_foreign:
        recorded = participant.implementation
        reason = (
            f'its controller {recorded!r} is not part of {OUR_PACKAGE}, whose own controller '
            'replays it'
        )
    elif recorded not in DOCUMENTS_PROGRAM:
        reason = f'this version does not know its controller {recorded!r}; {PYTHON} replays it'
    elif missing := missing_tool(recorded):
        reason = (
            f'its controller {recorded!r} cannot run here: {missing}; {PYTHON}, which is proven '
            'equal, replays it'
        )
    if requested:
        return ReplayedController(recorded, requested)
    return ReplayedController(recorded, PYTHON if reason else recorded, reason)
