"""Checks of a generated folder: comparison with the Python program, and measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.codegen.application import PARAMETER_FILE, read_tasks
from ballbot_ros.codegen.back_to_back import EquivalenceResult, compare
from ballbot_ros.codegen.brick_process import Answer, BrickProcess
from ballbot_ros.codegen.compiled_program import CompiledProgram
from ballbot_ros.codegen.errors import CodegenError
from ballbot_ros.codegen.measure import Memory, count_instructions, measure_memory
from ballbot_ros.codegen.steps import InputSequence
from ballbot_ros.codegen.toolchain import Target, build
from ballbot_ros.parameters import ControllerParameters, ParameterSet
from ballbot_ros.parameters.files import read_parameter_file


@dataclass(frozen=True)
class TaskCost:
    """Cost of a task: the most instructions of a call, and the most stack."""

    name: str
    is_periodic: bool
    instructions: int
    stack_bytes: int


class ProgramCost(NamedTuple):
    """Cost of the program on the brick, without the platform."""

    tasks: Sequence[TaskCost]
    memory: Memory


class _RequestRecorder:
    """A process of the program that records its requests."""

    def __init__(self, process: BrickProcess) -> None:
        self._process = process
        self.requests: list[bytes] = []

    def exchange(self, request: bytes) -> Answer:
        """Run a tick."""
        self.requests.append(request)
        return self._process.exchange(request)


def read_folder_parameters(folder: Path) -> ParameterSet:
    """Return the parameters of a generated folder; raise CodegenError if it is not one."""
    file = folder / PARAMETER_FILE
    if not file.is_file():
        raise CodegenError(f'{file}: not found; the folder was not written by ballbot codegen')
    return read_parameter_file(file)


class BuiltApplication:
    """A generated folder, built for a target in the folder `scratch`.

    Raises
    ------
    CodegenError
        If the folder is incomplete, or can't be built.
    """

    def __init__(self, folder: Path, target: Target, scratch: Path) -> None:
        self._parameters = read_folder_parameters(folder).of(ControllerParameters)
        self._tasks = read_tasks(folder)
        self._scratch = scratch
        self._command = build(folder, target, scratch)
        self._stack = [0] * len(self._tasks)

    def _program(self, process: BrickProcess | _RequestRecorder) -> CompiledProgram:
        return CompiledProgram(process, self._tasks, self._parameters.mode == 'autonomous')

    def compare(self, sequences: Sequence[InputSequence]) -> EquivalenceResult:
        """Run the C and the Python program on the same inputs until they differ."""
        ticks = 0
        for sequence in sequences:
            program = self._program(BrickProcess(self._command))
            result = compare(self._parameters, program, sequence.steps)
            ticks += result.ticks
            if result.difference:
                return EquivalenceResult(ticks, f'{sequence.name}, {result.difference}')
            self._stack = list(map(max, self._stack, program.stack_bytes))
        return EquivalenceResult(ticks)

    def cost(self, sequences: Sequence[InputSequence]) -> ProgramCost:
        """Measure instructions on `sequences`, and memory; stack usage is that of comparisons."""
        worst = dict.fromkeys((task.name for task in self._tasks), 0)
        for sequence in sequences:
            recorder = _RequestRecorder(BrickProcess(self._command))
            program = self._program(recorder)
            for step in sequence.steps:
                program.tick(*step)
            counted = count_instructions(self._command, recorder.requests, list(worst))
            worst = {name: max(worst[name], counted[name]) for name in worst}
        tasks = [
            TaskCost(task.name, bool(task.period_ms), worst[task.name], stack)
            for task, stack in zip(self._tasks, self._stack, strict=True)
        ]
        return ProgramCost(tasks, measure_memory(self._scratch, len(self._tasks)))
