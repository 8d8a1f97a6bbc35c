"""Compilers and the emulator: what is there, and building a folder for a target."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ballbot_ros.codegen.application import C_SOURCES, read_tasks
from ballbot_ros.codegen.errors import CodegenError
from ballbot_ros.files import read_bytes, write_temporary

TARGET_FOLDER = Path(__file__).parent / 'target'
"""Stand-ins for the platform: headers, and the brick around the program."""

WARNINGS = (
    '-Wall', '-Wextra', '-Wpedantic', '-Wshadow', '-Wconversion', '-Wdouble-promotion',
    '-Wfloat-conversion', '-Werror',
)  # fmt: skip
"""A double that slips in, or an operation rounded elsewhere than written, does not compile."""

ONE_ROUNDING = ('-ffp-contract=off', '-fsigned-char')


@dataclass(frozen=True)
class Tool:
    """A command, and the Debian package it comes in.

    Attributes
    ----------
    file : str
        A file that the command, a compiler, must find besides; empty for none.
    """

    command: str
    package: str
    file: str = ''

    @property
    def missing(self) -> bool:
        """Whether it is not installed."""
        if shutil.which(self.command) is None:
            return True
        if not self.file:
            return False
        # Where a compiler does not find a file it answers with the bare name.
        found = run_tool([self.command, f'-print-file-name={self.file}']).strip()
        return not Path(found).is_absolute()


@dataclass(frozen=True)
class Target:
    """A machine that the generated program is built for.

    Attributes
    ----------
    title : str
        The machine in words.
    compiler : str
    flags : tuple of str
        For compiling; and linking.
    link_flags : tuple of str
    runner : tuple of str
        Command that runs the executable.
    tools : tuple of Tool
    """

    title: str
    compiler: str
    flags: tuple[str, ...]
    link_flags: tuple[str, ...]
    runner: tuple[str, ...]
    tools: tuple[Tool, ...]


HOST = Target(
    title='this machine',
    compiler='gcc',
    flags=('-std=c99', '-O2', *ONE_ROUNDING),
    link_flags=('-lm',),
    runner=(),
    tools=(Tool('gcc', 'gcc'), Tool('gcc', 'libc6-dev', 'crt1.o')),
)
ARM = Target(
    title='ARM7TDMI, emulated',
    compiler='arm-none-eabi-gcc',
    # As nxtOSEK compiles for the brick.
    flags=(
        '-std=gnu99', '-Os', '-ffreestanding', '-mcpu=arm7tdmi', '-mthumb', '-mthumb-interwork',
        '-ffunction-sections', '-fdata-sections', *ONE_ROUNDING,
    ),
    link_flags=('-mcpu=arm7tdmi', '-mthumb', '-mthumb-interwork', '--specs=rdimon.specs', '-lm'),
    runner=('qemu-arm', '-cpu', 'arm926'),
    tools=(
        Tool('arm-none-eabi-gcc', 'gcc-arm-none-eabi'),
        Tool('arm-none-eabi-gcc', 'libnewlib-arm-none-eabi', 'rdimon.specs'),
        Tool('qemu-arm', 'qemu-user'),
    ),
)  # fmt: skip
TARGETS = {'c': HOST, 'arm': ARM}
"""By the value of the parameter ``implementation``."""


def missing_tool(target: Target) -> str:
    """Return what is to be installed first for a target, in words; empty if all is there."""
    for tool in target.tools:
        if tool.missing:
            what = f'{tool.file} of {tool.command}' if tool.file else tool.command
            return f'{what} is not there: install the Debian package {tool.package}'
    return ''


def require_tools(target: Target) -> None:
    """Make sure that a target's tools are there.

    Raises
    ------
    CodegenError
        If one is missing; the text names its package.
    """
    if reason := missing_tool(target):
        raise CodegenError(reason)


def build(
    folder: Path, target: Target, scratch: Path, extra_flags: Sequence[str] = ()
) -> list[str]:
    """Compile a generated folder together with the brick's stand-in.

    Parameters
    ----------
    folder : Path
        The generated application.
    target : Target
    scratch : Path
        Where objects and executable go; made if it is not there.
    extra_flags : sequence of str
        Added for the generated files and for linking.

    Returns
    -------
    list of str
        The command that runs it.

    Raises
    ------
    CodegenError
        If a tool or a file is missing, or the compiler complains.
    """
    require_tools(target)
    tasks = [task.name for task in read_tasks(folder)]
    # On the platform this file is made from the OIL file too.
    kernel_id = (
        ''.join(f'DeclareTask({name});\n' for name in tasks)
        + f'#define TASK_COUNT {len(tasks)}\n'
        + f'#define FOR_EACH_TASK(X) {" ".join(f"X({name})" for name in tasks)}\n'
    )
    write_temporary(scratch / 'kernel_id.h', kernel_id.encode())
    includes = [f'-I{path}' for path in (scratch.resolve(), folder.resolve(), TARGET_FOLDER)]
    for name in C_SOURCES:
        try:
            source = read_bytes(folder / name)
        except OSError as error:
            raise CodegenError(f'{folder / name}: {error.strerror}') from None
        # Beside the original may lie the kernel_id.h of a build with the platform.
        write_temporary(scratch / name, source)
        run_tool(
            [target.compiler, *target.flags, *WARNINGS, *extra_flags, *includes, '-c', name,
             '-o', object_file(name)],
            scratch,
        )  # fmt: skip
    run_tool(
        [target.compiler, *target.flags, '-std=gnu99', '-Wall', '-Wextra', '-Werror', *includes,
         '-c', str(TARGET_FOLDER / 'brick.c'), '-o', 'brick.o'],
        scratch,
    )  # fmt: skip
    objects = [object_file(name) for name in (*C_SOURCES, 'brick.c')]
    run_tool([target.compiler, *extra_flags, *objects, *target.link_flags, '-o', 'brick'], scratch)
    return [*target.runner, str((scratch / 'brick').resolve())]


def object_file(source: str) -> str:
    """Return the name of a source's object file."""
    return str(Path(source).with_suffix('.o'))


def run_tool(command: Sequence[str], folder: Path | None = None) -> str:
    """Run a tool; return what it prints.

    Raises
    ------
    CodegenError
        If it fails; the text is the first error that it reports.
    """
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, errors='replace', check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f'status {done.returncode}']
        first = next((line for line in lines if 'error' in line or 'undefined' in line), lines[0])
        raise CodegenError(f'{command[0]}: {first.strip()}')
    return done.stdout
