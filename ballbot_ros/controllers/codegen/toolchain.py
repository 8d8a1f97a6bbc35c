"""Compilers and emulator: building a folder for a target, and what the program costs there."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.controllers.codegen.application import C_SOURCES, STACK_BYTES, read_tasks
from ballbot_ros.errors import CodegenError, os_errors
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
        found = _run_tool([self.command, f'-print-file-name={self.file}']).strip()
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
    the generated files and for linking. It raises CodegenError if a tool or file is missing, or the
    compilation fails.
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
        with os_errors(CodegenError, folder / name):
            source = read_bytes(folder / name)
        # Compile a copy, without the kernel_id.h that a build with the platform may have left.
        write_temporary(scratch / name, source)
        _run_tool(
            [target.compiler, *target.flags, *WARNINGS, *extra_flags, *includes, '-c', name,
             '-o', _object_file(name)],
            scratch,
        )  # fmt: skip
    _run_tool(
        [target.compiler, *target.flags, '-std=gnu99', '-Wall', '-Wextra', '-Werror', *includes,
         '-c', str(TARGET_FOLDER / 'brick.c'), '-o', 'brick.o'],
        scratch,
    )  # fmt: skip
    objects = [_object_file(name) for name in (*C_SOURCES, 'brick.c')]
    _run_tool([target.compiler, *extra_flags, *objects, *target.link_flags, '-o', 'brick'], scratch)
    return [*target.runner, str((scratch / 'brick').resolve())]


def _object_file(source: str) -> str:
    """Return the name of a source's object file."""
    return str(Path(source).with_suffix('.o'))


def _run_tool(command: Sequence[str], folder: Path | None = None) -> str:
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


CLOCK_HZ = 48e6
SRAM_BYTES, FLASH_BYTES = 64 * 1024, 224 * 1024
CYCLES_PER_INSTRUCTION = 2.0
"""ARM's average for the ARM7TDMI is 1.9, without wait states, as in the brick's SRAM."""

FLASH_FACTOR = 2.0
"""The flash has one wait state at 48 MHz, so a fetch takes at most twice as long."""

_SECTIONS = ('.text', '.rodata', '.data', '.bss')
_STAND_IN_FUNCTIONS = ('memcpy', 'memset', 'strcpy', 'strlen')
_SYMBOL = re.compile(r'^([0-9a-f]+) (?:([0-9a-f]+) )?[tTwW] (\S+)$', re.MULTILINE)


class Memory(NamedTuple):
    """Size of the program with the arithmetic routines that it links, without the platform.

    It has the sections, and the stacks of all tasks.
    """

    text: int
    rodata: int
    data: int
    bss: int
    stacks: int

    @property
    def rxe_sram(self) -> int:
        """SRAM of an RXE or RAM image, which is loaded there completely."""
        return sum(self)

    @property
    def rom_sram(self) -> int:
        """SRAM of a ROM image: its data and stacks."""
        return self.data + self.bss + self.stacks

    @property
    def rom_flash(self) -> int:
        """Flash of a ROM image: its code, constants and initial values."""
        return self.text + self.rodata + self.data


def measure_memory(scratch: Path, task_count: int) -> Memory:
    """Return the memory of the program that the toolchain has built for ARM."""
    objects = [_object_file(name) for name in C_SOURCES]
    # Link the soft-float routines, but not the platform's functions.
    _run_tool(
        [ARM.compiler, *ARM.link_flags[:3], '-nostartfiles', '-Wl,--unresolved-symbols=ignore-all',
         '-Wl,--entry=0', *objects, '-lm', '-o', 'application'],
        scratch,
    )  # fmt: skip
    listing = _run_tool(['arm-none-eabi-size', '-A', 'application'], scratch)
    sizes = {words[0]: int(words[1]) for words in map(str.split, listing.splitlines()[2:]) if words}
    text, rodata, data, bss = (sizes.get(section, 0) for section in _SECTIONS)
    return Memory(text, rodata, data, bss, STACK_BYTES * task_count)


def count_instructions(
    command: Sequence[str], requests: Sequence[bytes], tasks: Sequence[str]
) -> list[int]:
    """Return the number of instructions of each call of a task, in order.

    The emulator logs each block of instructions at its translation and at each execution; a count
    is the sum of the lengths of the executed blocks. Instructions of the brick's stand-in don't
    count, as the brick has the platform's device functions instead. `command` runs the program
    built for ARM, with the requests as its input.

    It raises CodegenError if the emulator fails, or logs no instruction of a call.
    """
    executable = Path(command[-1])
    symbols = _symbols(executable)
    entries = {symbols[f'TaskMain_{name}'][0] for name in tasks}
    leave = symbols['task_returned'][0]
    # The brick's stand-in, and the functions that only it calls.
    others = (*_symbols(executable.with_name('brick.o')), *_STAND_IN_FUNCTIONS)
    ranges = [symbols[name] for name in others if name in symbols]
    device_functions = {at for start, size in ranges for at in range(start, start + size, 2)}
    counts: list[int] = []
    lengths: dict[int, int] = {}
    block, in_task = -1, False
    trace = executable.with_name('trace.log')
    done = subprocess.run(
        [*command[:-1], '-d', 'nochain,exec,in_asm', '-D', str(trace), str(executable)],
        input=b''.join(requests), stdout=subprocess.DEVNULL, check=False,
    )  # fmt: skip
    with trace.open('rb') as log:
        for line in log:
            if line.startswith(b'0x'):
                # 0x<address>:  <code>  <instruction>, in a block that is being translated
                if block < 0:
                    block = int(line[2 : line.index(b':')], 16)
                    lengths[block] = 0
                lengths[block] += 1
            elif line.startswith(b'Trace'):
                # Trace 0: <host address> [<cs base>/<address>/<flags>/<flags>] <symbol>
                address, block = int(line.split(b'/', 2)[1], 16), -1
                if address in entries:
                    in_task = True
                    counts.append(lengths[address])
                elif address == leave:
                    in_task = False
                elif in_task and address not in device_functions:
                    counts[-1] += lengths[address]
    if done.returncode or not counts or not all(counts):
        raise CodegenError(f'{command[0]}: no instructions counted, status {done.returncode}')
    return counts


def _symbols(path: Path) -> dict[str, tuple[int, int]]:
    """Return address and size of every function in an object file or executable."""
    listing = _run_tool(['arm-none-eabi-nm', '-S', str(path)])
    return {
        name: (int(address, 16) & ~1, int(size or '0', 16))
        for address, size, name in _SYMBOL.findall(listing)
    }
