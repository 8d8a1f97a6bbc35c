"""Standard streams: opened if they are closed, as by a daemon; kept for the result."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedWriter, FileIO, TextIOWrapper
from typing import Any


def open_standard_streams() -> None:
    """Open closed standard streams on the null device.

    Otherwise the next file to be opened, such as a recording, would get the file descriptor of a
    standard stream, and the output of libraries would end up in it.
    """
    for name, mode in (('stdin', 'r'), ('stdout', 'w'), ('stderr', 'w')):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding='utf-8'))  # noqa: PTH123, SIM115


STANDARD_OUTPUT = 'standard output'
"""The name of the file in errors."""


class _StandardOutput(FileIO):
    """Standard output whose errors name it, as those of other files do."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            error.filename = STANDARD_OUTPUT
            raise


def prepare_standard_output() -> None:
    r"""Let errors of standard output name it, and let it escape what its encoding lacks.

    Characters that a terminal or file can't encode, such as θ in ASCII, become ``\u03b8``.
    """
    stdout = sys.stdout
    if stdout is sys.__stdout__ and isinstance(stdout, TextIOWrapper) and stdout.fileno() == 1:
        file = _StandardOutput(1, 'w', closefd=False)
        sys.stdout = TextIOWrapper(
            file if stdout.write_through else BufferedWriter(file), stdout.encoding,
            line_buffering=stdout.line_buffering, write_through=stdout.write_through,
        )  # fmt: skip
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors='backslashreplace')


@contextmanager
def stdout_to_stderr() -> Iterator[None]:
    """Keep stdout for the result: redirect what middleware and controllers print to stderr."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
