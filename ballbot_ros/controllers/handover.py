"""Another controller that takes over during a run."""

from __future__ import annotations

from collections.abc import Sequence

from ballbot_ros.controllers.interface import SAME_TICK, PlaneEstimates, Program
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.robot.brick.brick import UINT32_MASK, DeviceInputs, DeviceOutputs
from ballbot_ros.robot.brick.job_times import JobTimes
from ballbot_ros.robot.brick.schedule import Schedule


class HandedOver:
    """Two programs that both run on the same samples; the motors follow the first, then the second.

    So the second has calibrated its gyros and knows the robot when it takes over. The tasks, and
    their times on the brick, remain those of the first.

    Parameters
    ----------
    at_ms : int
        When the second takes over, from the start of the run.
    """

    def __init__(self, first: Program, second: Program, at_ms: int) -> None:
        self._first, self._second, self._at_ms = first, second, at_ms
        self._schedule = Schedule(second.tasks)
        self._start_ms: int | None = None
        self._outputs = DeviceOutputs((0, 0))
        self.tasks = first.tasks
        self._publish(first)

    def _publish(self, in_command: Program) -> None:
        self.x: PlaneEstimates = in_command.x
        self.y: PlaneEstimates = in_command.y
        self.operating_state = in_command.operating_state

    def retune(self, parameters: ControllerParameters) -> None:
        """Let the first program take over parameters."""
        self._first.retune(parameters)

    def restart(self) -> None:
        """Start both programs anew."""
        self._first.restart()
        self._second.restart()

    def run(
        self, tasks: Sequence[str], systick_ms: int, inputs: DeviceInputs, flags: int = 0
    ) -> DeviceOutputs:
        """Run the tasks with these names, and once in a tick the second program."""
        outputs = self._first.run(tasks, systick_ms, inputs, flags)
        if self._start_ms is None:
            self._start_ms = systick_ms
        elapsed_ms = (systick_ms - self._start_ms) & UINT32_MASK
        if not flags & SAME_TICK:
            due = self._schedule.due(elapsed_ms)
            self._outputs = self._second.run(due, systick_ms, inputs)
        is_first = elapsed_ms < self._at_ms
        self._publish(self._first if is_first else self._second)
        return outputs if is_first else self._outputs

    def job_time(self, task: str, outputs: DeviceOutputs, times: JobTimes) -> float:
        """Return how long the job of the first program takes that has just run [µs]."""
        return self._first.job_time(task, outputs, times)
