"""Settings of the middleware before ROS starts, and who is in a ROS domain on this machine.

Each participant of a domain has a number, which determines its ports (RTPS 2.5, 9.6.2.3).
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

from ballbot_ros.errors import BallbotError, one_line, os_errors
from ballbot_ros.files import make_folder, share_directory
from ballbot_ros.lockstep.participants import LocalNode
from ballbot_ros.nodes.processes import END_WITH_PARENT

LOCK_FD_ENV = 'BALLBOT_DOMAIN_LOCK'
"""Environment variable: file descriptor of a lock inherited from the starting process."""


class DomainLock:
    """Lock held for the lifetime of a plant; the system releases it however the plant ends.

    It detects plants of any user on this machine at once; plants on other machines are found by
    discovery, which takes time. A process that starts a plant takes the lock first and passes it
    on, so that no other plant can start in between.

    It is a Unix socket with an abstract name; `file` is its descriptor. Such a name has no place in
    the file system, so it does not depend on environment variables and no file can be in its way.
    Its scope is the network namespace, which is also that of the middleware's ports.

    It raises BallbotError if another plant, player or link to a brick holds the lock.
    """

    def __init__(self, domain: int) -> None:
        if inherited_fd := os.environ.get(LOCK_FD_ENV):
            self.file = int(inherited_fd)
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as name:
            try:
                name.bind(f'\0ballbot_ros_plant_{domain}')
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
                raise BallbotError(
                    f'another plant, player or brick_link is running in ROS domain {domain}: wait '
                    'for its end, or set ROS_DOMAIN_ID to another number'
                ) from None
            self.file = name.detach()

    def __enter__(self) -> DomainLock:
        return self

    def __exit__(self, *error: object) -> None:
        self.release()

    def release(self) -> None:
        """Release the domain for another plant."""
        os.close(self.file)


PORT_BASE, PORTS_PER_DOMAIN, PORTS_PER_PARTICIPANT = 7400, 250, 2
DISCOVERY_PORT, USER_PORT = 10, 11
"""Offsets of a participant's own ports from the base port of its domain."""


_READING_SIZES = 31 * 128, 29 * 128, 23 * 128


def _sockets(table: str) -> set[str]:
    """Return the lines of a table of the system: ``udp`` or ``unix``.

    The system counts off the sockets for each part that is read, so one that is closed meanwhile
    hides that with which the next part begins. Other sizes of the parts show the hidden one.
    """
    return {line for size in _READING_SIZES for line in _read_sockets(table, size)}


def _read_sockets(table: str, size: int) -> list[str]:
    """Return the lines of a table, read in parts of a size [byte]."""
    with Path('/proc/net', table).open('rb', buffering=0) as file:
        return (
            b''.join(iter(lambda: file.read(size), b'')).decode(errors='replace').splitlines()[1:]
        )


def bound_udp_ports() -> set[int]:
    """Return the UDP ports (IPv4) that processes on this machine have bound."""
    return {int(line.split()[1].rpartition(':')[2], 16) for line in _sockets('udp')}


def living_participants(domain: int) -> list[int]:
    """Return the numbers of a domain's participants on this machine.

    A participant binds two ports. Other programs may be assigned one of them beyond domain 101.
    """
    bound = bound_udp_ports()
    base = PORT_BASE + PORTS_PER_DOMAIN * domain
    firsts = range(base + DISCOVERY_PORT, base + PORTS_PER_DOMAIN, PORTS_PER_PARTICIPANT)
    to_user = USER_PORT - DISCOVERY_PORT
    return [number for number, port in enumerate(firsts) if {port, port + to_user} <= bound]


class Presence:
    """Shows that a participant lives; the system removes it however its process ends.

    Like :class:`~ballbot_ros.nodes.middleware.DomainLock` it is a Unix socket with an abstract
    name.
    """

    def __init__(self, domain: int, namespace: str, role: str, instance: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind('\0' + _name(domain, namespace, role, str(os.getpid()), instance))

    def close(self) -> None:
        """Remove it."""
        self._socket.close()


def present_nodes(domain: int, namespace: str) -> dict[str, LocalNode]:
    """Return the participants on this machine in a domain and namespace, by their instances."""
    pattern = f'@{_name(domain, namespace, "([a-z_]+)", "([0-9]+)", "([0-9a-f]+)")}$'
    found = (re.search(pattern, line) for line in _sockets('unix'))
    return {each[3]: LocalNode(each[1], int(each[2])) for each in found if each}


def _name(domain: int, namespace: str, role: str, process: str, instance: str) -> str:
    # The name of a socket has at most 107 bytes, and a namespace may be longer.
    short = hashlib.sha256(namespace.encode()).hexdigest()[:8]
    return f'ballbot_ros_participant_{domain}_{short}_{role}_{process}_{instance}'


PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'
"""Environment variable: Fast DDS's profiles. Other middleware ignores it."""

DISCOVERY_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
LOCAL, NETWORK, AS_IN_PROFILES = 'LOCALHOST', 'SUBNET', 'SYSTEM_DEFAULT'
LOCALHOST_ONLY = 'ROS_LOCALHOST_ONLY'
"""Environment variable: the older way to set the range LOCALHOST, which rcl still prefers."""

LOOPBACK = '127.0.0.1'
MAX_PARTICIPANTS = 32
"""Participants of a domain that find each other on one machine, see ``fastdds_local.xml``."""

STATIC_PEERS = 'ROS_STATIC_PEERS'
"""Environment variable: hosts whose nodes are discovered in any range."""

RMW = 'RMW_IMPLEMENTATION'
LOG_FOLDER = 'ROS_LOG_DIR'
"""Environment variable: folder of the nodes' logs."""

DEFAULT_RMW = 'rmw_fastrtps_cpp'
FAST_DDS = ('', DEFAULT_RMW, 'rmw_fastrtps_dynamic_cpp')
DOMAIN = 'ROS_DOMAIN_ID'
"""Environment variable: number of the domain."""

MAX_DOMAIN_ID = 232
"""The last domain that has ports; beyond it, the middleware ends the process."""


def ros_domain() -> int:
    """Return the number of the ROS domain; BallbotError if :data:`DOMAIN` is not a valid one."""
    text = os.environ.get(DOMAIN) or '0'
    if not re.fullmatch('0|[1-9][0-9]{0,2}', text) or int(text) > MAX_DOMAIN_ID:
        raise BallbotError(f'{DOMAIN}={text}: set a number within 0 … {MAX_DOMAIN_ID}')
    return int(text)


def require_middleware() -> None:
    """Raise BallbotError if the chosen middleware does not load, with which rcl would exit."""
    name = os.environ.get(RMW, DEFAULT_RMW)
    if name in ('', DEFAULT_RMW):
        return
    script = 'import importlib.util as u; u.find_spec("rclpy") and __import__("rclpy")'
    if subprocess.run([sys.executable, '-c', script], capture_output=True, check=False).returncode:
        raise BallbotError(f'{RMW}={name} does not load: install it, or unset the variable')


def stay_local() -> None:
    """Limit discovery to this machine, unless the user has set a range."""
    os.environ.setdefault(DISCOVERY_RANGE, LOCAL)


def is_local() -> bool:
    """Return whether discovery is limited to this machine."""
    reach = os.environ.get(DISCOVERY_RANGE)
    if os.environ.get(LOCALHOST_ONLY) == '1':
        return True
    if reach == AS_IN_PROFILES:
        return os.environ.get(PROFILES) == _profiles(LOCAL)
    return reach == LOCAL and not os.environ.get(STATIC_PEERS)


def require_discovery() -> None:
    """Raise BallbotError if the environment switches discovery off."""
    if os.environ.get(DISCOVERY_RANGE) == 'OFF':
        raise BallbotError(f'{DISCOVERY_RANGE}=OFF: nodes cannot discover each other; unset it')


def prepare_middleware() -> None:
    """Check the surroundings and choose the middleware's profiles.

    A node started by a command leaves the checks to the command. It raises BallbotError for an
    invalid ROS domain, an unknown peer, a log folder that is not writable, a loopback interface
    that is needed and down, or a domain that is full.
    """
    ros_domain()
    if END_WITH_PARENT not in os.environ:
        prepare_log_folder()
        _require_peers()
        if is_local():
            _require_loopback()
    use_profiles()
    if END_WITH_PARENT not in os.environ:
        require_places(1)


def require_places(count: int) -> None:
    """Raise BallbotError if `count` more participants would not all find each other."""
    if os.environ.get(PROFILES) != _profiles(LOCAL):
        return
    domain = ros_domain()
    present = sum(number < MAX_PARTICIPANTS for number in living_participants(domain))
    if present + count > MAX_PARTICIPANTS:
        raise BallbotError(
            f'ROS domain {domain} has {present} participants on this machine, and only '
            f'{MAX_PARTICIPANTS} find each other: end some of them, or set another {DOMAIN}'
        )


def use_profiles() -> None:
    """Choose the profiles of Fast DDS, unless the user has profiles or a middleware of their own.

    In the range LOCALHOST, rmw adds shared memory to every profile. So the profile for one machine
    limits discovery itself, and the range becomes SYSTEM_DEFAULT. With static peers in that range,
    which a profile can't take from the environment, everything is left to rmw.
    """
    if own_profiles() or os.environ.get(RMW, '') not in FAST_DDS:
        return
    if is_local():
        os.environ.pop(LOCALHOST_ONLY, None)
        os.environ[DISCOVERY_RANGE] = AS_IN_PROFILES
        os.environ[PROFILES] = _profiles(LOCAL)
    elif os.environ.get(DISCOVERY_RANGE) == LOCAL:
        os.environ.pop(PROFILES, None)
    else:
        os.environ[PROFILES] = _profiles(NETWORK)


def own_profiles() -> str:
    """Return the file of profiles that the user has chosen; '' if there is none."""
    chosen = os.environ.get(PROFILES, '')
    return '' if chosen in (_profiles(LOCAL), _profiles(NETWORK)) else chosen


def _profiles(reach: str) -> str:
    name = 'fastdds_local.xml' if reach == LOCAL else 'fastdds.xml'
    return str(share_directory() / 'config' / name)


def _require_peers() -> None:
    """Raise BallbotError if a host in :data:`STATIC_PEERS` is unknown: no node would start."""
    for peer in filter(None, os.environ.get(STATIC_PEERS, '').split(';')):
        with os_errors(BallbotError, f'{STATIC_PEERS}: {peer}'):
            socket.getaddrinfo(peer, None)


def _require_loopback() -> None:
    """Raise BallbotError if the loopback interface is down: the nodes would wait in vain."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((LOOPBACK, 9))  # needs a route; UDP sends nothing
        except OSError as error:
            raise BallbotError(
                f'{LOOPBACK}: {error.strerror}: bring the loopback interface up, '
                f'for example with `ip link set lo up`'
            ) from None


def prepare_log_folder() -> None:
    """Create the folder of ROS's logs, also without the variable HOME, which rcl requires.

    It raises BallbotError if the folder is not writable.
    """
    home = os.environ.get('ROS_HOME') or '~/.ros'
    folder = os.environ.get(LOG_FOLDER) or f'{home}/log'
    try:
        folder = os.environ[LOG_FOLDER] = str(Path(folder).expanduser())
        make_folder(Path(folder))
    except (OSError, RuntimeError) as error:  # RuntimeError: nobody knows the home folder
        reason = getattr(error, 'strerror', None) or one_line(error)
        raise BallbotError(
            f'{folder}: {reason}; set {LOG_FOLDER} to a folder that can be written to'
        ) from None
