"""The samples of a tick, and a whole run of the document's program as one loop over ticks.

After the samples the controller acts, and then the plant moves: the lockstep imposes this order on
the graph, too.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ballbot_ros.controllers.document.program import (
    INIT,
    INITIAL_STATE,
    TS1,
    TS2,
    TS3,
    program_tick,
    tick_constants,
)
from ballbot_ros.engine.devices import (
    ENCODER_DELAY,
    GYRO_DELAY,
    SONAR_DELAY,
    EncoderConstants,
    GyroConstants,
    SonarConstants,
    encoder_constants,
    gyro_constants,
    read_encoder,
    read_gyro,
    read_sonar,
    sample_age,
    sonar_constants,
)
from ballbot_ros.engine.plant_tick import (
    NEVER_NS,
    STEP_VALUES,
    PlantConstants,
    PlantState,
    initial_state,
    motor_angles,
    plant_constants,
    plant_tick,
    position,
    waiting_count,
)
from ballbot_ros.engine.scenario.scenario import signal_value
from ballbot_ros.parameters.timing import (
    BATTERY_PERIOD_NS,
    FIRST_TICK_NS,
    MILLISECOND_NS,
    SECOND_NS,
    SLOW_PERIOD_NS,
    STEP_NS,
    TICK_NS,
)
from ballbot_ros.robot.brick.brick import NO_SAMPLE, Inputs
from ballbot_ros.robot.brick.sensors import battery_mv
from ballbot_ros.robot.numerics.compiler_hints import inlined


class RobotConstants(NamedTuple):
    """What does not change in a run, of the plant and of each device."""

    plant: PlantConstants
    gyro: GyroConstants
    encoder: EncoderConstants
    sonar: SonarConstants


def robot_constants(plant: PlantConstants, gyro: Any, encoder: Any, sonar: Any) -> RobotConstants:
    """Return the constants for those of the plant and the parameters of the devices.

    Parameters
    ----------
    gyro, encoder, sonar : row or namespace
        See :func:`~ballbot_ros.engine.devices.numbers_of`.
    """
    return RobotConstants(
        plant, gyro_constants(gyro), encoder_constants(encoder), sonar_constants(sonar)
    )


def longest_age(constants: RobotConstants) -> int:
    """Return the longest dead time of all samples [steps]."""
    _, gyro, encoder, sonar = constants
    return max(gyro.delay + gyro.jitter, encoder.delay + encoder.jitter, sonar.delay + sonar.jitter)


@inlined
def sample(
    constants: RobotConstants,
    state: PlantState,
    vertical: int,
    horizontal: int,
    steps: Any,
    sides: Any,
) -> Inputs:
    """Return the samples that are due in a state.

    Parameters
    ----------
    vertical, horizontal : int
        The sticks.
    steps, sides : sequence of float, array of int32
        As in :func:`~ballbot_ros.engine.plant_tick.plant_tick`.
    """
    plant, gyro, encoder, sonar = constants
    now_ns = state.time_ns
    rate_x, rate_y = state.x[3], state.y[3]
    angle_x, angle_y = motor_angles(plant, state)
    if len(steps):
        at = kept_step(gyro.delay, gyro.jitter, gyro.key, GYRO_DELAY, TICK_NS, now_ns, steps)
        rate_x, rate_y = steps[at + 2], steps[at + 3]
        at = kept_step(
            encoder.delay, encoder.jitter, encoder.key, ENCODER_DELAY, TICK_NS, now_ns, steps
        )
        angle_x, angle_y = steps[at], steps[at + 1]
    gyro_x, gyro_y = read_gyro(gyro, rate_x, rate_y, now_ns)
    revolution_x, revolution_y = read_encoder(angle_x, angle_y)
    sonar_cm = reading_mv = NO_SAMPLE
    if now_ns % SLOW_PERIOD_NS == 0:
        x, y = position(plant, state)
        if len(steps):
            at = kept_step(
                sonar.delay, sonar.jitter, sonar.key, SONAR_DELAY, SLOW_PERIOD_NS, now_ns, steps
            )
            x, y = steps[at + 4], steps[at + 5]
        sonar_cm = read_sonar(sonar, x, y, sides, now_ns)
    else:
        vertical = horizontal = NO_SAMPLE
    if now_ns % BATTERY_PERIOD_NS == 0:
        # In its message the voltage has single precision.
        reading_mv = battery_mv(float(np.float32(state.volts)))
    return Inputs(
        gyro_x, gyro_y, revolution_x, revolution_y, sonar_cm, reading_mv, vertical, horizontal
    )


def kept_step(
    delay: int, jitter: int, key: Any, device: Any, period_ns: int, stamp_ns: int, steps: Any
) -> int:
    """Return where the step that a sample measures is in the ring of the kept ones."""
    age = sample_age(delay, jitter, key, device, period_ns, stamp_ns)
    return (stamp_ns // STEP_NS - age) % (len(steps) // STEP_VALUES) * STEP_VALUES


class FloorTables(NamedTuple):
    """The walls of all runs; empty tables without a map.

    Attributes
    ----------
    sides, walls_before : ndarray of int32
        As in :class:`~ballbot_ros.robot.world.world.Footprint`.
    """

    sides: Any
    walls_before: Any


class Events(NamedTuple):
    """Pushes and stick signals of a run.

    Attributes
    ----------
    push_times : ndarray of int64, shape (2 p,)
        Start and end of each push [ns].
    push_forces : ndarray of float64, shape (4 p,)
        Forces [N] and torques [N·m] of each push on planes x and y.
    vertical, horizontal : ndarray of float64, shape (k, 2)
        Times [s] and values of the points of both stick signals, see
        :func:`~ballbot_ros.engine.scenario.scenario.signal_value`.
    """

    push_times: Any
    push_forces: Any
    vertical: Any
    horizontal: Any


class RunLog(NamedTuple):
    """Where a run is written, tick by tick; the columns are planes x and y.

    Attributes
    ----------
    position : ndarray of float64, shape (n, 2)
        Ball centre [m].
    psi : ndarray of float64, shape (n, 2)
        Body pitch [rad].
    duty : ndarray of int8, shape (n, 2)
        Duty [%].
    """

    position: Any
    psi: Any
    duty: Any


END = np.dtype([
    ('ticks', 'i8'),
    ('planes', 'f8', (2, 4)),
    ('shaft', 'f8', (2,)),
    ('voltage', 'f8', (2,)),
    ('charge', 'f8'),
    ('battery_voltage', 'f8'),
    ('fallen', '?'),
    ('stopped', '?'),
    ('in_contact', '?'),
])  # fmt: skip
"""The state at the end of a run: number of ticks, then as in `PlantState`."""


def simulate_run(
    plant: Any,
    gyro: Any,
    encoder: Any,
    sonar: Any,
    program: Any,
    floor: Any,
    events: Any,
    log: Any,
    end: Any,
) -> None:
    """Run a robot under the document's control program to its end.

    Parameters
    ----------
    plant, gyro, encoder, sonar : row
        The parameters of the nodes.
    program : row
        The constants of the program.
    floor : Floor
        The walls.
    events : Events
        Pushes and sticks; those of the pushes are changed.
    log : Log
        Where the run is written; long enough.
    end : row of END
        Where its end is written.
    """
    start_ns = FIRST_TICK_NS
    # In the loop, a field that is an array would be taken out of its tuple in every tick.
    push_times, push_forces, vertical_points, horizontal_points = events
    positions, pitches, duties = log
    sides, walls_before = floor
    vertical_times, vertical_values = vertical_points[:, 0], vertical_points[:, 1]
    horizontal_times, horizontal_values = horizontal_points[:, 0], horizontal_points[:, 1]
    ts2_period, ts3_period = program.ts2_period, program.ts3_period
    constants = robot_constants(plant_constants(plant, start_ns), gyro, encoder, sonar)
    law = tick_constants(program)
    state = initial_state(constants.plant, start_ns, len(push_times) // 2)
    brick = INITIAL_STATE
    waiting = waiting_count(constants.plant.actuator_delay + constants.plant.actuator_jitter)
    effects_ns, waiting_duties = np.full(waiting, NEVER_NS), np.zeros(2 * waiting, np.int64)
    longest = longest_age(constants)
    steps = np.zeros(STEP_VALUES * (longest + 1) if longest else 0)
    for each in range(len(steps) // STEP_VALUES):
        steps[STEP_VALUES * each + 4] = constants.plant.start_x
        steps[STEP_VALUES * each + 5] = constants.plant.start_y
    ticks = round(plant.duration * SECOND_NS) // TICK_NS
    done = vertical = horizontal = ts2_ms = ts3_ms = 0
    while done < ticks and not state.is_stopped:
        now_ns = state.time_ns
        positions[done, 0], positions[done, 1] = position(constants.plant, state)
        pitches[done, 0], pitches[done, 1] = state.x[1], state.y[1]
        if now_ns % SLOW_PERIOD_NS == 0:
            elapsed_s = (now_ns - start_ns) * 1e-9
            vertical = signal_value(vertical_times, vertical_values, elapsed_s)
            horizontal = signal_value(horizontal_times, horizontal_values, elapsed_s)
        inputs = sample(constants, state, vertical, horizontal, steps, sides)
        elapsed_ms = (now_ns - start_ns) // MILLISECOND_NS
        # As `tasks_due` says, but for the display; comparisons are faster than remainders.
        tasks = TS1 | INIT if done == 0 else TS1
        if elapsed_ms == ts2_ms:
            tasks |= TS2
            ts2_ms += ts2_period
        if elapsed_ms == ts3_ms:
            tasks |= TS3
            ts3_ms += ts3_period
        brick = program_tick(law, brick, inputs, tasks, now_ns // MILLISECOND_NS)
        duties[done, 0], duties[done, 1] = brick.duty_x, brick.duty_y
        done += 1
        state = plant_tick(
            constants.plant, state, brick.duty_x, brick.duty_y,
            push_times, push_forces,
            effects_ns, waiting_duties, steps, sides, walls_before,
        )  # fmt: skip
    end.ticks = done
    for each in range(4):
        end.planes[0, each], end.planes[1, each] = state.x[each], state.y[each]
    end.shaft[0], end.shaft[1] = state.shaft_x, state.shaft_y
    end.voltage[0], end.voltage[1] = state.voltage_x, state.voltage_y
    end.charge, end.battery_voltage = state.charge, state.volts
    end.fallen, end.stopped = state.is_fallen, state.is_stopped
    end.in_contact = state.in_contact
