"""What differs between the programs that can be generated as C."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from ballbot_ros.controllers.codegen.compiled_program import BrickProcess, CompiledProgram
from ballbot_ros.controllers.codegen.implementation import implementation_for
from ballbot_ros.controllers.interface import Program
from ballbot_ros.parameters import ControllerParameters, Value
from ballbot_ros.robot.brick.schedule import TaskTiming


@dataclass(frozen=True)
class CVariable:
    """A variable or constant of the generated program, and its line in the data dictionary.

    A variable has the name of the Python program's attribute. The type is that of the variable, or
    of each of its elements; `initial` is the C expression that is assigned to them.
    """

    name: str
    c_type: str
    initial: str
    unit: str
    scaling: str
    description: str
    source: str
    length: int = 1

    @property
    def declarator(self) -> str:
        """Name, with the length of an array."""
        return f'{self.name}[{self.length}]' if self.length > 1 else self.name

    @property
    def text(self) -> str:
        """The value without C syntax."""
        return self.initial.strip('{}').replace('f', '').replace('U', '')

    @property
    def comment(self) -> str:
        """Meaning and unit."""
        unit = '' if self.unit in ('', '1') else f' [{self.unit}]'
        return self.description + unit


_LETTERS = {'float': 'f', 'S32': 'i', 'U32': 'I', 'U8': 'B'}


@dataclass(frozen=True)
class GeneratedProgram:
    """A program of which there is a template in C and a counterpart in Python.

    Attributes
    ----------
    name : str
        Value of ``--program``, and the folder of templates that replace those for all programs.
    title, image : str
        First line of the display, and name of the executable on the brick.
    implementation : str
        Value of ``controller.implementation`` for the counterpart in Python.
    variables : tuple of CVariable
        Members of the C structure ``ballbot``, in order.
    constants, tasks, settings, context : callable
        Constants in C, tasks, values for ``parameters.yaml``, and what the templates need besides.
    state_of : callable
        Returns the values of the counterpart's variables, in the order of the structure.
    compiled : type of CompiledProgram
        Runs the compiled C.
    duration : callable or None
        Returns the ticks until the program has ended by itself; None if it does not end.
    """

    name: str
    title: str
    image: str
    implementation: str
    variables: tuple[CVariable, ...]
    constants: Callable[[ControllerParameters], list[CVariable]]
    tasks: Callable[[ControllerParameters], tuple[TaskTiming, ...]]
    settings: Callable[[ControllerParameters], dict[str, Value]]
    context: Callable[[ControllerParameters], Mapping[str, object]]
    state_of: Callable[[Any], Sequence[Any]]
    compiled: type[CompiledProgram]
    duration: Callable[[ControllerParameters], int] | None = None

    @cached_property
    def _members(self) -> struct.Struct:
        return struct.Struct('<' + ''.join(
            f'{each.length}s' if each.length > 1 else _LETTERS[each.c_type]
            for each in self.variables
        ))  # fmt: skip

    @property
    def state_size(self) -> int:
        """Size of the C structure, including padding at the end."""
        return (self._members.size + 3) // 4 * 4

    def counterpart(self, parameters: ControllerParameters) -> Program:
        """Return the program in Python."""
        return implementation_for(replace(parameters, implementation=self.implementation)).make()

    def state_bytes(self, counterpart: Program) -> bytes:
        """Return the Python program's data in the layout of the C structure, without padding."""
        return self._members.pack(*self.state_of(counterpart))

    def named_values(self, state: bytes) -> dict[str, Any]:
        """Return every member of a C structure by its name in C, such as ``x.theta``."""
        values = self._members.unpack_from(state)
        return dict(zip((each.name for each in self.variables), values, strict=True))

    def start(
        self, command: Sequence[str], tasks: Sequence[TaskTiming], parameters: ControllerParameters
    ) -> CompiledProgram:
        """Start the compiled program by a command of ``toolchain.build``, or CodegenError."""
        exchange = BrickProcess(command, self.state_size).exchange
        return self.compiled(exchange, tasks, parameters, self.named_values)
