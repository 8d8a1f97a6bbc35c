"""Runs whose results must be the same on every machine; also a program.

    python golden_runs.py                        print probes and the hashes of all runs as JSON
    python golden_runs.py --share N [SCENARIO …]
                                                 only a share of the random runs, and only these
                                                 scenarios, if any are given
    python golden_runs.py --probe                print the probes only
    python golden_runs.py --write                make this machine's hashes the expected ones

It needs only numpy, scipy, Pillow and PyYAML, so that it runs under other releases of
Python and numpy than the test suite does.
"""

import hashlib
import json
import math
import platform
import struct
import sys
import warnings
from dataclasses import fields
from pathlib import Path

import numpy as np
import scipy
from pushes import pushes
from scipy.linalg import expm

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.golden import GOLDEN_FILE, arithmetic_sha256, duty_sha256
from ballbot_ros.engine.scenario.reader import load_scenario, scenario_names
from ballbot_ros.engine.scenario.scenario import Scenario, Segment, StickSignal
from ballbot_ros.files import share_directory
from ballbot_ros.parameters import CONTROLLER, GYRO, PLANT, SONAR, ParameterSet, parameters_of
from ballbot_ros.parameters.brick_time import KernelChoice, LinkParameters, TaskCosts
from ballbot_ros.robot.random_numbers import bits_53, philox4x32, uniform

RANDOM_FILE = Path(__file__).parent / 'machines' / 'random_runs.json'
MODELS = ('linear', 'nonlinear')
SETS = 200
# Odd, so that each share has runs of both kinds, near the defaults and over the full ranges.
SHARES = 7
TICKS = 60
STARTS = {'': (0.0, 0.0), 'track': (-0.7, -0.55), 'corridor': (0.5, 0.0)}

# These settings change bits of the C library's sine, as OPENBLAS_CORETYPE changes bits of the
# OpenBLAS kernels.
WITHOUT_FMA = {'GLIBC_TUNABLES': 'glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable,-AVX2_USABLE'}

# Parameters that would end the run before it begins, that involve no arithmetic, or that were
# declared after the hashes, which depend on the order of the draws.
_LEFT_ALONE = {
    'duration', 'timeout', 'startup_timeout', 'real_time_factor', 'hold_time', 'push_duration',
    'start_position_x', 'start_position_y', 'start_pitch_rate_x', 'start_pitch_rate_y',
    'body_width', 'body_depth', 'cone_rays', 'live_from',
    'time_start', 'ts2_period', 'ts3_period',
    'actuator_delay', 'actuator_delay_jitter', 'delay', 'delay_jitter',
    *(each.name for cls in (KernelChoice, LinkParameters, TaskCosts) for each in fields(cls)),
}  # fmt: skip


class Draw:
    """Uniform numbers from a seed; other versions of the random module may have other integers."""

    def __init__(self, seed):
        self._seed, self._count = np.uint64(seed), 0

    def number(self, low=0.0, high=1.0):
        zero = np.uint64(0)
        words = philox4x32(np.uint64(self._count), zero, zero, zero, self._seed, zero)
        self._count += 1
        return low + (high - low) * uniform(int(bits_53(words.w0, words.w1)))

    def choice(self, values):
        return values[int(self.number() * len(values))]


_DRAWN_FIRST = (
    'seed', 'map', 'body_depth', 'scenario', 'lockstep', 'ball_radius', 'k_thetadot', 'gp_max',
    'wheel_radius', 'wheel_width', 'body_width', 'body_height', 'ball_mass', 'wheel_mass',
    'body_mass',
)  # fmt: skip
_DRAWN_LAST = ('lsb',)
"""Parameters, of several nodes, that are drawn first, in this order, and last; the others are drawn
in the order of their declaration. The hashes depend on the order."""


def _order_of_draws(name):
    if name in _DRAWN_FIRST:
        return _DRAWN_FIRST.index(name)
    return len(_DRAWN_FIRST) + (name in _DRAWN_LAST)


def random_run(seed, model):
    """Return parameters and scenario of a random run, every second one over the full ranges."""
    draw, parameters = Draw(seed), ParameterSet()
    wild = seed % 2 == 1
    for node in (PLANT, GYRO, SONAR, CONTROLLER):
        rows = parameters_of(node)
        for name in sorted(rows, key=_order_of_draws):
            row = rows[name]
            # The seed was first that of the gyros.
            if (node, name) == (PLANT, 'seed'):
                continue
            if name not in _LEFT_ALONE and row.bounds and not parameters.is_set(node, name):
                parameters.set(node, name, random_value(draw, row, wild))
    given_map = draw.choice(('', '', 'track', 'corridor'))
    position = STARTS[given_map]
    for node, name, value in (
        (PLANT, 'plant_model', model),
        (PLANT, 'map', given_map),
        (PLANT, 'start_position_x', position[0]),
        (PLANT, 'start_position_y', position[1]),
        (PLANT, 'on_wall_hit', 'report'),
        (PLANT, 'hold_time', draw.choice((0.0, 0.04))),
        (PLANT, 'battery_model', draw.choice(('constant', 'draining'))),
        (GYRO, 'seed', int(draw.number() * 2**63)),
        (SONAR, 'distance_model', draw.choice(('exact', 'stepped'))),
        (CONTROLLER, 'mode', draw.choice(('remote', 'autonomous'))),
        (CONTROLLER, 'time_start', 40),
        (CONTROLLER, 'time_auto', 80),
    ):
        parameters.set(node, name, value)
    stick = StickSignal([Segment('stick', [(0.1, 0.0), (0.2, draw.number(-100.0, 100.0))])])
    push = pushes(0.12, 0.05, draw.number(-1.0, 1.0), draw.number(-1.0, 1.0))
    return parameters, Scenario(vertical=stick, horizontal=stick, pushes=push)


def random_value(draw, row, wild):
    low, high = row.bounds
    defaults = row.default if isinstance(row.default, tuple) else (row.default,)
    values = []
    for default in defaults:
        share = draw.number()
        if wild and draw.number() < 0.2:
            # Most bounds span many powers of ten: draw mostly near the lower one.
            value = low + (high - low) * share * share * share * share * share * share
        elif default:
            value = default * (0.7 + 0.6 * share)
        else:
            value = min(high, max(low, 0.02 * share))
        values.append(min(high, max(low, value)))
    if isinstance(row.default, int):
        return int(values[0])
    return values if isinstance(row.default, tuple) else values[0]


def run_hash(parameters, scenario):
    """Return a hash of every bit of the motion, the device readings and the duties of a run."""
    loop, digest = ClosedLoop(parameters, scenario), hashlib.sha256()
    for _ in range(TICKS):
        tick = loop.tick()
        truth = tick.truth
        for pair in truth[1:8]:
            digest.update(struct.pack('<2d', *pair))
        digest.update(struct.pack('<d', truth.battery_voltage))
        digest.update(repr((tick.inputs, tick.outputs.duty)).encode())
    return digest.hexdigest()[:16]


def seeds_of_share(number):
    return range(number % SHARES, SETS, SHARES)


def random_hashes(seeds=range(SETS)):
    return {model: [run_hash(*random_run(seed, model)) for seed in seeds] for model in MODELS}


def scenario_hashes(names=()):
    return {name: duty_sha256(load_scenario(name)) for name in names or scenario_names()}


def probes():
    """Return values that identify the kernels, the C library and the releases used here."""
    draw = Draw(0)
    matrix = np.array([[draw.number(-0.3, 0.3) for _ in range(7)] for _ in range(7)])
    sines = [math.sin(draw.number(-10.0, 10.0)) for _ in range(5000)]
    return {
        'expm': hashlib.sha256(expm(matrix).tobytes()).hexdigest()[:16],
        'sine': hashlib.sha256(struct.pack('<5000d', *sines)).hexdigest()[:16],
        'python': platform.python_version(),
        'numpy': np.__version__,
        'scipy': scipy.__version__,
    }


def write():
    head = (
        '# Results that every machine must reproduce to the bit: the arithmetic of '
        'ballbot_ros.robot.arithmetic,\n'
        '# and the duty_sha256 of each shipped scenario. Explain any change in CHANGELOG.\n'
        '# Written by test/golden_runs.py --write.\n'
    )
    lines = [f'  {name}: {digest}\n' for name, digest in scenario_hashes().items()]
    (share_directory() / GOLDEN_FILE).write_text(
        f'{head}arithmetic: {arithmetic_sha256()}\nscenarios:\n{"".join(lines)}'
    )
    RANDOM_FILE.write_text(json.dumps(random_hashes(), indent=0) + '\n')


def main(arguments):
    # Parameters over their full ranges sometimes overflow.
    warnings.simplefilter('ignore')
    np.seterr(all='ignore')
    if arguments == ['--write']:
        write()
        return
    answer = {'probes': probes()}
    if arguments != ['--probe']:
        seeds, names = range(SETS), []
        if arguments:
            _, share, *names = arguments
            seeds = seeds_of_share(int(share))
        answer.update(
            arithmetic=arithmetic_sha256(),
            scenarios=scenario_hashes(names),
            random=random_hashes(seeds),
        )
    print(json.dumps(answer))


if __name__ == '__main__':
    main(sys.argv[1:])
