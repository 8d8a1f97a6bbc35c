"""Selection of the control program: the Python one, or its generated C on some machine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ballbot_ros.codegen.errors import CodegenError
from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.controllers.interface import Program
from ballbot_ros.parameters import ControllerParameters


def missing_tool_for(name: str) -> str:
    """Return which tool to install first for an implementation; '' if none is missing."""
    if name == 'python':
        return ''
    from ballbot_ros.codegen.toolchain import TARGETS, missing_tool

    return missing_tool(TARGETS[name])


def require_implementation(name: str) -> None:
    """Raise CodegenError, which names the Debian package, if an implementation lacks a tool."""
    if reason := missing_tool_for(name):
        raise CodegenError(reason)


def program_maker(parameters: ControllerParameters) -> Callable[[], Program]:
    """Return a function that creates programs of the selected implementation.

    C is generated and compiled once, here; each program is then a separate process.

    Raises
    ------
    CodegenError
        If a tool is missing or the C does not build.
    """
    if parameters.implementation == 'python':
        return lambda: ControlProgram(parameters)

    from ballbot_ros.codegen.application import read_tasks, write_application
    from ballbot_ros.codegen.brick_process import BrickProcess
    from ballbot_ros.codegen.compiled_program import CompiledProgram
    from ballbot_ros.codegen.toolchain import TARGETS, build
    from ballbot_ros.files import temporary_folder

    scratch = temporary_folder()
    folder = Path(scratch.name) / 'application'
    write_application(folder, parameters)
    target = TARGETS[parameters.implementation]
    command = build(folder, target, Path(scratch.name) / 'build')
    tasks = read_tasks(folder)

    def make() -> Program:
        # Refer to `scratch`, so that its folder exists as long as programs may be created.
        assert scratch
        return CompiledProgram(BrickProcess(command), tasks, parameters.mode == 'autonomous')

    return make
