"""The arrangements of processes of a run, and what has to be installed for each."""

from __future__ import annotations

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.middleware import require_middleware
from ballbot_ros.parameters import ParameterSet, ViewerParameters
from ballbot_ros.parameters.parameter import TextEnum


class Processes(TextEnum):
    """How the nodes of a run are distributed over processes."""

    SEPARATE = 'separate'
    ONE = 'one'
    NONE = 'none'
    """No nodes: the closed loop without ROS."""


OR_NONE = ', or use --processes none'
"""Alternative of a run."""


def require_rclpy(alternative: str = '') -> None:
    """Raise BallbotError if rclpy can't be imported, or the selected middleware does not load.

    The message ends with an `alternative` without ROS.
    """
    require_middleware()
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        raise ros_not_found(str(error), alternative) from None


def ros_not_found(error: str, alternative: str = '') -> BallbotError:
    """Return the error of a command that needs ROS."""
    return BallbotError(
        f'ROS 2 not found ({error}): source ROS 2 Jazzy, or run '
        f'`pip install "ballbot_ros[ros]"`{alternative}'
    )


def require_viewer(parameters: ParameterSet, processes: Processes = Processes.SEPARATE) -> None:
    """Raise ViewerError if viser is missing, the port is in use, or the nodes are not separate."""
    # Imported here, so that commands without a viewer start faster.
    from ballbot_ros.errors import ViewerError
    from ballbot_ros.viewer.address import check_address, require_viser

    if processes is not Processes.SEPARATE:
        raise ViewerError(f'--viewer requires --processes separate, not {processes}')
    require_viser()
    viewer = parameters.of(ViewerParameters)
    check_address(viewer.host, viewer.port)
