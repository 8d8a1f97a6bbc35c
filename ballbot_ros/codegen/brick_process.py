"""The compiled program as a process: one request and one answer per tick, through pipes.

``target/brick.c`` defines both records.
"""

from __future__ import annotations

import contextlib
import os
import struct
import subprocess
import weakref
from collections.abc import Sequence
from typing import IO, NamedTuple

from ballbot_ros.brick.brick import Tone
from ballbot_ros.codegen.errors import CodegenError
from ballbot_ros.codegen.state_variables import STATE_SIZE

MAX_DUE = 8
_REQUEST = struct.Struct(f'<IiiiHHHBbbB{MAX_DUE}s2x')
_ANSWER_HEADER = struct.Struct(f'<bbBBBBBx{MAX_DUE}Hbbhhhhxx6I16s')
ANSWER_SIZE = _ANSWER_HEADER.size + STATE_SIZE
_SIZES = struct.Struct('<HH')
_MAX_REASON_LENGTH = 200
GRACE_S = 1.0


class Log(NamedTuple):
    """Arguments of ``ecrobot_bt_adc_data_logger``."""

    data1: int
    data2: int
    adc1: int
    adc2: int
    adc3: int
    adc4: int


class Answer(NamedTuple):
    """The program's outputs in a tick.

    Attributes
    ----------
    duty : tuple of int
        Motors B and C [%].
    faults : int
        Calls that no valid program makes; see ``target/brick.c``.
    page : str or None
        Name passed to the status display.
    stack_bytes : tuple of int
        Maximum stack usage of each task so far; zeros if not measured.
    state : bytes
        The C structure ``ballbot``.
    """

    duty: tuple[int, int]
    faults: int
    log: Log | None
    tones: list[Tone]
    page: str | None
    read_sonar: bool
    stack_bytes: tuple[int, ...]
    state: bytes


def encode_request(
    *,
    systick_ms: int,
    revolutions: tuple[int, int],
    sonar_reply_cm: int,
    gyro: tuple[int, int],
    battery_mv: int,
    sticks: tuple[int, int] | None,
    due: Sequence[int],
) -> bytes:
    """Return the request for a tick: device readings, and the numbers of the due tasks in order.

    `sticks` is a packet that has arrived, or None.

    Raises
    ------
    CodegenError
        If a value does not fit in the device's type.
    """
    try:
        return _REQUEST.pack(
            systick_ms, *revolutions, sonar_reply_cm, *gyro, battery_mv,
            sticks is not None, *(sticks or (0, 0)), len(due), bytes(due),
        )  # fmt: skip
    except struct.error as error:
        raise CodegenError(f"a reading is out of its device's range: {error}") from None


class BrickProcess:
    """A running process of the compiled program, started by the command from ``toolchain.build``.

    Raises
    ------
    CodegenError
        If it does not start.
    """

    def __init__(self, command: Sequence[str]) -> None:
        # Keep error output in memory, independent of free disk space, until the process is closed.
        errors = os.fdopen(os.memfd_create('errors'), 'w+b')
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                # Keep Ctrl-C from the program: the run gets it, and ends the program by closing its
                # input.
                start_new_session=True,
            )
        except OSError as error:
            errors.close()
            raise CodegenError(f'{command[0]}: {error.strerror}') from None
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._to, self._from, self._errors = self._process.stdin, self._process.stdout, errors
        self.close = weakref.finalize(self, _end, self._process, errors)
        sizes = _SIZES.unpack(self._read(_SIZES.size))
        if sizes != (_REQUEST.size, ANSWER_SIZE):
            raise CodegenError(
                f'{command[-1]}: records of {sizes} bytes, not {(_REQUEST.size, ANSWER_SIZE)}: the '
                'folder was made by another version'
            )

    def exchange(self, request: bytes) -> Answer:
        """Run a tick; raise CodegenError if the program has ended."""
        with contextlib.suppress(BrokenPipeError):
            self._to.write(request)
            self._to.flush()
        return decode_answer(self._read(ANSWER_SIZE))

    def _read(self, size: int) -> bytes:
        data = self._from.read(size)
        if len(data) < size:
            status = self._process.wait()
            raise CodegenError(f'the compiled controller ended with status {status}{self._why()}')
        return data

    def _why(self) -> str:
        self._errors.seek(0)
        text = ' '.join(self._errors.read().decode(errors='replace').split())
        return f': {text[:_MAX_REASON_LENGTH]}' if text else ''


def decode_answer(data: bytes) -> Answer:
    """Decode an answer."""
    fields = _ANSWER_HEADER.unpack_from(data)
    vertical, horizontal, faults, logs, tones, pages, sonar_reads, *rest = fields
    stack, rest = rest[:MAX_DUE], rest[MAX_DUE:]
    log, rest = rest[:6], rest[6:]
    name = rest.pop()
    return Answer(
        (vertical, horizontal),
        faults,
        Log(*log) if logs else None,
        [Tone(*rest[3 * n : 3 * n + 3]) for n in range(tones)],
        name.rstrip(b'\0').decode('ascii') if pages else None,
        sonar_reads > 0,
        tuple(stack),
        data[_ANSWER_HEADER.size :],
    )


def _end(process: subprocess.Popen[bytes], errors: IO[bytes]) -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe:
            with contextlib.suppress(BrokenPipeError):
                pipe.close()
    try:
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    errors.close()
