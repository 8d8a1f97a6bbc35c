"""The samples of a tick, and a whole run as one loop over ticks.

The program is that of the document; :mod:`ballbot_ros.engine.law_runs` puts others in its place.

After the samples the controller acts, and then the plant moves: the lockstep imposes this order on
the graph, too.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.controllers.document.axis import LCD_MS, Constants, constants_of
from ballbot_ros.controllers.document.program import (
    BUS_TASK,
    DUTY_TASK,
    INIT,
    LCD,
    PRIORITIES,
    TS1,
    TS2,
    TS3,
    ProgramState,
    job_time,
    program_tick,
)
from ballbot_ros.controllers.interface import BUS_BUSY, SAME_TICK
from ballbot_ros.engine.devices import (
    ENCODER_DELAY,
    GYRO_DELAY,
    SONAR_DELAY,
    EncoderConstants,
    GyroConstants,
    SonarConstants,
    analog_steps,
    between,
    encoder_constants,
    gyro_constants,
    read_encoder,
    read_gyro,
    read_sonar,
    sample_age,
    sonar_constants,
    varied,
)
from ballbot_ros.engine.plant_tick import (
    NEVER_NS,
    PlantConstants,
    PlantState,
    initial_state,
    motor_angles,
    plant_constants,
    plant_tick,
    position,
)
from ballbot_ros.engine.rows import Rows, row_functions, row_type
from ballbot_ros.engine.scenario.scenario import signal_value
from ballbot_ros.engine.scenario.task_timing import (
    COUNT,
    DUTY_AGE_US,
    LOST,
    RESPONSE_US,
    SHARE,
    duty_age,
    processor_share,
)
from ballbot_ros.parameters.timing import (
    BATTERY_PERIOD_NS,
    FIRST_TICK_NS,
    MILLISECOND_NS,
    SECOND_NS,
    SLOW_PERIOD_NS,
    STEP_NS,
    TICK_MS,
    TICK_NS,
)
from ballbot_ros.robot.arithmetic import Floats, Ints, Reals
from ballbot_ros.robot.brick.brick import NO_SAMPLE, UINT32_MASK, Inputs
from ballbot_ros.robot.brick.fault_effects import (
    ENCODER_X,
    ENCODER_Y,
    FIRST_TASK,
    GYRO_X,
    GYRO_Y,
    OFF_NS,
    SLOW,
    SONAR,
    active_amount,
    after_faults,
    late_ages,
    packet_time,
    plant_faults,
    program_start,
    ticks_to_change,
    voltage_drop,
)
from ballbot_ros.robot.brick.job_times import JobTimes, bus_share, job_times, kernel_constants
from ballbot_ros.robot.brick.kernel import (
    DUTY_X,
    DUTY_Y,
    NOT_YET,
    duty_effect,
    ended_job,
    is_bus_busy,
    next_event,
    next_lost,
    set_duty,
    set_task,
    start_kernel,
    take_time,
)
from ballbot_ros.robot.brick.link import is_sending, longest_analog_steps
from ballbot_ros.robot.brick.sensors import battery_mv
from ballbot_ros.robot.compiler_hints import inlined
from ballbot_ros.robot.plant.ground_truth import STEP_VALUES, Pair
from ballbot_ros.robot.world.world import Cells


class RobotConstants(NamedTuple):
    """What does not change in a run, of the plant and of each device."""

    plant: PlantConstants
    gyro: GyroConstants
    encoder: EncoderConstants
    sonar: SonarConstants


def robot_constants(
    plant: PlantConstants, gyro: object, encoder: object, sonar: object
) -> RobotConstants:
    """Return the constants for those of the plant and the parameters of the devices.

    The parameters are rows, or what :func:`~ballbot_ros.engine.devices.numbers_of` returns.
    """
    return RobotConstants(
        plant, gyro_constants(gyro), encoder_constants(encoder), sonar_constants(sonar)
    )


def longest_age(constants: RobotConstants) -> int:
    """Return the longest dead time of all samples without faults [steps]."""
    _, gyro, encoder, sonar = constants
    link = gyro.link
    of_gyro = longest_analog_steps(link.is_on, link.converter_ns / STEP_NS)
    return max(
        gyro.delay + gyro.jitter + of_gyro,
        encoder.delay + encoder.jitter,
        sonar.delay + sonar.jitter,
    )


@inlined
def sample(
    constants: RobotConstants,
    state: PlantState,
    vertical: int,
    horizontal: int,
    steps: Reals,
    sides: Cells,
    faults: Reals,
) -> Inputs:
    """Return the samples that are due in a state.

    Parameters
    ----------
    steps, sides : sequence of float, array of int32
        As in :func:`~ballbot_ros.engine.plant_tick.plant_tick`.
    faults : sequence of float
        As in :mod:`~ballbot_ros.robot.brick.fault_effects`; what they hold is changed.
    """
    plant, gyro, encoder, sonar = constants
    now_ns = state.time_ns
    rate_x, rate_y = state.x[3], state.y[3]
    angle_x, angle_y = motor_angles(plant, state)
    if len(steps):
        age = sample_age(gyro.delay, gyro.jitter, gyro.key, GYRO_DELAY, TICK_NS, now_ns)
        older, share = analog_steps(gyro.link, now_ns)
        age += older
        late_x = late_y = 0
        if len(faults):
            late_x, late_y = late_ages(faults, GYRO_X, now_ns)
        rate_x, rate_y = kept_pair(steps, age + late_x, age + late_y, now_ns, 2)
        if share:
            age -= 1
            next_x, next_y = kept_pair(steps, age + late_x, age + late_y, now_ns, 2)
            rate_x, rate_y = between(rate_x, next_x, share), between(rate_y, next_y, share)
        age = sample_age(encoder.delay, encoder.jitter, encoder.key, ENCODER_DELAY, TICK_NS, now_ns)
        if len(faults):
            late_x, late_y = late_ages(faults, ENCODER_X, now_ns)
        angle_x, angle_y = kept_pair(steps, age + late_x, age + late_y, now_ns, 0)
    gyro_x, gyro_y = read_gyro(gyro, rate_x, rate_y, now_ns)
    revolution_x, revolution_y = read_encoder(angle_x, angle_y)
    if len(faults):
        key = gyro.key
        gyro_x = after_faults(faults, GYRO_X, gyro_x, now_ns, TICK_NS, key)
        gyro_y = after_faults(faults, GYRO_Y, gyro_y, now_ns, TICK_NS, key)
        revolution_x = after_faults(faults, ENCODER_X, revolution_x, now_ns, TICK_NS, key)
        revolution_y = after_faults(faults, ENCODER_Y, revolution_y, now_ns, TICK_NS, key)
    sonar_cm = reading_mv = NO_SAMPLE
    if now_ns % SLOW_PERIOD_NS == 0:
        x, y = position(plant, state)
        if len(steps):
            age = sample_age(
                sonar.delay, sonar.jitter, sonar.key, SONAR_DELAY, SLOW_PERIOD_NS, now_ns
            )
            age += late_ages(faults, SONAR, now_ns)[0]
            x, y = kept_pair(steps, age, age, now_ns, 4)
        sonar_cm = read_sonar(sonar, x, y, sides, now_ns)
        if len(faults):
            sonar_cm = after_faults(faults, SONAR, sonar_cm, now_ns, SLOW_PERIOD_NS, gyro.key)
    else:
        vertical = horizontal = NO_SAMPLE
    if now_ns % BATTERY_PERIOD_NS == 0:
        # In its message the voltage has single precision.
        reading_mv = battery_mv(float(np.float32(state.measured_volts)))
    return Inputs(
        gyro_x, gyro_y, revolution_x, revolution_y, sonar_cm, reading_mv, vertical, horizontal
    )


def place_of_step(age: int, stamp_ns: int, steps: Reals) -> int:
    """Return where the step of some age is in the ring of the kept ones."""
    return (stamp_ns // STEP_NS - age) % (len(steps) // STEP_VALUES) * STEP_VALUES


def kept_pair(steps: Reals, age_x: int, age_y: int, stamp_ns: int, number: int) -> Pair:
    """Return a number of the kept step of an age, and the next number of that of another age."""
    at = place_of_step(age_x, stamp_ns, steps) + number
    other = at if age_y == age_x else place_of_step(age_y, stamp_ns, steps) + number
    return steps[at], steps[other + 1]


def clear_rings(constants: PlantConstants, effects_ns: Ints, steps: Reals) -> None:
    """Let no duty be waiting, and all kept steps be those of a robot at rest at its start."""
    for each in range(len(effects_ns)):
        effects_ns[each] = NEVER_NS
    for each in range(len(steps)):
        steps[each] = 0.0
    for each in range(len(steps) // STEP_VALUES):
        steps[STEP_VALUES * each + 4] = constants.start_x
        steps[STEP_VALUES * each + 5] = constants.start_y


class FloorTables(NamedTuple):
    """The walls of all runs; empty tables without a map.

    They are those of :class:`~ballbot_ros.robot.world.world.Footprint`.
    """

    sides: Any
    walls_before: Any


class Events(NamedTuple):
    """Pushes and stick signals of runs; the first axis is that of the runs.

    If it has a length of one, all runs have the same events.

    Attributes
    ----------
    push_times : ndarray of int64, shape (r, 2 p)
        Start and end of each push [ns].
    push_forces : ndarray of float64, shape (r, 4 p)
        Forces [N] and torques [N·m] of each push on planes x and y.
    vertical, horizontal : ndarray of float64, shape (r, k, 2)
        Times [s] and values of the points of both stick signals, see
        :func:`~ballbot_ros.engine.scenario.scenario.signal_value`.
    """

    push_times: Any
    push_forces: Any
    vertical: Any
    horizontal: Any


class Rings(NamedTuple):
    """What the plants of runs still know of earlier ticks; the first axis is that of the runs.

    Their size suffices for the longest dead times of all runs; the arguments of
    :func:`~ballbot_ros.engine.plant_tick.plant_tick` with these names are a row. So are the states
    of the kernels, see :mod:`~ballbot_ros.robot.brick.kernel`; they are empty if none has one.
    So are the faults, see :mod:`~ballbot_ros.robot.brick.fault_effects`.
    """

    effects_ns: NDArray[np.int64]
    waiting_duties: NDArray[np.int64]
    steps: Floats
    kernel: NDArray[np.int64]
    faults: Floats


class RunLog(NamedTuple):
    """Where runs are written, tick by tick; the columns are planes x and y.

    Attributes
    ----------
    position, psi, duty : ndarray, shape (r, n, 2)
        As in :class:`~ballbot_ros.engine.scenario.metrics.Motion`; duties are int8.
    timing : ndarray of float64, shape (r, n, 4) or (r, 0, 4)
        As there; NaN for some runs without it.
    others : ndarray of float64, shape (r, n, 6) or (r, 0, 6)
        Pitch rates [rad/s], readings of gyros and encoders.
    """

    position: Any
    psi: Any
    duty: Any
    timing: Any
    others: Any


def new_log(runs: int, ticks: int, *, is_timed: bool, has_others: bool = False) -> RunLog:
    """Return an empty log; `is_timed` is whether jobs take time in any of the runs."""
    timing = np.zeros((runs, ticks if is_timed else 0, COUNT))
    duty = np.zeros((runs, ticks, 2), np.int8)
    others = np.zeros((runs, ticks if has_others else 0, 6))
    return RunLog(np.zeros((runs, ticks, 2)), np.zeros((runs, ticks, 2)), duty, timing, others)


def new_robots(count: int, programs: Rows) -> Rows:
    """Return robots before their first tick as rows.

    They have the number of ticks that each has made, its state after them, and the state in which
    its program starts. `programs` are the initial states of their programs, or one for all.
    """
    columns = [('ticks', 'i8'), ('plant', row_type(PlantState))]
    columns += [('program', programs.dtype), ('initial', programs.dtype)]
    robots = np.zeros(count, columns)
    robots['program'] = robots['initial'] = programs
    return robots


MOST_JOBS = 3 * len(PRIORITIES)
"""Most jobs that end or are lost in a tick: of each task one may be active before, and two alarms
expire if a blocked interrupt comes late."""


def tick_type(program: np.dtype[np.void]) -> np.dtype[np.void]:
    """Return the type of a tick.

    It has the plant before it, the samples, the program after it, the duty, its delay [ns], and the
    :data:`~ballbot_ros.robot.brick.kernel.JobNumbers` of the jobs, followed by zeros.
    """
    plant, inputs = row_type(PlantState), row_type(Inputs)
    return np.dtype(
        [('plant', plant), ('inputs', inputs), ('program', program),
         ('duty', 'i8', (2,)), ('delay_ns', 'i8'), ('jobs', 'i8', (MOST_JOBS, 6))]
    )  # fmt: skip


read_plant_state, write_plant_state = row_functions(PlantState)
read_program_state, write_program_state = row_functions(ProgramState)
_, write_inputs = row_functions(Inputs)


class TaskTimers(NamedTuple):
    """Periods of the document's tasks, and when each is due next [ms]."""

    ts2_period: int
    ts3_period: int
    ts2_ms: int
    ts3_ms: int
    lcd_ms: int


def begin_program(program: Any, begun_ms: int) -> tuple[Constants, TaskTimers]:
    """Return what does not change in a run, and the timers `begun_ms` after its start.

    The program is the row of its constants.
    """
    ts2_period, ts3_period = program.ts2_period, program.ts3_period
    timers = TaskTimers(
        ts2_period,
        ts3_period,
        -(-begun_ms // ts2_period) * ts2_period,
        -(-begun_ms // ts3_period) * ts3_period,
        -(-begun_ms // LCD_MS) * LCD_MS,
    )
    return constants_of(program), timers


@inlined
def due_tasks(timers: TaskTimers, elapsed_ms: int) -> tuple[int, TaskTimers]:
    """Return the tasks due `elapsed_ms` after the start of the run, as bits, and the timers."""
    ts2_period, ts3_period, ts2_ms, ts3_ms, lcd_ms = timers
    tasks = TS1 if elapsed_ms else TS1 | INIT
    # The next time of each task is one to compare with: remainders take longer.
    if elapsed_ms == ts2_ms:
        tasks |= TS2
        ts2_ms += ts2_period
    if elapsed_ms == ts3_ms:
        tasks |= TS3
        ts3_ms += ts3_period
    if elapsed_ms == lcd_ms:
        tasks |= LCD
        lcd_ms += LCD_MS
    return tasks, TaskTimers(ts2_period, ts3_period, ts2_ms, ts3_ms, lcd_ms)


@inlined
def run_tasks(
    law: Constants,
    program: Any,
    state: ProgramState,
    inputs: Inputs,
    tasks: int,
    elapsed_ms: int,
    systick_ms: int,
) -> ProgramState:
    """Return the program after some tasks, as bits, `elapsed_ms` after the start of the run."""
    return program_tick(law, program, state, inputs, tasks, systick_ms)


def restarted(state: ProgramState, initial: ProgramState) -> ProgramState:
    """Return the state of a program before it starts anew; task_init leaves nothing of it."""
    return state


def set_tasks(kernel: Ints, timers: TaskTimers) -> None:
    """Set the tasks of the program in a kernel."""
    periods = 0, TICK_MS, timers.ts2_period, timers.ts3_period, LCD_MS
    for task in range(len(PRIORITIES)):
        set_task(kernel, task, PRIORITIES[task], periods[task])


def time_of_job(times: JobTimes, task: int, state: ProgramState) -> float:
    """Return how long the job of a task takes that leads to a state [µs]."""
    has_tone = state.has_started_tone or state.distance_tone_hz > 0
    return job_time(times, task, state.control_mode, state.has_logged, has_tone)


def simulate_runs(
    plants: Rows,
    gyros: Rows,
    encoders: Rows,
    sonars: Rows,
    controllers: Rows,
    programs: Rows,
    floor: FloorTables,
    events: Events,
    rings: Rings,
    log: RunLog,
    traces: Rows,
    robots: Rows,
    most: int,
) -> None:
    """Run robots under a control program, each to its end or for some ticks.

    Parameters
    ----------
    plants, gyros, encoders, sonars, controllers : rows
        The parameters of the nodes.
    programs : rows
        The constants of the programs.
    rings : Rings
        They are changed.
    log : RunLog
        Where the motion is written.
    traces : ndarray of :func:`tick_type`, shape (r, n) or (r, 0)
        Where everything in the ticks is written, unless it has no room for any.
    robots : rows
        Those of :func:`new_robots`: where the runs begin, and where they end.
    most : int
        Greatest number of ticks.
    """
    for run in range(len(plants)):
        own = run if len(events.vertical) > 1 else 0
        robot, first, done = robots[run], robots[run].ticks, 0
        is_going_on = True
        while is_going_on:
            # A program stops and starts between two parts of a run: constants stay such within one.
            now_ns = FIRST_TICK_NS + robot.ticks * TICK_NS
            part = min(most - done, ticks_to_change(rings.faults[run], now_ns))
            simulate_run(
                plants[run], gyros[run], encoders[run], sonars[run], controllers[run],
                programs[run], floor.sides, floor.walls_before,
                events.push_times[own].copy(), events.push_forces[own].copy(),
                events.vertical[own], events.horizontal[own], rings.faults[run],
                rings.effects_ns[run], rings.waiting_duties[run], rings.steps[run],
                rings.kernel[run],
                log.position[run][done:], log.psi[run][done:], log.duty[run][done:],
                log.timing[run][done:], log.others[run][done:], traces[run][done:], robot, part,
            )  # fmt: skip
            done += part
            is_going_on = robot.ticks - first == done < most


def simulate_run(
    plant: Any,
    gyro: object,
    encoder: object,
    sonar: object,
    controller: Any,
    program: Any,
    sides: Cells,
    walls_before: Cells,
    push_times: Ints,
    push_forces: Reals,
    vertical_points: Any,
    horizontal_points: Any,
    faults: Reals,
    effects_ns: Ints,
    waiting_duties: Ints,
    steps: Reals,
    kernel: Ints,
    positions: Floats,
    pitches: Floats,
    duties: NDArray[np.int8],
    timing: Floats,
    others: Floats,
    trace: Rows,
    robot: Any,
    most: int,
) -> None:
    """Run one of the robots of :func:`simulate_runs`; the pushes are changed."""
    start_ns = FIRST_TICK_NS
    vertical_times, vertical_values = vertical_points[:, 0], vertical_points[:, 1]
    horizontal_times, horizontal_values = horizontal_points[:, 0], horizontal_points[:, 1]
    constants = robot_constants(plant_constants(plant, start_ns), gyro, encoder, sonar)
    pushes = len(push_times) // 2
    first = robot.ticks
    now_ns = start_ns + first * TICK_NS
    begun_ns = program_start(faults, start_ns, now_ns)
    is_off, begins = begun_ns == OFF_NS, begun_ns == now_ns
    law, timers = begin_program(program, (now_ns - begun_ns) // MILLISECOND_NS)
    brick = read_program_state(robot.program)
    is_timed, key = constants.plant.has_late_duties, constants.plant.key
    times, kernel_law = job_times(controller), kernel_constants(controller)
    if first and begins:
        brick = restarted(brick, read_program_state(robot.initial))
    if begins and is_timed:
        set_tasks(kernel, timers)
        start_kernel(kernel, now_ns // 1000, is_sending(constants.gyro.link, now_ns))
    if first == 0:
        state = initial_state(constants.plant, start_ns, pushes, voltage_drop(faults, start_ns))
        clear_rings(constants.plant, effects_ns, steps)
    else:
        # All pushes are in their table again; the next tick removes those that have ended.
        robot.plant.pushes = pushes
        state = read_plant_state(robot.plant)
    bus = bus_share(controller)
    if not is_timed:
        timing[:] = math.nan
    ticks = min(round(plant.duration * SECOND_NS) // TICK_NS - first, most)
    is_traced, has_others = len(trace) > 0, len(others) > 0
    done = vertical = horizontal = delay_ns = 0
    while done < ticks and not state.is_stopped:
        now_ns = state.time_ns
        positions[done, 0], positions[done, 1] = position(constants.plant, state)
        pitches[done, 0], pitches[done, 1] = state.x[1], state.y[1]
        if now_ns % SLOW_PERIOD_NS == 0:
            sent_ns = packet_time(faults, now_ns, key) if len(faults) else now_ns
            elapsed_s = (sent_ns - start_ns) * 1e-9
            vertical = signal_value(vertical_times, vertical_values, elapsed_s)
            horizontal = signal_value(horizontal_times, horizontal_values, elapsed_s)
        inputs = sample(constants, state, vertical, horizontal, steps, sides, faults)
        if has_others:
            others[done, 0], others[done, 1] = state.x[3], state.y[3]
            others[done, 2], others[done, 3] = inputs.gyro_x, inputs.gyro_y
            others[done, 4], others[done, 5] = inputs.revolution_x, inputs.revolution_y
        elapsed_ms = (now_ns - begun_ns) // MILLISECOND_NS
        systick_ms = now_ns // MILLISECOND_NS & UINT32_MASK
        tasks = 0
        if not is_off:
            tasks, timers = due_tasks(timers, elapsed_ms)
        is_same_tick, jobs = False, 0
        if is_timed:
            before_x, before_y, jobs_us, lost = kernel[DUTY_X], kernel[DUTY_Y], 0, 0
            response_us, duty_start_us = NOT_YET, 0
        while True:
            task = -1
            if is_timed and not is_off:
                event = next_event(kernel_law, kernel, (now_ns + TICK_NS) // 1000)
                if event < 0:
                    if is_same_tick:
                        break
                    tasks = 0
                elif event % 2:
                    job = ended_job(kernel, event // 2)
                    _, release_us, start_us, end_us, preempted_us, _ = job
                    jobs_us += end_us - start_us - preempted_us
                    if event // 2 == DUTY_TASK:
                        set_duty(kernel, brick.duty_x, brick.duty_y)
                        response_us = max(response_us, end_us - release_us)
                        duty_start_us = start_us
                    if is_traced:
                        trace[done].jobs[jobs] = job
                        jobs += 1
                    continue
                else:
                    task = event // 2
                    tasks = 1 << task
                    if is_same_tick:
                        tasks |= SAME_TICK
                    if task == BUS_TASK and is_bus_busy(kernel, times.sonar):
                        tasks |= BUS_BUSY
            brick = run_tasks(law, program, brick, inputs, tasks, elapsed_ms, systick_ms)
            if not is_timed or is_off:
                break
            is_same_tick = True
            if task >= 0:
                time_us = time_of_job(times, task, brick)
                if len(faults):
                    time_us += active_amount(faults, FIRST_TASK + task, SLOW, now_ns)
                take_time(kernel, task, varied(times, time_us, key, task, now_ns))
        duty_x, duty_y = brick.duty_x, brick.duty_y
        if is_timed:
            duty_x, duty_y = kernel[DUTY_X], kernel[DUTY_Y]
            delay_ns = max(duty_effect(kernel_law, kernel) * 1000 - now_ns, 0)
        if is_off:
            duty_x = duty_y = delay_ns = before_x = before_y = 0
        if is_timed:
            now_us, task = now_ns // 1000, next_lost(kernel)
            while task >= 0:
                if is_traced:
                    trace[done].jobs[jobs] = task, now_us, now_us, now_us, 0, 1
                    jobs += 1
                lost, task = lost + 1, next_lost(kernel)
            timing[done, RESPONSE_US], timing[done, LOST] = response_us, lost
            timing[done, SHARE] = processor_share(bus, kernel_law.interrupt_us, jobs_us)
            age_us = duty_age((now_ns + delay_ns) // 1000, duty_start_us)
            is_new = duty_x != before_x or duty_y != before_y
            timing[done, DUTY_AGE_US] = age_us if is_new else NOT_YET
        duties[done, 0], duties[done, 1] = duty_x, duty_y
        if is_traced:
            write_plant_state(trace[done].plant, state)
            write_inputs(trace[done].inputs, inputs)
            write_program_state(trace[done].program, brick)
            trace[done].duty[0], trace[done].duty[1] = duty_x, duty_y
            trace[done].delay_ns = delay_ns
        done += 1
        drop = next_drop = 0.0
        if len(faults):
            duty_x, duty_y, drop, next_drop = plant_faults(faults, duty_x, duty_y, now_ns, key)
        state = plant_tick(
            constants.plant, state, duty_x, duty_y, delay_ns,
            push_times, push_forces,
            effects_ns, waiting_duties, steps, sides, walls_before, drop, next_drop,
        )  # fmt: skip
    robot.ticks = first + done
    write_plant_state(robot.plant, state)
    write_program_state(robot.program, brick)
