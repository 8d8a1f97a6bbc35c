"""The tasks of a tick, run at once or when the kernel of the brick lets them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy

from ballbot_ros.controllers.document.axis import TASK_TS2
from ballbot_ros.controllers.document.program import DUTY_TASK, ControlProgram
from ballbot_ros.controllers.interface import BUS_BUSY, SAME_TICK, Program
from ballbot_ros.engine.devices import numbers_of, varied
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.timing import FIRST_TICK_NS, MILLISECOND_NS, TICK_NS
from ballbot_ros.robot.brick.brick import DeviceInputs, DeviceOutputs
from ballbot_ros.robot.brick.fault_effects import (
    OFF_NS,
    SLOW,
    active_amount,
    fault_row,
    program_changes,
    program_start,
)
from ballbot_ros.robot.brick.faults import COMPONENTS, faults_of
from ballbot_ros.robot.brick.job_times import is_timed, job_times, kernel_constants
from ballbot_ros.robot.brick.kernel import (
    DUTY_X,
    DUTY_Y,
    Job,
    OsekKernel,
    duty_effect,
    is_bus_busy,
    set_duty,
)
from ballbot_ros.robot.brick.link import is_sending, link_of
from ballbot_ros.robot.brick.schedule import Schedule
from ballbot_ros.robot.random_numbers import noise_key


class BrickTasks:
    """Runs the tasks of a control program during a run, which begins at `start_ns`.

    With a kernel or a link, a job computes when it begins, on the samples of the tick in which it
    does, and its duty is set when it ends. The kernel counts the alarms of the tasks by itself. A
    free-running controller has the time that it takes, and `is_timed` is false.

    A fault can restart the program, and stop it before. Meanwhile no task runs, and the duty is 0.
    """

    def __init__(self, parameters: ControllerParameters, start_ns: int = FIRST_TICK_NS) -> None:
        self._parameters = parameters
        self.is_timed = is_timed(parameters)
        self.faults = fault_row(faults_of(parameters), start_ns)
        self._start_ns = self._begun_ns = start_ns
        self._schedule: Schedule | None = None
        self._kernel: OsekKernel | None = None
        self._duties: dict[int, tuple[int, int]] = {}
        self._newest_duty = 0, 0

    def copy(self) -> BrickTasks:
        """Return an object in the same state, which goes on by itself."""
        twin = copy(self)
        twin._kernel, twin._duties = self._kernel and self._kernel.copy(), dict(self._duties)
        return twin

    @property
    def changes(self) -> Mapping[int, bool]:
        """Ticks [ns] at which the program starts anew (True) or stops (False)."""
        return program_changes(self.faults, self._start_ns)

    def tick(
        self,
        program: Program,
        now_ns: int,
        inputs: DeviceInputs,
        released: Sequence[str] | None = None,
    ) -> DeviceOutputs:
        """Run the tasks that are due, or those that have been released for the tick."""
        systick_ms = now_ns // MILLISECOND_NS
        if not self._is_on(program, now_ns):
            outputs = program.run((), systick_ms, inputs)  # its registers have the newest samples
            outputs.duty = 0, 0
            return outputs
        if self.is_timed:
            return self._tick(program, now_ns, inputs)
        if released is None:
            self._schedule = self._schedule or Schedule(program.tasks)
            released = self._schedule.due((now_ns - self._begun_ns) // MILLISECOND_NS)
        return program.run(released, systick_ms, inputs)

    def restore_state(
        self, program: ControlProgram, last_ns: int, kernel_state: Sequence[int]
    ) -> None:
        """Continue after a tick from a state of the program and the kernel."""
        self._begun_ns = program_start(self.faults, self._start_ns, last_ns)
        if not self.is_timed:
            return
        kernel = self._kernel or self._begin(program, self._start_ns)
        kernel.state = list(kernel_state)
        self._newest_duty = program.state.duty_x, program.state.duty_y
        self._duties = {DUTY_TASK: self._newest_duty} if kernel.has_begun(DUTY_TASK) else {}

    def _is_on(self, program: Program, now_ns: int) -> bool:
        """Return whether the program runs at a tick; restart it if it starts anew."""
        begun_ns, before_ns = program_start(self.faults, self._start_ns, now_ns), self._begun_ns
        self._begun_ns = begun_ns
        if begun_ns not in (before_ns, OFF_NS):
            program.restart()
            self._kernel, self._duties = None, {}
        return begun_ns != OFF_NS

    def _tick(self, program: Program, now_ns: int, inputs: DeviceInputs) -> DeviceOutputs:
        kernel = self._kernel or self._begin(program, now_ns)
        until_us = (now_ns + TICK_NS) // 1000
        outputs: DeviceOutputs | None = None
        jobs: list[Job] = []
        while (event := kernel.next_event(until_us)) >= 0 or outputs is None:
            task, is_end = divmod(event, 2)
            if event >= 0 and is_end:
                jobs.append(kernel.ended(task))
                if duty := self._duties.pop(task, None):
                    set_duty(kernel.state, *duty)
                continue
            names = [kernel.tasks[task].name] if event >= 0 else []
            reads_sonar = TASK_TS2 in names
            before = self._newest_duty
            flags = 0 if outputs is None else SAME_TICK
            if reads_sonar and is_bus_busy(kernel.state, self._times.sonar):
                flags |= BUS_BUSY
            outputs = program.run(names, now_ns // MILLISECOND_NS, inputs, flags)
            if event >= 0:
                if outputs.duty != before:
                    self._newest_duty = self._duties[task] = outputs.duty
                time_us = program.job_time(names[0], outputs, self._times)
                if names[0] in COMPONENTS:
                    component = COMPONENTS.index(names[0])
                    time_us += active_amount(self.faults, component, SLOW, now_ns)
                kernel.take_time(task, varied(self._times, time_us, self._key, task, now_ns))
        effect_ns = 1000 * duty_effect(kernel.constants, kernel.state)
        outputs.duty = kernel.state[DUTY_X], kernel.state[DUTY_Y]
        outputs.delay_ns = max(effect_ns - now_ns, 0)
        outputs.jobs = jobs + kernel.newly_lost(now_ns // 1000)
        return outputs

    def _begin(self, program: Program, now_ns: int) -> OsekKernel:
        numbers = numbers_of(self._parameters)
        self._times, self._key = job_times(numbers), noise_key(self._parameters.seed)
        self._kernel = OsekKernel(
            kernel_constants(numbers),
            program.tasks,
            now_ns // 1000,
            sends=is_sending(link_of(numbers), now_ns),
        )
        return self._kernel
