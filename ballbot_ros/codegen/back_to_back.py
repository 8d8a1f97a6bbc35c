"""Bit-for-bit comparison of the compiled program with the Python one, on the same inputs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import NamedTuple

import numpy as np

from ballbot_ros.brick.brick import DeviceOutputs
from ballbot_ros.codegen.compiled_program import CompiledProgram
from ballbot_ros.codegen.state_variables import members, named_values, state_bytes
from ballbot_ros.codegen.steps import ProgramInput
from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.parameters import ControllerParameters


class EquivalenceResult(NamedTuple):
    """The number of compared ticks, and the first difference as text; '' if there is none."""

    ticks: int
    difference: str = ''


def compare(
    parameters: ControllerParameters, compiled: CompiledProgram, steps: Iterable[ProgramInput]
) -> EquivalenceResult:
    """Run both programs, the compiled one newly created, on the same inputs until they differ.

    Duties, log packets, tones, display pages and every bit of the shared data are compared after
    each tick.

    Raises
    ------
    CodegenError
        If the compiled program has ended.
    """
    python = ControlProgram(parameters)
    ticks = 0
    # Suppress warnings: a battery far below its range gives a motor voltage of zero, so infinities
    # are part of the test.
    with np.errstate(all='ignore'):
        for step in steps:
            expected = python.tick(*step)
            outputs = compiled.tick(*step)
            ticks += 1
            state = state_bytes(python)
            if outputs != expected or members(compiled.state) != state:
                return EquivalenceResult(
                    ticks, _difference(step, expected, outputs, state, compiled)
                )
    return EquivalenceResult(ticks)


def _difference(
    step: ProgramInput,
    expected: DeviceOutputs,
    outputs: DeviceOutputs,
    state: bytes,
    compiled: CompiledProgram,
) -> str:
    """Return the first difference in the order of computation: data, then outputs."""
    wanted = {**named_values(state), **asdict(expected)}
    got = {**named_values(compiled.state), **asdict(outputs)}
    # Compare the values as text: zeros of different sign are equal as numbers.
    name = next(name for name in wanted if repr(wanted[name]) != repr(got[name]))
    return f'at {step.elapsed_ms} ms {name} is {got[name]!r} in C and {wanted[name]!r} in Python'
