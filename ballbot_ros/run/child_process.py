"""Child processes that do what this process asks them to, and end with it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Sequence
from multiprocessing.connection import Connection

from ballbot_ros.nodes.processes import END_WITH_PARENT

_STANDARD_ERROR = 2


def start_child(
    module: str, descriptors: Sequence[int] = ()
) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start ``main`` of a module in a Python process of its own; return it and a connection to it.

    Unlike those of `multiprocessing` it does not import the main program again. The arguments of
    the process are the descriptor of its connection, then `descriptors`, which it inherits. Ctrl-C
    does not reach it.
    """
    ours, theirs = socket.socketpair()
    with theirs:
        inherited = [theirs.fileno(), *descriptors]
        process = subprocess.Popen(
            [sys.executable, '-c', f'from {module} import main; main()', *map(str, inherited)],
            env={**os.environ, END_WITH_PARENT: str(os.getpid())},
            pass_fds=inherited,
            stdin=subprocess.DEVNULL,
            stdout=_STANDARD_ERROR,
            start_new_session=True,
        )
    return process, Connection(ours.detach())
