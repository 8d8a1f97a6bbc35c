"""Commissioning of robots whose parameters are known: how often the intervals cover them.

The parameters of each robot are drawn at random. It runs the commissioning program on a stand,
with a fresh and with a nearly empty battery; both data logs are all that the fits are given.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from ballbot_ros.analysis.identification.commissioning import (
    Commissioning,
    commission,
    volts_per_speed,
)
from ballbot_ros.controllers.codegen.implementation import compose_controller
from ballbot_ros.controllers.commissioning import END
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.reader import load_profile
from ballbot_ros.files import temporary_folder
from ballbot_ros.parameters import CONTROLLER, GYRO, PLANT, GyroParameters, PlantParameters
from ballbot_ros.recording.csv_log import write_csv_log
from ballbot_ros.robot.brick.bluetooth import LogPacket
from benchmark.tables import print_table

ROBOTS = 40
BATTERIES_V = 9.3, 7.6
DURATIONS = {'tilt_time': 0.02}
"""Those that differ from the program's: nobody tilts a simulated robot."""
NAMES = {
    'zero_rate_offset_x': 'deg/s', 'zero_rate_offset_y': 'deg/s', 'noise': 'deg/s',
    'drift': 'deg/s', 'dead_zone': '%', 'voltage_slope': 'V/mV', 'voltage_offset': 'V',
    'backlash': 'rad',
}  # fmt: skip
"""What is measured, and its unit."""

Values = Mapping[tuple[str, str], float]


def known() -> tuple[PlantParameters, GyroParameters]:
    """Return what is known of each robot: the profile `hardware`."""
    profile = load_profile('hardware')
    return profile.of(PlantParameters), profile.of(GyroParameters)


def drawn_robot(number: int) -> Values:
    """Return the parameters of a robot, by node and name."""
    random = np.random.default_rng(number)

    def around(value: float) -> float:
        return value * random.uniform(0.9, 1.1)

    return {
        (GYRO, 'zero_rate_offset_x'): random.uniform(590.0, 625.0),
        (GYRO, 'zero_rate_offset_y'): random.uniform(590.0, 625.0),
        (GYRO, 'noise'): random.uniform(0.3, 1.2),
        (GYRO, 'drift'): random.uniform(0.0, 1.0),
        (PLANT, 'dead_zone'): random.uniform(1.0, 10.0),
        (PLANT, 'backlash'): math.radians(random.uniform(1.0, 8.0)),
        (PLANT, 'voltage_slope'): around(0.001089),
        (PLANT, 'voltage_offset'): random.uniform(-0.9, -0.3),
        (PLANT, 'back_emf_constant'): around(0.468),
        (PLANT, 'torque_constant'): around(0.317),
        (PLANT, 'motor_resistance'): around(6.69),
        (PLANT, 'motor_friction'): 0.0022 * random.uniform(0.5, 2.0),
    }


def simulated_log(
    values: Values, battery_voltage: float, seed: int, durations: Mapping[str, float]
) -> list[LogPacket]:
    """Return what the program logs of a robot on a stand, until it ends."""
    parameters = load_profile('stand')
    for (node, name), value in values.items():
        parameters.set(node, name, value)
    parameters.set(PLANT, 'battery_voltage', battery_voltage)
    parameters.set(GYRO, 'seed', seed)
    parameters.set(CONTROLLER, 'implementation', 'commissioning')
    for name, value in durations.items():
        parameters.set(CONTROLLER, f'user.{name}', value)
    compose_controller(parameters)
    loop = ClosedLoop(parameters)
    log: list[LogPacket] = []
    while not log or log[-1].adc1 != END:
        log += loop.tick().outputs.log
    return log


def commissioned(logs: Sequence[Sequence[LogPacket]]) -> Commissioning:
    """Return what data logs tell."""
    with temporary_folder() as folder:
        paths = [Path(folder, f'{number}.csv') for number in range(len(logs))]
        for path, log in zip(paths, logs, strict=True):
            write_csv_log(path, log)
        return commission(paths, *known())


def errors(found: Commissioning, robot: Values) -> Iterator[tuple[str, float, float]]:
    """Yield name, error and half of the interval of each parameter.

    Only the speed of a motor is seen, so equation (6.1) is that with which a motor of the profile
    turns as fast.
    """
    plant, _ = known()
    own = plant.with_values({name: value for (node, name), value in robot.items() if node == PLANT})
    for each in found.parameters:
        true = robot[each.node, each.name]
        if each.name.startswith('voltage'):
            true *= volts_per_speed(plant) / volts_per_speed(own)
        yield each.name, abs(each.estimate.value - true), each.estimate.half_width


def _case(number: int) -> list[tuple[str, float, float]]:
    robot = drawn_robot(number)
    logs = [
        simulated_log(robot, voltage, 2 * number + log, DURATIONS)
        for log, voltage in enumerate(BATTERIES_V, 1)
    ]
    return [*errors(commissioned(logs), robot)]


def commissioning() -> None:
    """Commission robots drawn at random; count how often the 95 % intervals cover the values."""
    with ProcessPoolExecutor(2) as pool:
        found = [row for rows in pool.map(_case, range(ROBOTS)) for row in rows]
    table = []
    for name, unit in NAMES.items():
        rows = [(error, half_width) for each, error, half_width in found if each == name]
        covered = sum(error <= half_width for error, half_width in rows)
        largest, median = max(rows)[0], float(np.median([half for _, half in rows]))
        table.append((
            f'`{name}`', f'{covered} of {len(rows)}', f'±{median:.2g} {unit}',
            f'{largest:.2g} {unit}',
        ))  # fmt: skip
    print_table(('parameter', 'covered', 'median interval', 'largest error'), table)
