"""Repeats the experiments of docs/tuning.md and docs/control.md: ``python -m benchmark.tune``.

They run the closed loop without ROS, with fixed seeds, so each prints the same table every time.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

from ballbot_ros.cli.command import invoke
from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.reader import load_profile
from ballbot_ros.engine.scenario.scenario import Scenario, Segment, StickSignal
from ballbot_ros.parameters import (
    CONTROLLER,
    GYRO,
    PLANT,
    SONAR,
    ControllerParameters,
    ParameterSet,
    Value,
)
from ballbot_ros.parameters.files import read_parameter_file
from ballbot_ros.robot.world.clearance import clearance
from benchmark.challenge import challenge
from benchmark.commissioning import commissioning
from benchmark.identification import identification
from benchmark.redesign import redesign
from benchmark.search import searches
from benchmark.tables import print_table

SEEDS = range(1, 6)
FULL_MOVES = (-100.0, 0.0, 100.0)
REVERSALS = (-100.0, 100.0)
DWELL_S = (0.1, 4.0)
FIRST_MOVE_S = 2.0
ERROR_HEAD = r'largest \|θ_ref − θ\|'
DRIVE_S, STEP_S, TRACK_S, STAND_S = 30.0, 20.0, 20.0, 300.0

GAINS = Path(__file__).parents[3] / 'config/gains'
LOW_PASSES = ('a_d', 'a_r', 'a_gd')

Settings = Mapping[tuple[str, str], Value]
"""Parameter values by node and name."""


class Outcome(NamedTuple):
    """Outcome of a run, which ends early at a fall or a wall hit.

    Attributes
    ----------
    fell, hit : bool
        Whether the robot fell, and whether it hit a wall.
    peak_pitch, rms_pitch : float
        Body pitch of both planes [deg].
    peak_error : float
        Largest error of the ball angle seen by the controller, of either plane [deg].
    peak_distance : float
        Largest distance of the ball from its start [m].
    clearance : float
        Smallest distance from the body to a wall [m]; inf without a map.
    """

    fell: bool
    hit: bool
    peak_pitch: float
    rms_pitch: float
    peak_error: float
    peak_distance: float
    clearance: float


def run(parameters: ParameterSet, seconds: float, scenario: Scenario | None = None) -> Outcome:
    """Run the closed loop for a time [s], or until the robot falls or hits a wall."""
    loop = ClosedLoop(parameters, scenario)
    start = loop.plant.truth().position
    program = loop.program
    assert isinstance(program, ControlProgram)
    peak_error = 0.0
    motion = []
    for tick in loop.ticks(seconds):
        truth = tick.truth
        if loop.plant.fallen or loop.plant.stopped:
            break
        errors = (float(plane.theta_diff) for plane in (program.x, program.y))
        peak_error = max(peak_error, *map(abs, errors))
        motion.append((*truth.psi, *truth.position))
    table = np.array(motion)
    pitch, position = np.degrees(table[:, :2]), table[:, 2:]
    return Outcome(
        fell=loop.plant.fallen,
        hit=loop.plant.stopped,
        peak_pitch=float(np.abs(pitch).max()),
        rms_pitch=float(np.sqrt(np.mean(pitch**2))),
        peak_error=peak_error,
        peak_distance=float(np.hypot(*(position - start).T).max()),
        clearance=float(clearance(loop.world.walls, position).min()) if loop.world else math.inf,
    )


def parameters_with(profile: str, settings: Settings) -> ParameterSet:
    """Return a profile's parameters, with those in `settings` replaced."""
    parameters = load_profile(profile)
    for (node, name), value in settings.items():
        parameters.set(node, name, value)
    return parameters


def drives(profile: str, moves: Sequence[float], settings: Settings) -> Iterator[Outcome]:
    """Yield the outcome of a run for each seed; both sticks jump among `moves` at random times."""
    for seed in SEEDS:
        generator = np.random.default_rng(seed)
        scenario = Scenario(
            vertical=_random_stick(generator, moves), horizontal=_random_stick(generator, moves)
        )
        parameters = parameters_with(profile, {(GYRO, 'seed'): seed, **settings})
        yield run(parameters, DRIVE_S, scenario)


def _random_stick(generator: np.random.Generator, moves: Sequence[float]) -> StickSignal:
    segments = []
    start = FIRST_MOVE_S
    while start < DRIVE_S:
        end = start + generator.uniform(*DWELL_S)
        segments.append(_held(start, end, float(generator.choice(moves))))
        start = end
    return StickSignal(segments)


def _held(start: float, end: float, value: float) -> Segment:
    return Segment('full stick', ((start, value), (end, value)))


def speed() -> None:
    """Compare speed gains in single full steps and in full reversals at 8 V."""
    rows = []
    for k_thetadot in (380.0, 441.0, 650.0):
        settings: Settings = {(CONTROLLER, 'k_thetadot'): k_thetadot}
        step = StickSignal([_held(FIRST_MOVE_S, math.inf, REVERSALS[0])])
        single = run(parameters_with('ideal', settings), STEP_S, Scenario(vertical=step))
        reversals = drives('ideal', REVERSALS, settings)
        rows.append((f'{k_thetadot:g}', _falls([single]), _falls(reversals)))
    print_table(('k_thetadot [deg/s]', 'falls at a full step', 'falls in full reversals'), rows)


def drive() -> None:
    """Drive hard, to find the errors and pitches that the thresholds must permit."""
    rows = []
    for profile, voltage in (
        ('ideal', 8.0), ('ideal', 7.0), ('hardware', 8.0), ('hardware', 7.5), ('hardware', 7.0),
    ):  # fmt: skip
        outcomes = list(drives(profile, FULL_MOVES, {(PLANT, 'battery_voltage'): voltage}))
        pitch = max(outcome.peak_pitch for outcome in outcomes)
        error = max(outcome.peak_error for outcome in outcomes)
        rows.append((f'{profile}, {voltage} V', _falls(outcomes), f'{pitch:.1f}°', f'{error:.0f}°'))
    print_table(('devices, battery', 'falls', 'peak pitch', ERROR_HEAD), rows)


def track() -> None:
    """Drive autonomously around the inner wall of the map track, by sonar cone and threshold."""
    starts = list(product((-0.75, -0.7, -0.6), (0.5, 0.55, 0.6)))
    rows = []
    for cone_angle, dst_thr in (
        (0.0, 30), (0.0, 40), (0.0, 50), (0.52, 30), (0.52, 40), (0.52, 50), (0.8, 30), (0.8, 50),
    ):  # fmt: skip
        outcomes = []
        for x, y in starts:
            settings: Settings = {
                (PLANT, 'map'): 'track',
                (PLANT, 'start_position_x'): x,
                (PLANT, 'start_position_y'): -y,
                (CONTROLLER, 'mode'): 'autonomous',
                (CONTROLLER, 'dst_thr'): dst_thr,
                (SONAR, 'cone_angle'): cone_angle,
            }
            outcomes.append(run(parameters_with('ideal', settings), TRACK_S))
        hits = sum(outcome.hit for outcome in outcomes)
        least = min(outcome.clearance for outcome in outcomes)
        clearance = '' if hits else f'{100.0 * least:.1f} cm'
        rows.append((cone_angle, f'{dst_thr} cm', f'{hits} of {len(starts)}', clearance))
    print_table(('cone_angle [rad], 7 rays', 'dst_thr', 'wall hits', 'smallest clearance'), rows)


def gains() -> None:
    """Compare the document's gains and the quiet ones in full reversals, with hardware at 7 V."""
    rows = []
    for name in ('document', 'quiet'):
        found = read_parameter_file(GAINS / f'{name}.yaml').of(ControllerParameters).values()
        settings: Settings = {
            **{(CONTROLLER, each): found[each] for each in ('k_f', 'k_i', *LOW_PASSES)},
            (PLANT, 'battery_voltage'): 7.0,
        }
        outcomes = list(drives('hardware', REVERSALS, settings))
        error = max(outcome.peak_error for outcome in outcomes)
        rows.append((f'{name}.yaml', _falls(outcomes), f'{error:.0f}°'))
    print_table(('gains', 'falls', ERROR_HEAD), rows)


def stand() -> None:
    """Stand for 300 s with the profile hardware."""
    outcome = run(load_profile('hardware'), STAND_S)
    row = (
        _falls([outcome]), f'{outcome.peak_pitch:.2f}°', f'{outcome.rms_pitch:.2f}°',
        f'{outcome.peak_error:.0f}°', f'{100.0 * outcome.peak_distance:.1f} cm',
    )  # fmt: skip
    head = ('falls', 'peak pitch', 'RMS pitch', ERROR_HEAD, 'largest distance')
    print_table(head, [row])


def _falls(outcomes: Iterable[Outcome]) -> str:
    fell = [outcome.fell for outcome in outcomes]
    return f'{sum(fell)} of {len(fell)}'


EXPERIMENTS: dict[str, Callable[[], None]] = {
    each.__name__: each
    for each in (speed, drive, track, gains, stand, redesign, searches, challenge, commissioning)
}

RANDOM_ROBOTS: dict[str, Callable[[int], None]] = {identification.__name__: identification}
FEW_ROBOTS, MANY_ROBOTS = 10, 100

NAMES = (*EXPERIMENTS, *RANDOM_ROBOTS)


def _documentation(name: str) -> str:
    return str((EXPERIMENTS.get(name) or RANDOM_ROBOTS[name]).__doc__)


@click.command(
    context_settings={'help_option_names': ['-h', '--help'], 'max_content_width': 100},
    epilog='\b\n' + '\n'.join(f'{name:16}  {_documentation(name)}' for name in NAMES),
)
@click.argument('experiments', nargs=-1, type=click.Choice(NAMES))
@click.option(
    '--fine',
    is_flag=True,
    help='Identify 100 robots instead of 10, which takes an hour; for identification only.',
)
def tune(experiments: tuple[str, ...], fine: bool) -> None:
    """Repeat EXPERIMENTS, or all of them, and print their tables."""
    names = experiments or NAMES
    if fine and not set(names) <= RANDOM_ROBOTS.keys():
        raise click.UsageError(f'--fine is for {", ".join(RANDOM_ROBOTS)} only')
    for name in names:
        click.echo(f'\n{_documentation(name)}\n')
        if name in RANDOM_ROBOTS:
            RANDOM_ROBOTS[name](MANY_ROBOTS if fine else FEW_ROBOTS)
        else:
            EXPERIMENTS[name]()


if __name__ == '__main__':
    sys.exit(invoke(tune, 'scripts/tune'))
