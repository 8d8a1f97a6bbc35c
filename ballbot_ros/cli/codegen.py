"""`ballbot codegen`: generate C for the brick, or prove it equal to the simulation."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ballbot_ros.cli.options import PATH, Choice
from ballbot_ros.cli.progress import ProgressLines, stderr_console
from ballbot_ros.controllers.codegen.application import (
    STACK_BYTES,
    parameter_hash,
    write_application,
    write_times,
)
from ballbot_ros.controllers.codegen.folder_check import (
    BuiltApplication,
    ProgramCost,
    read_folder_parameters,
)
from ballbot_ros.controllers.codegen.generated_program import GeneratedProgram
from ballbot_ros.controllers.codegen.implementation import compose_controller
from ballbot_ros.controllers.codegen.programs import BALANCE, COMMISSIONING, PROGRAMS
from ballbot_ros.controllers.codegen.toolchain import (
    ARM,
    CLOCK_HZ,
    CYCLES_PER_INSTRUCTION,
    FLASH_BYTES,
    FLASH_FACTOR,
    HOST,
    SRAM_BYTES,
    missing_tool,
)
from ballbot_ros.controllers.document.axis import TS1_MS
from ballbot_ros.engine.scenario_steps import MEASURED_SEQUENCES, check_sequences
from ballbot_ros.errors import CodegenError, RecordingError
from ballbot_ros.files import own_command, share_directory, shown_path, temporary_folder
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.robot.brick.bluetooth import SAFE_LOG_MS


def generate(
    folder: Path, generated: GeneratedProgram, parameter_file: Path | None, mode: str | None
) -> None:
    """Write the application into `folder`."""
    parameters = _read(parameter_file) if parameter_file else ParameterSet()
    parameters.set(CONTROLLER, 'implementation', generated.implementation)
    compose_controller(parameters)
    if mode:
        parameters.set(CONTROLLER, 'mode', mode)
    values = parameters.of(ControllerParameters)
    for path in write_application(folder, values):
        print(path)
    again = own_command('codegen', '--check', folder)
    print(f'parameters {parameter_hash(values)}; check with: {again}')
    if generated is BALANCE:
        _warn_of_dead_time(parameters)
        _warn_of_fast_log(values.log_count)


def _warn_of_dead_time(parameters: ParameterSet) -> None:
    """Warn if the loop does not bear the dead time of a brick, and name gains that do."""
    # Imported only here: it takes a second.
    from ballbot_ros.controllers.design.loop_analysis import brick_dead_time

    borne, needed = brick_dead_time(parameters)
    if borne > needed:
        return
    lines = [
        f'warning: with these gains the loop bears {borne:.1f} ms of dead time, but link and tasks',
        f'of a brick take {needed:.1f} ms on average: the robot will rattle',
    ]
    for file in sorted((share_directory() / 'config' / 'gains').glob('*.yaml')):
        gains = ParameterSet(parameters)
        gains.update(read_parameter_file(file))
        borne, needed = brick_dead_time(gains)
        if borne > needed:
            lines.append(f'gains that bear {borne:.1f} ms: --params {shown_path(file)}')
    stderr_console().print('\n'.join(lines), style='yellow', soft_wrap=True)


def _warn_of_fast_log(log_count: int) -> None:
    """Warn if log packets follow each other faster than is known to be safe on a brick."""
    if (period := log_count * TS1_MS) < SAFE_LOG_MS:
        line = (
            f'warning: controller.log_count {log_count}: a log packet every {period} ms, below '
            f'{SAFE_LOG_MS} ms, can corrupt the log (nxtOSEK user: with 4 ms, not with 50 ms)'
        )
        stderr_console().print(line, style='yellow', soft_wrap=True)


def _read(path: Path) -> ParameterSet:
    """Read a parameter file, or the parameters of the last run of a recording."""
    if path.suffix != '.mcap':
        return read_parameter_file(path)
    # Imported only here: it takes half a second.
    from ballbot_ros.analysis.run_data import read_run

    run = read_run(path)
    if run.is_real:
        raise RecordingError(f'{path}: of a real robot; give the parameter file of its program')
    if not run.attached.has_parameters:
        raise RecordingError(f'{path}: no parameters found, neither attached nor announced')
    return run.attached.parameters


def check(folder: Path) -> int:
    """Compare and measure the application in `folder`; return 0 if it is equal, else 1.

    The measured instructions are also written there. It raises CodegenError if the folder is
    incomplete; or, after all checks that are possible, if a tool is missing, or the instructions
    can't be written.
    """
    parameters = read_folder_parameters(folder)
    sequences = check_sequences(parameters)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    skipped = ''
    for name, target in (('software', HOST), ('processor', ARM)):
        if reason := missing_tool(target):
            skipped = skipped or f'{name} in the loop was not checked: {reason}'
            line = f'  {name} in the loop: {reason}'
            console.print(Text.assemble(('skipped', 'yellow'), line))
            continue
        with temporary_folder() as scratch:
            built = BuiltApplication(folder, target, Path(scratch))
            result = built.compare(sequences)
            title = f'{name} in the loop ({target.title})'
            if result.difference:
                line = f'  {title}: {result.difference}'
                console.print(Text.assemble(('DIFFERS', 'red'), line))
                return 1
            line = f'    {title}: {result.ticks} ticks of {len(sequences)} sequences'
            console.print(Text.assemble(('equal', 'green'), line))
            if target is ARM:
                cost = built.cost(sequences[-MEASURED_SEQUENCES:])
                _print_cost(console, cost)
                if cost.instructions:
                    values = parameters.of(ControllerParameters)
                    print(write_times(folder, values, cost.instructions))
    if skipped:
        raise CodegenError(skipped)
    return 0


def _print_cost(console: Console, cost: ProgramCost) -> None:
    """Print instructions, time and memory on the brick."""
    table = Table('task', title='On the brick, without the platform', title_justify='left')
    for heading in (
        'instructions',
        f'time at {CLOCK_HZ / 1e6:.0f} MHz',
        f'of {TS1_MS} ms',
        f'stack of {STACK_BYTES} B',
    ):
        table.add_column(heading, justify='right')
    for task in cost.tasks:
        table.add_row(task.name, *_time(task.instructions), f'{task.stack_bytes} B')
    periodic = sum(task.instructions for task in cost.tasks if task.is_periodic)
    table.add_row('all periodic', *_time(periodic), '')
    console.print(table)
    console.print(
        f'Most instructions of a call, counted by qemu; {CYCLES_PER_INSTRUCTION:g} '
        f'cycles each from SRAM, at most {FLASH_FACTOR:g} times that from flash.'
    )
    memory = cost.memory
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
    '--program',
    'name',
    type=Choice([*PROGRAMS]),
    help='With --output: the program that balances, or the one that measures gyros and motors on a '
    'stand.  [default: balance]',
)
@click.option(
    '--params',
    type=PATH,
    help='With --output: file with the parameters, or recording to take those of the last run.  '
    "[default: the parameters' defaults]",
)
@click.option(
    '--mode',
    type=Choice(['remote', 'autonomous']),
    help="With --output: drive mode.  [default: the parameter file's, or remote]",
)
@click.option(
    '--check',
    'checked',
    type=PATH,
    help='Folder to compare with the Python controller, bit for bit, on this machine and on an '
    'emulated ARM processor, and to measure; writes times.yaml there.',
)
def command(
    output: Path | None,
    name: str | None,
    params: Path | None,
    mode: str | None,
    checked: Path | None,
) -> int:
    """Generate a program as C, an nxtOSEK application; or check such a folder.

    Exit status: 0 if it was written, or is equal; 1 if it differs; 2 for invalid arguments, or
    if a tool that a check needs is missing.
    """
    if (output is None) == (checked is None):
        raise click.UsageError('give either --output DIR or --check DIR')
    if checked and (name or params or mode):
        raise click.UsageError(
            '--program, --params and --mode require --output; --check uses what the folder has'
        )
    if mode and name == COMMISSIONING.name:
        raise click.UsageError(f'--mode: the program {name} does not drive')
    if checked:
        with ProgressLines(f'checking {checked}', stderr_console()):
            return check(checked)
    assert output
    generate(output, PROGRAMS[name or BALANCE.name], params, mode)
    return 0
