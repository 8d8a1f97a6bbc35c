"""A process that has imported the nodes of a run, and forks them on request.

Importing rclpy and the messages takes longer than everything else until the first tick, and every
node needs the same. This process never initialises rclpy, so its forks start like new processes.

It serves the command that started it; the messages are described by
:class:`ballbot_ros.run.node_process.ForkClient`.
"""

from __future__ import annotations

import ctypes
import inspect
import json
import os
import selectors
import signal
import socket
import sys
import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.nodes.executables import start
from ballbot_ros.nodes.processes import END_WITH_PARENT, ProcessSilence, end_with_parent

MAX_FILES = 4
"""Descriptors in a request: its own, of the output, and two that a plant inherits."""

GRACE_S = 5.0
"""Time that a node has to end after its command [s]; the recorder finishes its file."""

_POLL_S = 0.05

PROGRAM = f'from {__name__} import main; main()'
ROOM = ' ' * 512
"""Last argument of the program: its place in memory takes the command lines of the nodes."""

_PR_SET_NAME = 15
_ARG_START, _ARG_END = 45, 46
"""Fields of ``/proc/self/stat`` after the name of the program."""


class NodeRequest(NamedTuple):
    """A node to be forked.

    The arguments are its command line. The variables `inherited` of its environment get the
    descriptors that it inherits.
    """

    name: str
    arguments: Sequence[str]
    environment: dict[str, str]
    inherited: Sequence[str] = ()


def main() -> None:
    """Fork nodes until the command ends; in a fork, run the node."""
    set_command_line('fork_server', ['ballbot_ros fork_server'])
    # Python puts the current folder first, where a file may have the name of an installed module.
    with suppress(ValueError):  # it does not with PYTHONSAFEPATH
        sys.path.remove('')
    # If it is stopped when the command ends, it must continue in order to end the nodes.
    if not end_with_parent(signal.SIGCONT):
        return
    parent = os.getpid()
    with socket.socket(fileno=int(sys.argv[1])) as control:
        missing = import_nodes()
        with suppress(OSError):  # the command has just ended
            control.send(_encode(missing))
        forked = serve(control)
    if forked is None:
        os._exit(0)  # there is nothing to clean up
    try:
        become_node(*forked, parent)
    except SystemExit as end:
        if not isinstance(end.code, int):
            raise
        sys.stdout.flush()
        sys.stderr.flush()
        # The node has released everything; clearing up all modules would take 0.4 s more.
        os._exit(end.code)


def import_nodes() -> str:
    """Import what the nodes of a run need; return why there is no ROS, or ''.

    Other errors are left to the nodes, which report them.
    """
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        return str(error)
    with suppress(ImportError):
        from std_srvs.srv import SetBool, Trigger

        from ballbot_ros.nodes.registry import REGISTRY
        from ballbot_ros.parameters import NODES
        from ballbot_ros.recording.messages.topics import PARTICIPANTS, RUN, TOPICS
        from ballbot_ros.recording.schemas import typestore

        for name in NODES:
            REGISTRY[name].load()
        for kind in (*(topic.message_class for topic in TOPICS), SetBool, Trigger):
            type(kind).__import_type_support__()
        for topic in (PARTICIPANTS, RUN):
            typestore().get_msgdef(topic.type_name)  # generates code for it
    # The first line that a node logs makes `inspect` look up the files of all modules. It remembers
    # them.
    inspect.getmodule(inspect.currentframe())
    return ''


def serve(control: socket.socket) -> tuple[NodeRequest, list[int]] | None:
    """Fork a node for each request, and report the end of each node.

    If the command ends before its nodes, as when it is killed, it ends them.

    Returns
    -------
    request : NodeRequest
        In a fork: the node that it is to become.
    files : list of int
        Descriptors of the node's output, and of what else it inherits.
    """
    with selectors.DefaultSelector() as selector:
        selector.register(control, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select():
                if key.fileobj is not control:
                    _, status = os.waitpid(key.data, 0)
                    selector.unregister(key.fileobj)
                    os.close(key.fd)
                    with suppress(OSError):  # the command has just ended
                        control.send(_encode(key.data, os.waitstatus_to_exitcode(status)))
                    continue
                files = _receive(control)
                if not files:
                    selector.unregister(control)
                    _end_nodes([key.data for key in selector.get_map().values()])
                    return None
                with os.fdopen(files.pop(0), 'rb') as text:
                    request = NodeRequest(*json.load(text))
                with warnings.catch_warnings():
                    # rcl has loaded LTTng, whose threads a fork lacks and does not need.
                    warnings.simplefilter('ignore', DeprecationWarning)
                    process = os.fork()
                if process == 0:
                    return request, files
                for file in files:
                    os.close(file)
                selector.register(os.pidfd_open(process), selectors.EVENT_READ, process)
                control.send(_encode(process))


def _end_nodes(nodes: Sequence[int]) -> None:
    """Stop the nodes, and kill those that hang, without a wait for the end of these."""
    for node in nodes:
        os.kill(node, signal.SIGTERM)
    silences = {node: ProcessSilence(node) for node in nodes}
    while silences:
        for node, silence in tuple(silences.items()):
            if silence.measure_s() > GRACE_S:
                os.kill(node, signal.SIGKILL)  # a broken disk may hold up even this end
            elif not os.waitpid(node, os.WNOHANG)[0]:
                continue
            del silences[node]
        time.sleep(_POLL_S)


def _receive(control: socket.socket) -> list[int]:
    """Return the descriptors of a request; none if the command has ended."""
    try:
        return socket.recv_fds(control, 1, MAX_FILES)[1]
    except ConnectionResetError:  # it has ended without reading how nodes ended
        return []


def _encode(*content: int | str) -> bytes:
    return json.dumps(content).encode()


def become_node(request: NodeRequest, files: list[int], parent: int) -> None:
    """Run a node in this fork as in a process of its own, which ends with `parent`."""
    output, *inherited = files
    # Keep Ctrl-C from the node: it is for the run, which then stops its nodes in order.
    os.setsid()
    standard_input = os.open(os.devnull, os.O_RDONLY)
    for file, number in ((standard_input, 0), (output, 1), (output, 2)):
        os.dup2(file, number)
    os.close(standard_input)
    os.close(output)
    os.environ.clear()
    os.environ.update(request.environment)
    # Do not ask for the parent, which is another process if the fork server has already ended.
    os.environ[END_WITH_PARENT] = str(parent)
    os.environ.update(zip(request.inherited, map(str, inherited), strict=True))
    sys.argv = list(request.arguments)
    set_command_line(request.name, request.arguments)
    start(request.name)


def set_command_line(name: str, words: Sequence[str]) -> None:
    """Let tools like ``ps`` and ``pgrep`` see this process as a program of its own.

    The command line replaces the one with which this process, or the one it was forked from, was
    started; what has no room there is cut off.
    """
    stat = Path('/proc/self/stat').read_text().rpartition(')')[2].split()
    begin, end = int(stat[_ARG_START]), int(stat[_ARG_END])
    line = b'\0'.join(map(os.fsencode, words))[: end - begin - 1]
    ctypes.memmove(begin, line.ljust(end - begin, b'\0'), end - begin)
    ctypes.CDLL(None).prctl(_PR_SET_NAME, name.encode())
