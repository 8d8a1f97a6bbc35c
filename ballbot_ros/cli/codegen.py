"""`ballbot codegen`: write the C for the brick, or prove a folder equal to the simulation."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ballbot_ros.brick.schedule import TaskTiming
from ballbot_ros.cli.path_types import PATH
from ballbot_ros.codegen.application import (
    PARAMETER_FILE,
    STACK_BYTES,
    read_tasks,
    write_application,
)
from ballbot_ros.codegen.back_to_back import compare
from ballbot_ros.codegen.brick_process import Answer, BrickProcess
from ballbot_ros.codegen.c_parameters import parameter_hash
from ballbot_ros.codegen.compiled_program import CompiledProgram
from ballbot_ros.codegen.errors import CodegenError
from ballbot_ros.codegen.measure import (
    CLOCK_HZ,
    CYCLES_PER_INSTRUCTION,
    FLASH_BYTES,
    FLASH_FACTOR,
    SRAM_BYTES,
    count_instructions,
    measure_memory,
)
from ballbot_ros.codegen.steps import Step, random_steps
from ballbot_ros.codegen.toolchain import ARM, HOST, Target, build, missing_tool
from ballbot_ros.controller.tasks import TS1_MS
from ballbot_ros.files import temporary_folder
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.scenario.library import load_scenario, scenario_names
from ballbot_ros.simulation.scenario_steps import scenario_steps

RANDOM_SEQUENCES = 50
RANDOM_TICKS = 150
"""Length of a random sequence, beyond the calibration."""


def generate(folder: Path, parameter_file: Path | None, mode: str | None) -> None:
    """Write the application into `folder`."""
    parameters = _read(parameter_file) if parameter_file else ParameterSet()
    if mode:
        parameters.set(CONTROLLER, 'mode', mode)
    values = parameters.of(ControllerParameters)
    for path in write_application(folder, values):
        print(path)
    again = shlex.join(['ballbot', 'codegen', '--check', str(folder)])
    print(f'parameters {parameter_hash(values)}; check with: {again}')


def _read(path: Path) -> ParameterSet:
    """Read a parameter file, or what the last run of a recording had."""
    if path.suffix != '.mcap':
        return read_parameter_file(path)
    # Only here: it takes half a second to import.
    from ballbot_ros.analysis.run_data import read_run

    attached = read_run(path).attached
    if not attached.has_parameters:
        raise RecordingError(f'{path}: tells no parameters')
    return attached.parameters


def check(folder: Path) -> int:
    """Compare and measure the application in `folder`; return 0 if it is equal, else 1.

    Raises
    ------
    CodegenError
        If the folder is not complete, or a tool is missing, once all that is possible is done.
    """
    if not (folder / PARAMETER_FILE).is_file():
        raise CodegenError(
            f'{folder / PARAMETER_FILE}: no such file; not a folder of ballbot codegen'
        )
    parameters = read_parameter_file(folder / PARAMETER_FILE)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    sequences = _sequences(parameters)
    skipped = ''
    for name, target in (('software', HOST), ('processor', ARM)):
        if reason := missing_tool(target):
            skipped = skipped or f'{name} in the loop was not checked: {reason}'
            told = f'  {name} in the loop: {reason}'
            console.print(Text.assemble(('skipped', 'yellow'), told))
            continue
        with temporary_folder() as scratch:
            built = _Check(folder, target, parameters, Path(scratch))
            ticks, difference = built.compare(sequences)
            title = f'{name} in the loop ({target.title})'
            if difference:
                console.print(Text.assemble(('DIFFERS', 'red'), f'  {title}: {difference}'))
                return 1
            told = f'    {title}: {ticks} ticks of {len(sequences)} sequences'
            console.print(Text.assemble(('equal', 'green'), told))
            if target is ARM:
                built.print_cost(console, sequences[-2:])
    if skipped:
        raise CodegenError(skipped)
    return 0


class _Sequence(NamedTuple):
    name: str
    steps: Sequence[Step]


def _sequences(parameters: ParameterSet) -> list[_Sequence]:
    """Return the inputs of every shipped scenario, and random ones."""
    sequences = []
    for name in scenario_names():
        scenario = load_scenario(name)
        together = ParameterSet()
        together.update(scenario.parameters)
        together.update(parameters)
        sequences.append(_Sequence(name, list(scenario_steps(together, scenario))))
    calibration = int(parameters.of(ControllerParameters).time_start) // TS1_MS
    ticks = min(calibration, 2500) + RANDOM_TICKS
    for seed in range(RANDOM_SEQUENCES):
        steps = list(random_steps(seed, ticks, wild=seed % 2 == 1))
        sequences.append(_Sequence(f'random sequence {seed}', steps))
    return sequences


class _Tape:
    """A machine that notes what it is asked."""

    def __init__(self, machine: BrickProcess) -> None:
        self._machine = machine
        self.requests: list[bytes] = []

    def exchange(self, request: bytes) -> Answer:
        """Run a tick."""
        self.requests.append(request)
        return self._machine.exchange(request)


class _Check:
    """A folder built for a target."""

    def __init__(
        self, folder: Path, target: Target, parameters: ParameterSet, scratch: Path
    ) -> None:
        self._parameters = parameters.of(ControllerParameters)
        self._tasks: list[TaskTiming] = read_tasks(folder)
        self._scratch = scratch
        self._command = build(folder, target, scratch)
        self._stack = [0] * len(self._tasks)

    def _program(self, machine: BrickProcess | _Tape) -> CompiledProgram:
        return CompiledProgram(machine, self._tasks, self._parameters.mode == 'autonomous')

    def compare(self, sequences: Sequence[_Sequence]) -> tuple[int, str]:
        """Return the ticks compared, and the first difference in words."""
        ticks = 0
        for sequence in sequences:
            program = self._program(BrickProcess(self._command))
            comparison = compare(self._parameters, program, sequence.steps)
            ticks += comparison.ticks
            if comparison.difference:
                return ticks, f'{sequence.name}, {comparison.difference}'
            self._stack = list(map(max, self._stack, program.stack_bytes))
        return ticks, ''

    def print_cost(self, console: Console, sequences: Sequence[_Sequence]) -> None:
        """Print instructions, time and memory on the brick."""
        worst = dict.fromkeys((task.name for task in self._tasks), 0)
        for sequence in sequences:
            tape = _Tape(BrickProcess(self._command))
            program = self._program(tape)
            for step in sequence.steps:
                program.tick(*step)
            counted = count_instructions(self._command, tape.requests, list(worst))
            worst = {name: max(worst[name], counted[name]) for name in worst}

        table = Table(title='On the brick, without the platform', title_justify='left')
        table.add_column('task')
        for heading in (
            'instructions',
            f'time at {CLOCK_HZ / 1e6:.0f} MHz',
            f'of {TS1_MS} ms',
            f'stack of {STACK_BYTES} B',
        ):
            table.add_column(heading, justify='right')
        periodic = [task.name for task in self._tasks if task.period_ms]
        for task, stack in zip(self._tasks, self._stack, strict=True):
            table.add_row(task.name, *_time(worst[task.name]), f'{stack} B')
        table.add_row('all periodic', *_time(sum(worst[name] for name in periodic)), '')
        console.print(table)
        console.print(
            f'Most instructions that a call took, counted by qemu; {CYCLES_PER_INSTRUCTION:g} '
            f'cycles each from SRAM, at most {FLASH_FACTOR:g} times that from flash.'
        )
        memory = measure_memory(self._scratch, len(self._tasks))
        console.print(', '.join(f'{name} {size} B' for name, size in memory._asdict().items()))
        console.print(
            f'As an RXE or RAM image: SRAM {_share(memory.rxe_sram, SRAM_BYTES)}. As a ROM image: '
            f'SRAM {_share(memory.rom_sram, SRAM_BYTES)}, '
            f'flash {_share(memory.rom_flash, FLASH_BYTES)}.'
        )


def _share(size: int, available: int) -> str:
    return f'{size} B of {available} ({size / available:.1%})'


def _time(instructions: int) -> tuple[str, str, str]:
    seconds = instructions * CYCLES_PER_INSTRUCTION / CLOCK_HZ
    share = seconds / (TS1_MS * 1e-3)
    return str(instructions), f'{seconds * 1e6:.1f} µs', f'{share:.1%}'


@click.command('codegen')
@click.option('--output', type=PATH, help='Folder to write.')
@click.option(
    '--params',
    type=PATH,
    help='Parameter file, or recording of runs whose last one had the controller values, with '
    "--output.  [default: the table's]",
)
@click.option(
    '--mode',
    type=click.Choice(['remote', 'autonomous']),
    help="Drive mode, with --output.  [default: the parameter file's, or remote]",
)
@click.option(
    '--check',
    'checked',
    type=PATH,
    help='Folder to compare with the Python controller, bit for bit, on this machine and on an '
    'emulated ARM processor, and to measure.',
)
def command(
    output: Path | None, params: Path | None, mode: str | None, checked: Path | None
) -> int:
    """Write the controller as C, an nxtOSEK application; or check such a folder.

    Exit status: 0 if it was written, or is equal; 1 if it differs; 2 for a mistake in the
    arguments, or if a tool that a check needs is missing.
    """
    if (output is None) == (checked is None):
        raise click.UsageError('give either --output DIR or --check DIR')
    if checked and (params or mode):
        raise click.UsageError('--params and --mode go with --output; a folder has its own')
    if checked:
        return check(checked)
    assert output
    generate(output, params, mode)
    return 0
