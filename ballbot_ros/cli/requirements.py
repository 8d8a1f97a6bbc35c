"""What a command finds out before anything starts: whether all that it needs is there."""

from __future__ import annotations

from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import CONTROLLER, VIEWER, ParameterSet


def require_rclpy(otherwise: str = '') -> None:
    """Find out whether there is ROS.

    Parameters
    ----------
    otherwise : str
        What to do without it, as the end of the error's line.

    Raises
    ------
    BallbotError
        If rclpy can't be imported.
    """
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        raise BallbotError(
            f'ROS 2 is not there ({error}): source ROS 2 Jazzy, install '
            f'"ballbot_ros[ros]"{otherwise}'
        ) from None


def require_toolchain(parameters: ParameterSet) -> None:
    """Find out whether the controller can be built.

    Raises
    ------
    CodegenError
        If a tool is missing; the Debian package is named.
    """
    implementation = parameters.values(CONTROLLER)['implementation']
    if implementation != 'python':
        from ballbot_ros.codegen.toolchain import TARGETS, require_tools

        require_tools(TARGETS[implementation])


def require_viewer(parameters: ParameterSet, processes: str = 'separate') -> None:
    """Find out whether the page can be served beside a run.

    Raises
    ------
    ViewerError
        If viser is missing, the port is taken, or the nodes are not processes of their own.
    """
    # Here, so that commands without a viewer start sooner.
    from ballbot_ros.viewer.address import check_address, require_viser
    from ballbot_ros.viewer.errors import ViewerError

    if processes != 'separate':
        raise ViewerError(f'--viewer goes with --processes separate, not {processes}')
    require_viser()
    values = parameters.values(VIEWER)
    check_address(values['host'], values['port'])
