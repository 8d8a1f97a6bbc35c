"""Compilers and emulator: finding them, and building a folder for a target."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ballbot_ros.controllers.codegen.application import C_SOURCES, read_tasks
from ballbot_ros.errors import CodegenError
from ballbot_ros.files import read_bytes, write_temporary

TARGET_FOLDER = Path(__file__).parent / 'target'
"""Stand-ins for the platform: headers, and the brick around the program."""

WARNINGS = (
    '-Wall', '-Wextra', '-Wpedantic', '-Wshadow', '-Wconversion', '-Wdouble-promotion',
    '-Wfloat-conversion', '-Werror',
)  # fmt: skip
"""Warnings, all of them errors; they reject accidental doubles and lossy conversions, too."""

DETERMINISM_FLAGS = ('-ffp-contract=off', '-fsigned-char')


@dataclass(frozen=True)
class Tool:
    """A command and its Debian package.

    If the command is a compiler, `file` is another file that it requires; '' for none.
    """

    command: str
    package: str
    file: str = ''

    @property
    def missing(self) -> bool:
        """Whether the command or the file is missing."""
        if shutil.which(self.command) is None:
            return True
        if not self.file:
            return False
        # A compiler prints the path of a file that it finds, and the bare name of any other.
        found = run_tool([self.command, f'-print-file-name={self.file}']).strip()
        return not Path(found).is_absolute()


@dataclass(frozen=True)
class Target:
    """A machine to build the generated program for.

    `flags` are for compiling and linking; `runner` is the command that runs the executable.
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
    flags=('-std=c99', '-O2', *DETERMINISM_FLAGS),
    link_flags=('-lm',),
    runner=(),
    tools=(Tool('gcc', 'gcc'), Tool('gcc', 'libc6-dev', 'crt1.o')),
)
ARM = Target(
    title='ARM7TDMI, emulated',
    compiler='arm-none-eabi-gcc',
    # The flags of nxtOSEK for the brick.
    flags=(
        '-std=gnu99', '-Os', '-ffreestanding', '-mcpu=arm7tdmi', '-mthumb', '-mthumb-interwork',
        '-ffunction-sections', '-fdata-sections', *DETERMINISM_FLAGS,
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
"""The targets by the value of the parameter ``implementation``."""


def missing_tool(target: Target) -> str:
    """Return which tool to install first for a target; '' if none is missing."""
    for tool in target.tools:
        if tool.missing:
            what = f'{tool.file} of {tool.command}' if tool.file else tool.command
            return f'{what} not found: install it with `apt install {tool.package}`'
    return ''


def build(
    folder: Path, target: Target, scratch: Path, extra_flags: Sequence[str] = ()
) -> list[str]:
    """Compile a generated folder together with the brick's stand-in; return its command.

    Objects and executable go to the folder `scratch`, created if necessary. The extra flags are for
    the generated files and for linking.

    Raises
    ------
    CodegenError
        If a tool or file is missing, or the compilation fails.
    """
    if reason := missing_tool(target):
        raise CodegenError(reason)
    tasks = [task.name for task in read_tasks(folder)]
    # Generate kernel_id.h from the OIL file, as the platform does.
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
        # Compile a copy, without the kernel_id.h that a build with the platform may have left.
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
    """Run a tool; return its output, or raise CodegenError with the first error that it reports."""
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, errors='replace', check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f'status {done.returncode}']
        first = next((line for line in lines if 'error' in line or 'undefined' in line), lines[0])
        raise CodegenError(f'{command[0]}: {first.strip()}')
    return done.stdout
