"""Checks, before anything starts, that everything is installed that a run needs."""

from __future__ import annotations

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.middleware import require_middleware
from ballbot_ros.parameters import ParameterSet, ViewerParameters
from ballbot_ros.run.spec import Processes


def require_rclpy(otherwise: str = '') -> None:
    """Find out whether there is ROS.

    Parameters
    ----------
    otherwise : str
        What to do without it, as the end of the error's line.

    Raises
    ------
    BallbotError
        If rclpy can't be imported, or the middleware that is wanted does not load.
    """
    require_middleware()
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        raise BallbotError(
            f'ROS 2 not found ({error}): source ROS 2 Jazzy, install "ballbot_ros[ros]"{otherwise}'
        ) from None


def require_viewer(parameters: ParameterSet, processes: Processes = Processes.SEPARATE) -> None:
    """Find out whether the page can be served next to a run.

    Raises
    ------
    ViewerError
        If viser is missing, the port is taken, or the nodes are not processes of their own.
    """
    # Here, so that commands without a viewer start sooner.
    from ballbot_ros.viewer.address import check_address, require_viser
    from ballbot_ros.viewer.errors import ViewerError

    if processes is not Processes.SEPARATE:
        raise ViewerError(f'--viewer goes with --processes separate, not {processes}')
    require_viser()
    viewer = parameters.of(ViewerParameters)
    check_address(viewer.host, viewer.port)
