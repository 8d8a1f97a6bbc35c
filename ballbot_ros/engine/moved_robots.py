"""Robots under duties from outside, as those of environments: plant, devices and observations."""

from __future__ import annotations

from typing import Any

import numpy as np

from ballbot_ros.controllers.policy import (
    DRIVING_NAMES,
    NOTHING_OBSERVED,
    ObserverState,
    observation_of,
    observed,
    observer_tick,
    percent,
)
from ballbot_ros.engine.devices import varied
from ballbot_ros.engine.plant_tick import (
    PlantConstants,
    PlantState,
    initial_state,
    plant_constants,
    plant_tick,
    position,
)
from ballbot_ros.engine.rows import Rows, row_functions, row_type
from ballbot_ros.engine.run import (
    FloorTables,
    Rings,
    RobotConstants,
    clear_rings,
    robot_constants,
    sample,
)
from ballbot_ros.engine.scenario.scenario import signal_value
from ballbot_ros.parameters import DEVICES, ControllerParameters, PlantParameters
from ballbot_ros.parameters.timing import (
    FIRST_TICK_NS,
    MILLISECOND_NS,
    SLOW_PERIOD_NS,
    TICK_MS,
    TICK_NS,
)
from ballbot_ros.robot.arithmetic import Floats, Ints, Reals
from ballbot_ros.robot.brick.job_times import JobTimes, job_times, kernel_constants
from ballbot_ros.robot.brick.kernel import (
    DUTY_X,
    DUTY_Y,
    NEXT_X,
    NEXT_Y,
    KernelConstants,
    duty_effect,
    next_event,
    set_duty,
    set_task,
    start_kernel,
    take_time,
)
from ballbot_ros.robot.brick.link import is_sending
from ballbot_ros.robot.compiler_hints import inlined
from ballbot_ros.robot.random_numbers import Key
from ballbot_ros.robot.world.world import Cells

TrueState = tuple[float, float, float, float, float, float, float, float, float]
"""Position from the start [m], velocity [m/s], pitch [rad] and its rate [rad/s] of planes x and y,
and the battery's voltage [V].
"""


def true_state(constants: PlantConstants, state: PlantState) -> TrueState:
    """Return the true state."""
    x, y = position(constants, state)
    return (
        x - constants.start_x, y - constants.start_y,
        constants.radius * state.x[2], constants.radius * state.y[2],
        state.x[1], state.y[1], state.x[3], state.y[3],
        # In its message the voltage has single precision.
        np.float64(np.float32(state.measured_volts)),
    )  # fmt: skip


@inlined
def move_robot(
    constants: RobotConstants,
    time_start: int,
    is_new: bool,
    state: PlantState,
    observer: ObserverState,
    duty_x: int,
    duty_y: int,
    times: JobTimes,
    kernel_law: KernelConstants,
    ticks: int,
    vertical_times: Any,
    vertical_values: Any,
    horizontal_times: Any,
    horizontal_values: Any,
    effects_ns: Any,
    waiting_duties: Ints,
    steps: Any,
    kernel: Ints,
    sides: Cells,
    walls_before: Cells,
) -> tuple[PlantState, ObserverState]:
    """Return the states after some ticks under a duty; a wall hit ends them.

    In each tick the plant moves, and is sampled then; in the first of a new robot it is only
    sampled.

    Parameters
    ----------
    time_start : int
        How long the gyros are calibrated [ms].
    times, kernel_law, kernel : JobTimes, KernelConstants, sequence of int
        Of the task that sets the duty.
    vertical_times, vertical_values, horizontal_times, horizontal_values : sequence of float
        The points of both stick signals.
    effects_ns, waiting_duties, steps, sides, walls_before : sequence
        As in :func:`~ballbot_ros.engine.plant_tick.plant_tick`.
    """
    whole, real = effects_ns[:0], steps[:0]  # no pushes and no faults, of the types of some
    is_timed, key = constants.plant.has_late_duties, constants.plant.key
    delay_ns = 0
    if is_new and is_timed:
        set_task(kernel, 0, 1, TICK_MS)
        sends = is_sending(constants.gyro.link, state.time_ns)
        start_kernel(kernel, state.time_ns // 1000, sends)
    set_x, set_y = duty_x, duty_y
    for tick in range(ticks):
        if tick or not is_new:
            if is_timed:
                now_ns = state.time_ns
                run_task(kernel_law, kernel, times, key, now_ns, duty_x, duty_y)
                set_x, set_y = kernel[DUTY_X], kernel[DUTY_Y]
                delay_ns = max(duty_effect(kernel_law, kernel) * 1000 - now_ns, 0)
            state = plant_tick(
                constants.plant, state, set_x, set_y, delay_ns, whole, real,
                effects_ns, waiting_duties, steps, sides, walls_before, 0.0, 0.0,
            )  # fmt: skip
        elapsed_ns = state.time_ns - FIRST_TICK_NS
        vertical = horizontal = 0
        if state.time_ns % SLOW_PERIOD_NS == 0:
            elapsed_s = elapsed_ns * 1e-9
            vertical = signal_value(vertical_times, vertical_values, elapsed_s)
            horizontal = signal_value(horizontal_times, horizontal_values, elapsed_s)
        inputs = sample(constants, state, vertical, horizontal, steps, sides, real)
        observer = observer_tick(observer, inputs, elapsed_ns // MILLISECOND_NS >= time_start)
        if state.is_stopped:
            break
    return state, observer


def run_task(
    kernel_law: KernelConstants,
    kernel: Ints,
    times: JobTimes,
    key: Key,
    now_ns: int,
    duty_x: int,
    duty_y: int,
) -> None:
    """Run the only task of a program in a tick: it sets a duty."""
    while True:
        event = next_event(kernel_law, kernel, (now_ns + TICK_NS) // 1000)
        if event < 0:
            return
        if event % 2:
            set_duty(kernel, kernel[NEXT_X], kernel[NEXT_Y])
        else:
            kernel[NEXT_X], kernel[NEXT_Y] = duty_x, duty_y
            take_time(kernel, 0, varied(times, times.own, key, 0, now_ns))


PARAMETERS: dict[str, Any] = {
    'plant_parameters': PlantParameters,
    **{cls.node.removesuffix('_driver'): cls for cls in DEVICES},
    'settings': ControllerParameters,
}
"""The classes of the parameters in a row of a robot."""

MOVED_ROBOT = np.dtype([
    *((name, row_type(cls)) for name, cls in PARAMETERS.items()),
    ('ticks', 'i8'),
    ('action', 'f8', (2,)),
    ('has_begun', '?'),
    ('constants', row_type(RobotConstants)),
    ('plant', row_type(PlantState)),
    ('observer', row_type(ObserverState)),
    ('duty', 'i8', (2,)),
    ('measured', 'f8', (len(DRIVING_NAMES),)),
    ('true', 'f8', (9,)),
    ('is_over', '?'),
])  # fmt: skip
"""A robot.

The parameters of its nodes; for how many ticks it is to move, and the shares of full duty of its
action; whether it has begun, and its state; after a move the duty [%], the observation of the
devices, the true state, and whether the robot has fallen or been stopped by a wall.
"""

read_constants, write_constants = row_functions(RobotConstants)
read_plant, write_plant = row_functions(PlantState)
read_observer, write_observer = row_functions(ObserverState)


def move_robots(
    floor: FloorTables, vertical: Floats, horizontal: Floats, rings: Rings, robots: Rows
) -> None:
    """Move robots, each for its number of ticks, on one floor; the rings and robots are changed.

    The sticks (r, k, 2) are as in :class:`~ballbot_ros.engine.run.Events`, the robots rows of
    :data:`MOVED_ROBOT`.
    """
    for run in range(len(robots)):
        if robots[run].ticks:
            move_row(
                floor.sides, floor.walls_before, vertical[run], horizontal[run],
                rings.effects_ns[run], rings.waiting_duties[run], rings.steps[run],
                rings.kernel[run], robots[run],
            )  # fmt: skip


def move_row(
    sides: Cells,
    walls_before: Cells,
    vertical: Floats,
    horizontal: Floats,
    effects_ns: Ints,
    waiting_duties: Ints,
    steps: Reals,
    kernel: Ints,
    robot: Any,
) -> None:
    """Move one of the robots of :func:`move_robots`."""
    is_new = not robot.has_begun
    if is_new:
        robot.has_begun = True
        begun = robot_constants(
            plant_constants(robot.plant_parameters, FIRST_TICK_NS),
            robot.gyro, robot.encoder, robot.sonar,
        )  # fmt: skip
        write_constants(robot.constants, begun)
        write_plant(robot.plant, initial_state(begun.plant, FIRST_TICK_NS, 0))
        write_observer(robot.observer, NOTHING_OBSERVED)
        clear_rings(begun.plant, effects_ns, steps)
    constants = read_constants(robot.constants)
    duty_x, duty_y = percent(robot.action[0]), percent(robot.action[1])
    state, observer = move_robot(
        constants, robot.settings.time_start, is_new,
        read_plant(robot.plant), read_observer(robot.observer), duty_x, duty_y,
        job_times(robot.settings), kernel_constants(robot.settings), robot.ticks,
        vertical[:, 0], vertical[:, 1], horizontal[:, 0], horizontal[:, 1],
        effects_ns, waiting_duties, steps, kernel, sides, walls_before,
    )  # fmt: skip
    write_plant(robot.plant, state)
    write_observer(robot.observer, observed(observer))
    robot.duty[0], robot.duty[1] = duty_x, duty_y
    observation = observation_of(observer, robot.settings)
    for number in range(len(robot.measured)):
        robot.measured[number] = observation[number]
    reached = true_state(constants.plant, state)
    for number in range(len(robot.true)):
        robot.true[number] = reached[number]
    robot.is_over = state.is_fallen or state.is_stopped
