"""Checks of a generated folder: comparison with the Python program, and measurements."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.controllers.codegen.application import PARAMETER_FILE, read_tasks
from ballbot_ros.controllers.codegen.compiled_program import Answer, CompiledProgram
from ballbot_ros.controllers.codegen.implementation import compose_controller
from ballbot_ros.controllers.codegen.programs import program_of
from ballbot_ros.controllers.codegen.toolchain import (
    Memory,
    Target,
    build,
    count_instructions,
    measure_memory,
)
from ballbot_ros.controllers.document.axis import TS1_MS
from ballbot_ros.controllers.document.program import ControlMode
from ballbot_ros.controllers.interface import SAME_TICK
from ballbot_ros.errors import CodegenError
from ballbot_ros.parameters import ControllerParameters, ParameterSet
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.parameters.timing import BATTERY_PERIOD_NS, MILLISECOND_NS, SLOW_PERIOD_NS
from ballbot_ros.robot.brick.brick import UINT32_MASK, DeviceInputs
from ballbot_ros.robot.brick.schedule import Schedule
from ballbot_ros.robot.brick.sensors import NO_DATA_CM, NO_ECHO_CM

_OFFSET = 600
_SONAR_MS = SLOW_PERIOD_NS // MILLISECOND_NS
_BATTERY_MS = BATTERY_PERIOD_NS // MILLISECOND_NS
_MAX_INT32 = 2**31 - 1
_PHASE_MS = 400
"""Duration of each phase of :func:`path_steps`, in which every task runs."""


class ProgramInput(NamedTuple):
    """Inputs of a control program at one tick."""

    elapsed_ms: int
    systick_ms: int
    inputs: DeviceInputs


class InputSequence(NamedTuple):
    """Inputs of consecutive ticks, with a name."""

    name: str
    steps: Sequence[ProgramInput]


def random_steps(seed: int, ticks: int, *, out_of_range: bool) -> Iterator[ProgramInput]:
    """Yield random inputs that depend on `seed` alone.

    The sonar and the battery deliver at their own rates, stick packets arrive at random ticks. The
    system time starts anywhere, often shortly before it wraps around. Readings stay near balance
    or, if `out_of_range`, jump over the full ranges of their types, beyond those of the devices.
    """
    draw = random.Random(seed)
    start = draw.choice((1000, draw.randrange(2**32), 2**32 - draw.randrange(4 * ticks + 4)))
    gyro = [_OFFSET, _OFFSET]
    revolutions = [0, 0]
    battery = 8003
    for tick in range(ticks):
        elapsed = tick * TS1_MS
        for plane in (0, 1):
            gyro[plane] = _OFFSET + round(draw.gauss(0.0, 2.0))
            revolutions[plane] += round(draw.gauss(0.0, 3.0))
            if out_of_range and draw.random() < 0.1:
                gyro[plane] = draw.choice((0, 1023, 65535, draw.randrange(1024)))
            if out_of_range and draw.random() < 0.05:
                limit = draw.choice((100, 2000, _MAX_INT32))
                revolutions[plane] = draw.randint(-limit, limit)
            revolutions[plane] = max(-_MAX_INT32, min(_MAX_INT32, revolutions[plane]))
        if out_of_range and draw.random() < 0.02:
            battery = draw.choice((0, 573, 574, 65535, draw.randrange(65536)))
        inputs = DeviceInputs(
            gyro=(gyro[0], gyro[1]),
            revolutions=(revolutions[0], revolutions[1]),
            sonar_cm=_distance(draw) if elapsed % _SONAR_MS == 0 else None,
            battery_mv=battery if elapsed % _BATTERY_MS == 0 else None,
            sticks=_sticks(draw, out_of_range) if draw.random() < 0.2 else None,
        )
        yield ProgramInput(elapsed, (start + elapsed) & UINT32_MASK, inputs)


def path_steps(parameters: ControllerParameters) -> Iterator[ProgramInput]:
    """Yield inputs that lead the program through all modes, however long these last.

    The system time jumps to the end of the calibration, to the start of autonomous drive, and, when
    control has been lost, to the stop. A time that leaves less than 2 s until the counter wraps
    around is never reached.
    """
    latest = UINT32_MASK - 5 * _PHASE_MS
    start, skipped = 1000, 0
    for step in random_steps(0, 4 * _PHASE_MS // TS1_MS, out_of_range=False):
        elapsed, inputs = step.elapsed_ms, step.inputs
        if elapsed == _PHASE_MS:
            skipped = max(0, min(parameters.time_start, latest) - elapsed)
        elif elapsed == 2 * _PHASE_MS:
            skipped = max(skipped, min(parameters.time_auto, latest) - elapsed)
        elif elapsed == 3 * _PHASE_MS:
            skipped += min(parameters.time_stop, latest)
        if elapsed >= 3 * _PHASE_MS:
            inputs = inputs._replace(revolutions=(_MAX_INT32, -_MAX_INT32))
        yield ProgramInput(elapsed, (start + elapsed + skipped) & UINT32_MASK, inputs)


def _distance(draw: random.Random) -> int:
    return draw.choice((NO_ECHO_CM, NO_ECHO_CM, NO_DATA_CM, 0, draw.randrange(NO_ECHO_CM)))


def _sticks(draw: random.Random, out_of_range: bool) -> tuple[int, int]:
    low, high = (-128, 127) if out_of_range else (-100, 100)
    return draw.choice((low, 0, high, draw.randint(low, high))), draw.randint(low, high)


class EquivalenceResult(NamedTuple):
    """The number of compared ticks, and the first difference as text; '' if there is none."""

    ticks: int
    difference: str = ''


def compare(
    parameters: ControllerParameters, compiled: CompiledProgram, steps: Iterable[ProgramInput]
) -> EquivalenceResult:
    """Run both programs, the compiled one newly created, on the same inputs until they differ.

    Duties, log packets, tones, display pages and every bit of the shared data are compared after
    each tick. It raises CodegenError if the compiled program has ended.
    """
    generated = program_of(parameters)
    python = generated.counterpart(parameters)
    # That of the folder may differ.
    schedule, compiled_schedule = Schedule(python.tasks), Schedule(compiled.tasks)
    ticks = 0
    # Suppress warnings: a battery far below its range gives a motor voltage of zero, so infinities
    # are part of the test.
    with np.errstate(all='ignore'):
        for step in steps:
            elapsed_ms, systick_ms, inputs = step
            expected = python.run(schedule.due(elapsed_ms), systick_ms, inputs)
            outputs = compiled.run(compiled_schedule.due(elapsed_ms), systick_ms, inputs)
            ticks += 1
            state, in_c = generated.state_bytes(python), compiled.state
            if outputs != expected or in_c[: len(state)] != state:  # padding may follow
                wanted = {**generated.named_values(state), **asdict(expected)}
                got = {**generated.named_values(in_c), **asdict(outputs)}
                return EquivalenceResult(ticks, _difference(step, wanted, got))
    return EquivalenceResult(ticks)


def _difference(step: ProgramInput, wanted: Mapping[str, Any], got: Mapping[str, Any]) -> str:
    """Return the first difference in the order of computation: data, then outputs."""
    # Compare the values as text: zeros of different sign are equal as numbers.
    name = next(name for name in wanted if repr(wanted[name]) != repr(got[name]))
    return f'at {step.elapsed_ms} ms {name} is {got[name]!r} in C and {wanted[name]!r} in Python'


@dataclass(frozen=True)
class TaskCost:
    """Cost of a task: the most instructions of a call, and the most stack."""

    name: str
    is_periodic: bool
    instructions: int
    stack_bytes: int


_PATHS = (
    'init', 'calibration', 'control', 'stop', 'log', 'obstacle', 'state', 'tone', 'display',
)  # fmt: skip
_ONLY_PATHS = {'task_init': 'init', 'task_ts2': 'obstacle', 'task_lcd': 'display'}
"""Paths of the tasks that have only one."""

_ADDED_TO = {'log': 'control', 'tone': 'state'}
"""Paths whose count is an addition to that of another one."""


class TaskCall(NamedTuple):
    """A call of a task: what determines its path, and its instructions."""

    task: str
    control_mode: ControlMode | None
    has_logged: bool
    has_tone: bool
    instructions: int

    @property
    def path(self) -> str:
        """The path of the call: its parameter is ``<path>_instructions``."""
        if self.task == 'task_ts1':
            if self.control_mode == ControlMode.CONTROL:
                return 'log' if self.has_logged else 'control'
            return 'calibration' if self.control_mode == ControlMode.CALIBRATION else 'stop'
        if self.task == 'task_ts3':
            return 'tone' if self.has_tone else 'state'
        return _ONLY_PATHS[self.task]


def path_instructions(calls: Iterable[TaskCall]) -> dict[str, int]:
    """Return the most instructions of each path, by parameter; none of a path not taken.

    Only the document's program has parameters for its paths.

    If each call of task_ts1 in control sends a packet, or each of task_ts3 starts a tone, the
    addition is 0.
    """
    most: dict[str, int] = {}
    for call in calls:
        if call.control_mode is None:
            continue
        most[call.path] = max(most.get(call.path, 0), call.instructions)
    for path, base in _ADDED_TO.items():
        if path in most:
            most[path] = max(0, most[path] - most.setdefault(base, most[path]))
    return {f'{path}_instructions': most[path] for path in _PATHS if path in most}


class ProgramCost(NamedTuple):
    """Cost of the program on the brick, without the platform.

    `instructions` are the most of each path, by parameter.
    """

    tasks: Sequence[TaskCost]
    instructions: Mapping[str, int]
    memory: Memory


def read_folder_parameters(folder: Path) -> ParameterSet:
    """Return the parameters of a generated folder; raise BallbotError if it is not valid."""
    file = folder / PARAMETER_FILE
    if not file.is_file():
        raise CodegenError(f'{file}: not found; the folder was not written by ballbot codegen')
    parameters = read_parameter_file(file)
    compose_controller(parameters)
    return parameters


class BuiltApplication:
    """A generated folder, built for a target in the folder `scratch`.

    It raises CodegenError if the folder is incomplete, or can't be built.
    """

    def __init__(self, folder: Path, target: Target, scratch: Path) -> None:
        self._parameters = read_folder_parameters(folder).of(ControllerParameters)
        self._tasks = read_tasks(folder)
        self._scratch = scratch
        self._command = build(folder, target, scratch)
        self._stack = [0] * len(self._tasks)

    def _start(self) -> CompiledProgram:
        parameters = self._parameters
        return program_of(parameters).start(self._command, self._tasks, parameters)

    def compare(self, sequences: Sequence[InputSequence]) -> EquivalenceResult:
        """Run the C and the Python program on the same inputs until they differ."""
        ticks = 0
        for sequence in sequences:
            program = self._start()
            result = compare(self._parameters, program, sequence.steps)
            ticks += result.ticks
            if result.difference:
                return EquivalenceResult(ticks, f'{sequence.name}, {result.difference}')
            self._stack = list(map(max, self._stack, program.stack_bytes))
        return EquivalenceResult(ticks)

    def cost(self, sequences: Sequence[InputSequence]) -> ProgramCost:
        """Measure instructions on `sequences`, and memory; stack usage is that of comparisons."""
        calls = self.calls(sequences)
        worst = dict.fromkeys((task.name for task in self._tasks), 0)
        for call in calls:
            worst[call.task] = max(worst[call.task], call.instructions)
        tasks = [
            TaskCost(task.name, bool(task.period_ms), worst[task.name], stack)
            for task, stack in zip(self._tasks, self._stack, strict=True)
        ]
        memory = measure_memory(self._scratch, len(self._tasks))
        return ProgramCost(tasks, path_instructions(calls), memory)

    def calls(self, sequences: Iterable[InputSequence]) -> list[TaskCall]:
        """Run `sequences`, and return the calls of all tasks, in order."""
        return [call for sequence in sequences for call in self._calls(sequence)]

    def _calls(self, sequence: InputSequence) -> Iterator[TaskCall]:
        program, requests = self._start(), list[bytes]()
        exchange = program.exchange

        def recorded(request: bytes) -> Answer:
            requests.append(request)
            return exchange(request)

        program.exchange = recorded
        schedule = Schedule(self._tasks)
        paths = []
        for elapsed_ms, systick_ms, inputs in sequence.steps:
            for number, task in enumerate(schedule.due(elapsed_ms)):
                # A request for each task, which tells what this one has done.
                flags = SAME_TICK if number else 0
                outputs = program.run([task], systick_ms, inputs, flags)
                paths.append((task, program.control_mode, bool(outputs.log), bool(outputs.tones)))
        names = [task.name for task in self._tasks]
        counts = count_instructions(self._command, requests, names)
        for path, count in zip(paths, counts, strict=True):
            yield TaskCall(*path, count)
