"""The compiled control program, as a replacement for the Python one.

It is a process, with one request and one answer per tick through pipes; ``target/brick.c`` defines
both records.
"""

from __future__ import annotations

import contextlib
import os
import struct
import subprocess
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import IO, Any, NamedTuple

from ballbot_ros.controllers.document.program import ControlMode
from ballbot_ros.controllers.interface import BUS_BUSY, SAME_TICK, Estimates, OperatingState
from ballbot_ros.errors import CodegenError
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.robot.brick.brick import Brick, DeviceInputs, DeviceOutputs, Tone
from ballbot_ros.robot.brick.job_times import JobTimes
from ballbot_ros.robot.brick.schedule import TaskTiming

MAX_DUE = 8
_REQUEST = struct.Struct(f'<IiiiHHHBbbB{MAX_DUE}s2x')
_ANSWER_HEADER = struct.Struct(f'<bbBBBBBx{MAX_DUE}Hbbhhhhxx6I16s')
_SIZES = struct.Struct('<HH')
_MAX_REASON_LENGTH = 200
GRACE_S = 1.0


class Answer(NamedTuple):
    """The program's outputs in a tick.

    Attributes
    ----------
    duty : tuple of int
        Motors B and C [%].
    faults : int
        Calls that no valid program makes; see ``target/brick.c``.
    log : tuple of int or None
        Arguments of ``ecrobot_bt_adc_data_logger``: two of 8 bits, four of 16.
    page : str or None
        Name passed to the status display.
    stack_bytes : tuple of int
        Maximum stack usage of each task so far; zeros if not measured.
    state : bytes
        The C structure ``ballbot``.
    """

    duty: tuple[int, int]
    faults: int
    log: tuple[int, ...] | None
    tones: list[Tone]
    page: str | None
    read_sonar: bool
    stack_bytes: tuple[int, ...]
    state: bytes


class BrickProcess:
    """A running process of the compiled program, started by the command from ``toolchain.build``.

    `state_size` is the size of the C structure ``ballbot``. It raises CodegenError if the program
    does not start.
    """

    def __init__(self, command: Sequence[str], state_size: int) -> None:
        self._answer_size = _ANSWER_HEADER.size + state_size
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
        if sizes != (expected := (_REQUEST.size, self._answer_size)):
            raise CodegenError(
                f'{command[-1]}: records of {sizes} bytes, not {expected}: the folder was made by '
                'another version'
            )

    def exchange(self, request: bytes) -> Answer:
        """Run a tick; raise CodegenError if the program has ended."""
        with contextlib.suppress(BrokenPipeError):
            self._to.write(request)
            self._to.flush()
        return _decode_answer(self._read(self._answer_size))

    def _read(self, size: int) -> bytes:
        data = self._from.read(size)
        if len(data) < size:
            status = self._process.wait()
            self._errors.seek(0)
            text = ' '.join(self._errors.read().decode(errors='replace').split())
            why = f': {text[:_MAX_REASON_LENGTH]}' if text else ''
            raise CodegenError(f'the compiled controller ended with status {status}{why}')
        return data


def _decode_answer(data: bytes) -> Answer:
    """Decode an answer."""
    vertical, horizontal, faults, logs, tones, pages, sonar_reads, *rest = (
        _ANSWER_HEADER.unpack_from(data)
    )
    stack, rest = rest[:MAX_DUE], rest[MAX_DUE:]
    log, rest = rest[:6], rest[6:]
    name = rest.pop()
    return Answer(
        (vertical, horizontal),
        faults,
        tuple(log) if logs else None,
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


class CompiledProgram:
    """The generated C, with the interface of a control program in Python.

    It uses the same :class:`Brick`, which here stands for the firmware: the brick, not the program,
    writes the other fields of the log packet and the text of the display. The tasks are those of
    the OIL file, in file order.

    Parameters
    ----------
    exchange : callable
        Runs a tick in a process of the program, as :meth:`BrickProcess.exchange` does.
    named_values : callable
        Returns the values in the C structure by name.

    Attributes
    ----------
    x, y : Estimates
        Of the planes; of nothing, if the program estimates nothing.
    control_mode : ControlMode or None
        The mode that tells which path a task takes; None if the program has none.
    """

    x = y = Estimates()
    control_mode: ControlMode | None = None
    operating_state = OperatingState.CALIBRATION

    def __init__(
        self,
        exchange: Callable[[bytes], Answer],
        tasks: Sequence[TaskTiming],
        parameters: ControllerParameters,
        named_values: Callable[[bytes], Mapping[str, Any]],
    ) -> None:
        self.exchange = exchange
        self._parameters = parameters
        self._named_values = named_values
        self.tasks = tasks
        self._numbers = {timing.name: number for number, timing in enumerate(tasks)}
        self.brick = Brick()
        self.state = b''
        self.stack_bytes: tuple[int, ...] = ()

    @property
    def reads_packets(self) -> bool:
        """Whether its next tick takes a packet from the radio."""
        return True

    def _publish(self, values: Mapping[str, Any]) -> None:
        """Take over what the program's data tell."""

    def retune(self, parameters: ControllerParameters) -> None:
        """Raise CodegenError: the gains are constants of the compiled program."""
        raise CodegenError(
            "the compiled controller can't change its gains during a run (implementation: python "
            'can)'
        )

    def restart(self) -> None:
        """Do nothing: task_init, which runs first, leaves nothing of what was before."""

    def run(
        self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs, flags: int = 0
    ) -> DeviceOutputs:
        """Run `tasks`, in this order, on the inputs of a tick.

        It raises CodegenError if a reading is out of its device's range, or the program has ended
        or makes an invalid call.
        """
        is_same_tick, is_bus_busy = bool(flags & SAME_TICK), bool(flags & BUS_BUSY)
        if is_same_tick:
            inputs = inputs._replace(sonar_cm=None, battery_mv=None, sticks=None)
        return self.brick.tick(
            systick_ms,
            inputs,
            lambda: self._run_tasks(tasks, inputs, is_bus_busy),
            is_same_tick=is_same_tick,
        )

    def job_time(self, task: str, outputs: DeviceOutputs, times: JobTimes) -> float:
        """Return the declared time of a task, as for other controllers [µs]."""
        return times.own

    def _run_tasks(self, tasks: Sequence[str], inputs: DeviceInputs, is_bus_busy: bool) -> None:
        brick = self.brick
        sonar_reply_cm = brick.sonar_cm if is_bus_busy else brick.sonar_reply
        due = bytes(self._numbers[name] for name in tasks)
        try:
            request = _REQUEST.pack(
                brick.systick_ms, *brick.revolutions, sonar_reply_cm, *brick.gyro,
                brick.battery_mv, inputs.sticks is not None, *(inputs.sticks or (0, 0)),
                len(due), due,
            )  # fmt: skip
        except struct.error as error:
            raise CodegenError(f"a reading is out of its device's range: {error}") from None
        answer = self.exchange(request)
        if answer.faults:
            raise CodegenError(
                f'the compiled controller made invalid device calls: faults {answer.faults:#x}'
            )
        brick.duty = answer.duty
        if answer.log:
            brick.log(*answer.log)
        if answer.read_sonar and not is_bus_busy:
            brick.read_sonar()
        for tone in answer.tones:
            brick.sound_tone(*tone)
        if answer.page is not None:
            brick.show_status(answer.page)
        self.state = answer.state
        self.stack_bytes = answer.stack_bytes
        self._publish(self._named_values(answer.state))
