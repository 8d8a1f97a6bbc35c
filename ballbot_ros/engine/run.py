"""A whole run of the document's program as one loop over the ticks of program and plant."""

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
from ballbot_ros.engine.plant_tick import (
    NEVER_NS,
    STEP_VALUES,
    initial_state,
    plant_constants,
    plant_tick,
    position,
    waiting_count,
)
from ballbot_ros.engine.robot import longest_age, robot_constants, sample
from ballbot_ros.scenario.signal import signal_value
from ballbot_ros.timing import FIRST_TICK_NS, MILLISECOND_NS, SECOND_NS, SLOW_PERIOD_NS, TICK_NS


class Floor(NamedTuple):
    """The walls of all runs; empty tables without a map.

    Attributes
    ----------
    sides, walls_before : ndarray of int32
        As in :class:`~ballbot_ros.world.world.Footprint`.
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
        :func:`~ballbot_ros.scenario.signal.signal_value`.
    """

    push_times: Any
    push_forces: Any
    vertical: Any
    horizontal: Any


class Log(NamedTuple):
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
