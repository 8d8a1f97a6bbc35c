"""What faults do, as functions on numbers.

It depends on the stamp and the seed; only the values that faults hold are a state. Several faults
of a component act in their order. `faults` is a row: the :data:`FAULT_VALUES` of each fault.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from ballbot_ros.parameters import NodeParameters
from ballbot_ros.parameters.timing import MILLISECOND_NS, SLOW_PERIOD_NS, TICK_NS
from ballbot_ros.robot.arithmetic import Reals
from ballbot_ros.robot.brick.faults import COMPONENTS, OWN_TASK, TASKS, TYPES, Fault, faults_of
from ballbot_ros.robot.brick.sensors import ADC_MAX, INT32_MAX, INT32_MIN, NO_ECHO_CM, quantise
from ballbot_ros.robot.random_numbers import Key, device_number, noise_bits, uniform

GYRO_X, GYRO_Y, ENCODER_X, ENCODER_Y, SONAR, MOTOR_X, MOTOR_Y, BATTERY, GAMEPAD = range(9)
FIRST_TASK, TICK_TASK = COMPONENTS.index(TASKS[0]), COMPONENTS.index(OWN_TASK)
(
    OFF, STUCK, GARBAGE, WRONG, SLOW, DELAYED, INTERMITTENT, WEAK, REVERSED,
    SAG, BROWN_OUT, RESTART,
) = range(len(TYPES))  # fmt: skip

_LOWEST = (0, 0, INT32_MIN, INT32_MIN, 0)
_HIGHEST = (ADC_MAX, ADC_MAX, INT32_MAX, INT32_MAX, NO_ECHO_CM)
_NOTHING = (0, 0, 0, 0, NO_ECHO_CM, 0, 0)
"""What each sensor can send, and what remains if it or a motor is off."""

FAULT_VALUES = 6
"""Values of a fault: component, type, onset and end [ns], amount, and what it holds."""

_NOT_HELD, _NEVER_NS, _COLLAPSE_V = float(2**40), float(2**62), 1e3

OFF_NS = -1
"""Stands for the start of a program while the brick is off."""

_SLOT_NS = 100 * MILLISECOND_NS
_GARBAGE, _SLOT = device_number('fault garbage'), device_number('fault slot')


def fault_row(faults: Iterable[Fault], start_ns: int) -> list[float]:
    """Return the faults of a run that begins at a time [ns] as numbers, for these functions."""
    row: list[float] = []
    for each in faults:
        component, kind = COMPONENTS.index(each.component), TYPES.index(each.type)
        end_ns = _NEVER_NS if each.end == math.inf else start_ns + round(each.end * 1e9)
        amount = _COLLAPSE_V if kind == BROWN_OUT else each.strength
        row += [component, kind, start_ns + round(each.time * 1e9), end_ns, amount, _NOT_HELD]
    return row


def change_faults(row: list[float], parameters: NodeParameters, start_ns: int) -> None:
    """Let a row be that of the faults of a node; what has begun in both holds what it held."""
    before = [row[at : at + FAULT_VALUES] for at in range(0, len(row), FAULT_VALUES)]
    row[:] = fault_row(faults_of(parameters), start_ns)
    for at in range(0, len(row), FAULT_VALUES):
        for each in before:
            if (*each[:3], each[4]) == (*row[at : at + 3], row[at + 4]):
                row[at + 5] = each[5]
                before.remove(each)
                break


def after_faults(
    faults: Reals, component: int, value: int, now_ns: int, period_ns: int, key: Key
) -> int:
    """Return what remains of a sensor's reading, or of the duty of a motor [%].

    `period_ns` is that of the samples, `key` that of the random numbers.
    """
    for at in range(0, len(faults), FAULT_VALUES):
        if faults[at] != component:
            continue
        kind, start_ns, end_ns = faults[at + 1], int(faults[at + 2]), faults[at + 3]
        amount, is_new = faults[at + 4], faults[at + 5] == _NOT_HELD
        if kind == STUCK:
            is_new |= now_ns < start_ns
        elif kind == SLOW:
            is_new |= (now_ns - start_ns) % (int(amount) * MILLISECOND_NS) < period_ns
        if is_new:
            faults[at + 5] = value
        if not start_ns <= now_ns < end_ns:
            continue
        if kind in (STUCK, SLOW):
            value = int(faults[at + 5])
        elif kind == OFF or (kind == INTERMITTENT and is_lost(key, component, now_ns)):
            value = _NOTHING[component]
        elif kind == GARBAGE:
            count = _HIGHEST[component] - _LOWEST[component] + 1
            index = now_ns // period_ns
            value = _LOWEST[component] + int(chance(key, _GARBAGE, component, index) * count)
        elif kind == WRONG and not (component == SONAR and value == NO_ECHO_CM):
            value = max(_LOWEST[component], min(_HIGHEST[component], quantise(value + amount)))
        elif kind == WEAK:
            value = int(value * amount)
        elif kind == REVERSED:
            value = -value
    return value


def chance(key: Key, purpose: np.uint64, component: int, index: int) -> float:
    """Return a uniform number within [0, 1)."""
    low, high = np.uint64(index & 0xFFFFFFFF), np.uint64(index >> 32)
    one, _ = noise_bits(low, high, purpose + np.uint64(component), key)
    return uniform(np.int64(one))  # type: ignore[arg-type]


def is_lost(key: Key, component: int, now_ns: int) -> bool:
    """Return whether an intermittent fault acts in the slot of a time."""
    return chance(key, _SLOT, component, now_ns // _SLOT_NS) < 0.5


def active_amount(faults: Reals, component: int, kind: int, now_ns: int) -> float:
    """Return the sum of the amounts of a component's faults of a type that act at a time."""
    amount = 0.0
    for at in range(0, len(faults), FAULT_VALUES):
        is_active = faults[at + 2] <= now_ns < faults[at + 3]
        if is_active and faults[at] == component and faults[at + 1] == kind:
            amount += faults[at + 4]
    return amount


def late_ages(faults: Reals, component: int, now_ns: int) -> tuple[int, int]:
    """Return by how much samples of a component and of the next one are late [steps]."""
    late = active_amount(faults, component, DELAYED, now_ns)
    return int(late), int(active_amount(faults, component + 1, DELAYED, now_ns))


def voltage_drop(faults: Reals, now_ns: int) -> float:
    """Return by how much the battery's voltage is lower [V]."""
    sag = active_amount(faults, BATTERY, SAG, now_ns)
    return sag + active_amount(faults, BATTERY, BROWN_OUT, now_ns)


def plant_faults(
    faults: Reals, duty_x: int, duty_y: int, now_ns: int, key: Key
) -> tuple[int, int, float, float]:
    """Return the duties that the motors get, and :func:`voltage_drop` now and at the next tick."""
    duty_x = after_faults(faults, MOTOR_X, duty_x, now_ns, TICK_NS, key)
    duty_y = after_faults(faults, MOTOR_Y, duty_y, now_ns, TICK_NS, key)
    return duty_x, duty_y, voltage_drop(faults, now_ns), voltage_drop(faults, now_ns + TICK_NS)


def packet_time(faults: Reals, now_ns: int, key: Key) -> int:
    """Return when the gamepad sent the packet that the brick has at a time, a stamp of its own.

    It never decreases from one time to a later one. Before the run there were no packets.
    """
    # The packet passes the first fault first, so time goes back through it last.
    for at in range(len(faults) - FAULT_VALUES, -1, -FAULT_VALUES):
        kind, start_ns, end_ns = faults[at + 1], int(faults[at + 2]), faults[at + 3]
        if faults[at] != GAMEPAD or not start_ns <= now_ns < end_ns:
            continue
        if kind == OFF:
            now_ns = (start_ns - 1) // SLOW_PERIOD_NS * SLOW_PERIOD_NS
        elif kind == DELAYED:
            # What was sent before the fault has arrived.
            late_ns = min(int(faults[at + 4]) * MILLISECOND_NS, now_ns - start_ns)
            now_ns = (now_ns - late_ns) // SLOW_PERIOD_NS * SLOW_PERIOD_NS
        while kind == INTERMITTENT and start_ns <= now_ns and is_lost(key, GAMEPAD, now_ns):
            now_ns -= SLOW_PERIOD_NS
    return now_ns


def program_start(faults: Reals, start_ns: int, now_ns: int) -> int:
    """Return the tick in which the program began that runs at a tick [ns]; OFF_NS if none does.

    `start_ns` is the start of the run.
    """
    for at in range(0, len(faults), FAULT_VALUES):
        kind, end_ns = faults[at + 1], int(faults[at + 3])
        if kind in (RESTART, BROWN_OUT) and faults[at + 2] <= now_ns:
            if now_ns < end_ns:
                return OFF_NS
            start_ns = max(start_ns, -(-end_ns // TICK_NS) * TICK_NS)
    return start_ns


def ticks_to_change(faults: Reals, now_ns: int) -> int:
    """Return the number of ticks until a program stops or starts."""
    ticks = int(_NEVER_NS)
    for at in range(0, len(faults), FAULT_VALUES):
        if faults[at + 1] in (RESTART, BROWN_OUT):
            for end in (2, 3):
                left = -((now_ns - int(faults[at + end])) // TICK_NS)
                if left > 0:
                    ticks = min(ticks, left)
    return ticks


def program_changes(faults: Reals, start_ns: int) -> dict[int, bool]:
    """Return the ticks [ns] at which a program starts anew (True) or stops (False)."""
    times = [int(faults[at + end]) for at in range(0, len(faults), FAULT_VALUES) for end in (2, 3)]
    ticks = {-(-each // TICK_NS) * TICK_NS for each in times}
    starts = {tick: program_start(faults, start_ns, tick) for tick in ticks}
    return {tick: begun != OFF_NS for tick, begun in starts.items() if begun in (OFF_NS, tick)}
