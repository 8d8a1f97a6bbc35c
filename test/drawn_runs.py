"""Random runs of the document's program with parameters from all of their bounds."""

import math
import random
from contextlib import suppress

import numpy as np

from ballbot_ros.controllers.codegen.implementation import check_load
from ballbot_ros.engine.scenario.scenario import Scenario, ScheduledPush, Segment, StickSignal
from ballbot_ros.errors import WorldError
from ballbot_ros.parameters import (
    CONTROLLER,
    PLANT,
    ROBOT_CLASSES,
    ControllerParameters,
    ParameterError,
    ParameterSet,
    PlantParameters,
    SonarParameters,
    parameters_of,
)
from ballbot_ros.robot.world.clearance import clearance
from ballbot_ros.robot.world.floor_map import load_map
from ballbot_ros.robot.world.world import World

# Those of the pace, the graph and the files, and those that are drawn in their own way.
LEFT_ALONE = {
    'duration', 'timeout', 'startup_timeout', 'real_time_factor', 'push_duration', 'lockstep',
    'on_timeout', 'require_recorder', 'rejoin', 'hold_time', 'time_start', 'time_auto',
    'time_stop', 'cone_rays', 'start_position_x', 'start_position_y', 'live_from',
}  # fmt: skip
HALF_SIZES = {'track': (1.0, 1.0), 'corridor': (1.0, 0.5)}


def drawn_run(seed, duration=1.0):
    """Return parameters and scenario of a random run.

    Of each four, two are over the full bounds; in one the robot mostly keeps standing.
    """
    draw, parameters = random.Random(seed), ParameterSet()
    wild, spread = seed % 2, 0.03 if seed % 4 == 0 else 0.3
    for cls in ROBOT_CLASSES:
        for name, row in parameters_of(cls.node).items():
            if name not in LEFT_ALONE and not parameters.is_set(cls.node, name):
                value = drawn_value(draw, row, wild, spread)
                if value is not None:
                    parameters.set(cls.node, name, value)
    for node, name, value in (
        (PLANT, 'duration', duration),
        (PLANT, 'hold_time', draw.choice((0.0, 0.04, 0.1234))),
        (CONTROLLER, 'time_start', draw.choice((0, 40, 102))),
        (CONTROLLER, 'time_auto', draw.choice((0, 80, 300))),
        (CONTROLLER, 'time_stop', draw.choice((0, 100, 500, 2**32 - 1))),
        (SonarParameters.node, 'cone_rays', draw.choice((1, 3, 7, 31))),
    ):
        parameters.set(node, name, value)
    keep_load_bearable(parameters)
    choose_place(draw, parameters)
    pushes = tuple(
        ScheduledPush(
            draw.uniform(0.0, duration), draw.uniform(0.001, duration),
            force=10.0 ** draw.uniform(-2, 3 * wild),
            direction=draw.choice(('left', draw.uniform(-360.0, 360.0))),
        )
        for _ in range(draw.choice((0, 0, 1, 3)))
    )  # fmt: skip
    vertical, horizontal = drawn_signal(draw, duration), drawn_signal(draw, duration)
    return parameters, Scenario(vertical=vertical, horizontal=horizontal, pushes=pushes)


def keep_load_bearable(parameters):
    """Let the tasks take no time if the processor can't bear them."""
    try:
        check_load(parameters.of(ControllerParameters))
    except ParameterError:
        parameters.set(CONTROLLER, 'kernel', False)


def choose_place(draw, parameters):
    """Draw a map, and of some places where the body is free the one nearest to a wall."""
    name = draw.choice(('', *HALF_SIZES))
    plant, found = parameters.of(PlantParameters), []
    # One world for all places: it takes much longer to make than the run itself.
    world = World(load_map(name), plant.body_depth, plant.body_width) if name else None
    for half_x, half_y in [HALF_SIZES.get(name, (9.0, 9.0))] * 15:
        place = draw.uniform(-half_x, half_x), draw.uniform(-half_y, half_y)
        with suppress(WorldError):
            if world:
                world.check_start(place)
            distance = clearance(world.walls, np.array([place]))[0] if world else 0.0
            found.append((distance, place))
    if found:
        set_place(parameters, name, min(found)[1])
    else:  # the body is too large for the map
        set_place(parameters, '', place)


def set_place(parameters, name, place):
    parameters.set(PLANT, 'map', name)
    for axis, value in zip('xy', place, strict=True):
        parameters.set(PLANT, f'start_position_{axis}', value)


def drawn_value(draw, row, wild, spread):
    if row.choices:
        return draw.choice(row.choices)
    if isinstance(row.default, bool):
        return draw.random() < 0.5
    if isinstance(row.default, str) or not row.bounds:
        return None
    defaults = row.default if isinstance(row.default, tuple) else (row.default,)
    values = [drawn_number(draw, row, default, wild, spread) for default in defaults]
    if isinstance(row.default, int):
        return int(values[0])
    return values if isinstance(row.default, tuple) else values[0]


def drawn_number(draw, row, default, wild, spread):
    low, high = row.bounds
    if row.name == 'seed':
        return draw.randint(low, high)
    if wild and draw.random() < 0.2:
        if draw.random() < 0.2:
            return draw.choice((low, high))
        # Most bounds span many powers of ten: draw mostly near the lower one.
        return low + (high - low) * draw.random() ** 6
    if default:
        return min(high, max(low, default * draw.uniform(1.0 - spread, 1.0 + spread)))
    if draw.random() < 0.4:
        return default
    dead_time = {'delay', 'delay_jitter', 'actuator_delay', 'actuator_delay_jitter'}
    scale = 100.0 if row.name in dead_time else 0.07 if abs(high) <= 2.0 else 10.0
    return min(high, max(low, scale * spread * draw.random()))


def drawn_signal(draw, duration):
    segments, time = [], 0.0
    for number in range(draw.choice((0, 1, 2))):
        times = sorted(draw.uniform(time, duration) for _ in range(draw.choice((2, 3))))
        if draw.random() < 0.3:
            times[-1] = math.inf
        values = [draw.uniform(-128.0, 127.0) for _ in times]
        if times[-1] == math.inf:
            values[-1] = values[-2]
        segments.append(Segment(str(number), tuple(zip(times, values, strict=True))))
        time = times[-1]
        if time == math.inf:
            break
    return StickSignal(tuple(segments))
