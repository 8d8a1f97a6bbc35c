"""Starting nodes as forks of one process, and learning how they end."""

from __future__ import annotations

import json
import math
import os
import select
import signal
import socket
import subprocess
import sys
import time

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.fork_server import PROGRAM, ROOM, NodeRequest
from ballbot_ros.nodes.processes import is_alive

_POLL_S = 0.05


class ForkClient:
    """A fork server (:mod:`ballbot_ros.nodes.fork_server`), which lives as long as this context.

    The two exchange JSON over a socket that keeps messages apart. A request is a
    :class:`~ballbot_ros.nodes.fork_server.NodeRequest`, together with the descriptors of the node's
    output and, for a plant, of the lock of the ROS domain. The answer is ``[pid]``. When a node has
    ended, ``[pid, status]`` follows. All nodes end when the fork server does.
    """

    def __init__(self) -> None:
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._statuses: dict[int, int] = {}
        self._is_gone = False
        with theirs:
            self._server = subprocess.Popen(
                [sys.executable, '-c', PROGRAM, str(theirs.fileno()), ROOM],
                # One thread for each node is enough; more would cost start-up time.
                env={**os.environ, 'OPENBLAS_NUM_THREADS': '1'},
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )

    def __enter__(self) -> ForkClient:
        return self

    def __exit__(self, *error: object) -> None:
        self._control.close()
        self._server.kill()  # it may still be importing
        self._server.wait()

    def start(self, request: NodeRequest, output: int, lock: int | None = None) -> int:
        """Start a node, and return its process.

        Parameters
        ----------
        request : NodeRequest
        output : int
            Descriptor of its standard output and standard error.
        lock : int or None
            Descriptor of a lock of the ROS domain that it takes over.

        Raises
        ------
        BallbotError
            If the fork server has ended.
        """
        files = [output] if lock is None else [output, lock]
        try:
            socket.send_fds(self._control, [json.dumps(request).encode()], files)
        except OSError:
            self._is_gone = True
        while not self._is_gone:
            process = self._receive()
            if process is not None:
                return process
        raise BallbotError(f'{request.name} cannot be started: the process that forks it has ended')

    def status_of(self, process: int) -> int | None:
        """Return the exit status of a node, negative for a signal; None while it runs."""
        while process not in self._statuses and not self._is_gone and self._has_message(0.0):
            self._receive()
        if process not in self._statuses and self._is_gone and not is_alive(process):
            self._statuses[process] = -signal.SIGTERM  # sent by the system
        return self._statuses.get(process)

    def await_end(self, process: int, timeout_s: float = math.inf) -> None:
        """Wait for the end of a node, for at most `timeout_s` [s]."""
        deadline = time.monotonic() + timeout_s
        while self.status_of(process) is None:
            remaining_s = min(deadline - time.monotonic(), _POLL_S)
            if remaining_s <= 0.0:
                return
            if self._is_gone:
                time.sleep(remaining_s)
            else:
                self._has_message(remaining_s)

    def _has_message(self, timeout_s: float) -> bool:
        return bool(select.select([self._control], [], [], timeout_s)[0])

    def _receive(self) -> int | None:
        """Receive a message; return the new process that it reports, if any."""
        try:
            message = self._control.recv(1024)
        except OSError:
            message = b''
        if not message:
            self._is_gone = True
            return None
        process, *status = json.loads(message)
        if status:
            self._statuses[process] = status[0]
            return None
        self._statuses.pop(process, None)  # of an earlier node with the same number
        return int(process)
