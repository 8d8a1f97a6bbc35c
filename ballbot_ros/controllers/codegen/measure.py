"""The cost of the program on the brick: instructions of each task, memory."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.controllers.codegen.application import C_SOURCES, STACK_BYTES
from ballbot_ros.controllers.codegen.toolchain import ARM, object_file, run_tool
from ballbot_ros.errors import CodegenError

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
    objects = [object_file(name) for name in C_SOURCES]
    # Link the soft-float routines, but not the platform's functions.
    run_tool(
        [ARM.compiler, *ARM.link_flags[:3], '-nostartfiles', '-Wl,--unresolved-symbols=ignore-all',
         '-Wl,--entry=0', *objects, '-lm', '-o', 'application'],
        scratch,
    )  # fmt: skip
    listing = run_tool(['arm-none-eabi-size', '-A', 'application'], scratch)
    sizes = {words[0]: int(words[1]) for words in map(str.split, listing.splitlines()[2:]) if words}
    text, rodata, data, bss = (sizes.get(section, 0) for section in _SECTIONS)
    return Memory(text, rodata, data, bss, STACK_BYTES * task_count)


def count_instructions(
    command: Sequence[str], requests: Sequence[bytes], tasks: Sequence[str]
) -> dict[str, int]:
    """Return the maximum number of instructions of a call of each task.

    The emulator logs each block of instructions at its translation and at each execution; a count
    is the sum of the lengths of the executed blocks. Instructions of the brick's stand-in don't
    count, as the brick has the platform's device functions instead. `command` runs the program
    built for ARM, with a request per tick.

    Raises
    ------
    CodegenError
        If the emulator fails, or logs no instruction.
    """
    executable = Path(command[-1])
    symbols = _symbols(executable)
    entries = {symbols[f'TaskMain_{name}'][0]: name for name in tasks}
    leave = symbols['task_returned'][0]
    device_functions = _addresses(symbols, _symbols(executable.with_name('brick.o')))
    worst = dict.fromkeys(tasks, 0)
    lengths: dict[int, int] = {}
    block, task, count = -1, '', 0
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
                    task, count = entries[address], lengths[address]
                elif address == leave:
                    worst[task] = max(worst[task], count)
                    task = ''
                elif task and address not in device_functions:
                    count += lengths[address]
    if done.returncode or not all(worst.values()):
        raise CodegenError(f'{command[0]}: no instructions counted, status {done.returncode}')
    return worst


def _symbols(path: Path) -> dict[str, tuple[int, int]]:
    """Return address and size of every function in an object file or executable."""
    listing = run_tool(['arm-none-eabi-nm', '-S', str(path)])
    return {
        name: (int(address, 16) & ~1, int(size or '0', 16))
        for address, size, name in _SYMBOL.findall(listing)
    }


def _addresses(symbols: Mapping[str, tuple[int, int]], names: Iterable[str]) -> set[int]:
    """Return every address of the brick's stand-in and of the functions that only it calls."""
    ranges = [symbols[name] for name in (*names, *_STAND_IN_FUNCTIONS) if name in symbols]
    return {address for start, size in ranges for address in range(start, start + size, 2)}
