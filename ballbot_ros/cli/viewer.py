"""What commands with a viewer find out before anything starts."""

from __future__ import annotations

from ballbot_ros.parameters import VIEWER, ParameterSet
from ballbot_ros.viewer.address import check_address, require_viser
from ballbot_ros.viewer.errors import ViewerError


def require_viewer(parameters: ParameterSet, processes: str = 'separate') -> None:
    """Find out whether the page can be served beside a run.

    Raises
    ------
    ViewerError
        If viser is missing, the port is taken, or the nodes are not processes of their own.
    """
    if processes != 'separate':
        raise ViewerError(f'--viewer goes with --processes separate, not {processes}')
    require_viser()
    values = parameters.values(VIEWER)
    check_address(values['host'], values['port'])
