"""The compiled control program, as a replacement for the Python one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ballbot_ros.brick.brick import Brick, DeviceInputs, DeviceOutputs
from ballbot_ros.brick.schedule import Schedule, TaskTiming
from ballbot_ros.codegen.brick_process import Answer, encode_request
from ballbot_ros.codegen.errors import CodegenError
from ballbot_ros.codegen.state_variables import named_values, plane_values
from ballbot_ros.controllers.document.program import ControlMode, operating_state
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.parameters import ControllerParameters


class ProgramProcess(Protocol):
    """A process that runs the compiled program, on this machine or emulated."""

    def exchange(self, request: bytes) -> Answer:
        """Run a tick."""


class Plane:
    """A plane's data in the compiled program, with the names of the Python program."""

    def __init__(self) -> None:
        self.theta = self.psi = self.theta_dot = self.psi_dot = 0.0
        self.theta_ref = self.theta_ref_dot = 0.0


class CompiledProgram:
    """The generated C, with the interface of the Python ``ControlProgram``.

    It uses the same :class:`Brick`, which here stands for the firmware: the brick, not the program,
    writes the other fields of the log packet and the text of the display. The tasks are those of
    the OIL file, in file order.

    Attributes
    ----------
    state : bytes
        The C structure ``ballbot`` after the last tick.
    stack_bytes : tuple of int
        Maximum stack usage of each task so far.
    """

    def __init__(
        self, process: ProgramProcess, tasks: Sequence[TaskTiming], autonomous: bool
    ) -> None:
        self._process = process
        self._autonomous = autonomous
        self._schedule = Schedule(tasks)
        self._numbers = {timing.name: number for number, timing in enumerate(tasks)}
        self.brick = Brick()
        self.x, self.y = Plane(), Plane()
        self.control_mode = ControlMode.CALIBRATION
        self.operating_state = OperatingState.CALIBRATION
        self.state = b''
        self.stack_bytes: tuple[int, ...] = ()

    def retune(self, parameters: ControllerParameters) -> None:
        """Raise CodegenError: the gains are constants of the compiled program."""
        raise CodegenError(
            "the compiled controller can't change its gains during a run (implementation: python "
            'can)'
        )

    def tick(self, elapsed_ms: int, systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run the tasks due `elapsed_ms` after the start; see :meth:`run`."""
        return self.run(self._schedule.due(elapsed_ms), systick_ms, inputs)

    def run(self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs) -> DeviceOutputs:
        """Run `tasks`, in this order, on the inputs of a tick.

        Raises
        ------
        CodegenError
            If the program has ended, or makes an invalid call.
        """
        return self.brick.tick(systick_ms, inputs, lambda: self._run_tasks(tasks, inputs))

    def _run_tasks(self, tasks: Sequence[str], inputs: DeviceInputs) -> None:
        brick = self.brick
        answer = self._process.exchange(
            encode_request(
                systick_ms=brick.systick_ms,
                revolutions=brick.revolutions,
                sonar_reply_cm=brick.sonar_reply,
                gyro=brick.gyro,
                battery_mv=brick.battery_mv,
                sticks=inputs.sticks,
                due=[self._numbers[name] for name in tasks],
            )
        )
        if answer.faults:
            raise CodegenError(
                f'the compiled controller made invalid device calls: faults {answer.faults:#x}'
            )
        brick.duty = answer.duty
        if answer.log:
            brick.log(*answer.log)
        if answer.read_sonar:
            brick.read_sonar()
        for tone in answer.tones:
            brick.sound_tone(*tone)
        if answer.page is not None:
            brick.show_status(answer.page)
        self._take(answer)

    def _take(self, answer: Answer) -> None:
        self.state = answer.state
        self.stack_bytes = answer.stack_bytes
        for number, plane in enumerate((self.x, self.y)):
            vars(plane).update(plane_values(answer.state, number))
        values = named_values(answer.state)
        self.control_mode = ControlMode(int(values['control_mode']))
        self.operating_state = operating_state(
            self.control_mode,
            self._autonomous,
            bool(values['flag_avoid']),
            bool(values['flag_auto']),
        )
