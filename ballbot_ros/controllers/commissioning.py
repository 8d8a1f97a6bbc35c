"""A program that measures gyros and motors of a robot on a stand; it balances nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ballbot_ros.controllers.controller import MAX_DUTY, Duty, LawController, Readings
from ballbot_ros.controllers.document.axis import LCD_MS
from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.parameters import ControllerParameters, quantity
from ballbot_ros.parameters.timing import TICK_MS
from ballbot_ros.robot.brick.sensors import NO_DATA_CM
from ballbot_ros.robot.plant.model import PhysicalParameters

NAME = 'COMMISSIONING'
"""First line of the display."""

PAUSE, REST, PORTS, RAMP, PLAY, TILT, END = range(7)
"""The phases, by the number that the log has in ADC S1.

Rest: motors off. Ports: a pulse on motor B, then on C. Ramp: both from 0 to 100 %, to -100 % and
back. Play: pulses in the pattern + + - -, each with a pause, every four of them 1 % stronger. Tilt:
motors off, the user tilts the robot forward, then to the right. The last phase does not end.
"""

LOG_TICKS = 5
"""Ticks between log packets: 20 ms, the shortest time that real links are known to bear."""

RAMP_STEPS = 4 * MAX_DUTY + 1
TONE_HZ, TONE_MS, END_TONE_MS, VOLUME = 440, 200, 2000, 70


def time(default: float, description: str) -> float:
    """Declare a duration, of at least a tick."""
    return quantity(default, 's', (TICK_MS / 1000, 3600.0), description)


@dataclass(frozen=True)
class CommissioningParameters:
    """Durations and duties of the phases."""

    pause_time: float = time(3.0, 'pause at the start')
    rest_time: float = time(120.0, 'rest, with the motors off')
    port_time: float = time(1.0, 'pulse on one motor alone, and pause after it')
    port_duty: int = quantity(30, '%', (1, MAX_DUTY), 'duty of that pulse')
    step_time: float = time(0.1, 'time for which the ramp holds each duty')
    play_time: float = time(0.2, 'pulse for the gear play, and pause after it')
    play_duty: int = quantity(40, '%', (1, MAX_DUTY), 'duty of the first of these pulses')
    play_pulses: int = quantity(40, '1', (1, 1000), 'number of these pulses')
    tilt_time: float = time(5.0, 'time to tilt the robot forward, and to the right')


class Constants(NamedTuple):
    """Constants of the law: the ticks of each phase but the last, and those of their parts."""

    phase_ticks: tuple[int, ...]
    port_ticks: int
    step_ticks: int
    play_ticks: int
    tilt_ticks: int
    port_duty: int
    play_duty: int


class State(NamedTuple):
    """The phase, its ticks so far, and the ticks since the last log packet."""

    ticks: int
    phase: int
    log_counter: int


def duty_in(p: Constants, phase: int, ticks: int) -> Duty:
    """Return the duty of a tick of a phase."""
    if phase == PORTS:
        part = ticks // p.port_ticks
        if part == 0:
            return p.port_duty, 0
        if part == 2:
            return 0, p.port_duty
    elif phase == RAMP:
        duty = ramp_duty(ticks // p.step_ticks)
        return duty, duty
    elif phase == PLAY:
        part = ticks // p.play_ticks
        if part % 2 == 0:
            # Not all alike: else the encoder's rounding to whole degrees would be alike, too.
            duty = min(MAX_DUTY, p.play_duty + part // 8)
            return (duty, duty) if part % 8 < 4 else (-duty, -duty)
    return 0, 0


def ramp_duty(step: int) -> int:
    """Return the duty of a step of the ramp [%]."""
    if step <= MAX_DUTY:
        return step
    return 2 * MAX_DUTY - step if step <= 3 * MAX_DUTY else step - 4 * MAX_DUTY


def law(p: Constants, state: State, readings: Readings) -> tuple[State, Duty]:
    """Return the next state and the duty; no reading matters."""
    ticks, phase, log_counter = state
    if phase < END and ticks >= p.phase_ticks[phase]:
        ticks, phase = 0, phase + 1
    after = State(ticks + 1, phase, (log_counter + 1) % LOG_TICKS)
    return after, duty_in(p, phase, ticks)


class Commissioning(LawController[CommissioningParameters]):
    """Logs the resting gyros, and the motors at known duties, for a robot whose wheels turn freely.

    A log packet every 20 ms has both duties in data 1 and 2, the phase in ADC S1, and both gyros in
    ADC S3 and S4. A tone marks the beginning of each phase, and of each tilt.
    """

    law = law

    @classmethod
    def initial_state(cls, constants: Constants) -> State:
        """Return the state before the first tick."""
        return State(0, PAUSE, 0)

    @classmethod
    def constants(
        cls,
        p: CommissioningParameters,
        model: PhysicalParameters | None = None,
        settings: ControllerParameters | None = None,
    ) -> Constants:
        """Return the constants of the law."""
        seconds = p.pause_time, p.rest_time, p.port_time, p.step_time, p.play_time, p.tilt_time
        ticks = [max(1, round(1000.0 * each / TICK_MS)) for each in seconds]
        pause, rest, port, step, play, tilt = ticks
        phases = pause, rest, 4 * port, RAMP_STEPS * step, 2 * p.play_pulses * play, 2 * tilt
        return Constants(phases, port, step, play, tilt, p.port_duty, p.play_duty)

    def start(self) -> None:
        """Set the initial state."""
        super().start()
        self.operating_state = OperatingState.CALIBRATION

    def report(self, before: State, readings: Readings) -> None:
        """Sound the tones, log, and refresh the display, as the generated C does."""
        p, phase, ticks = self.in_force, self.state.phase, self.state.ticks - 1
        self._brick.sonar_cm = NO_DATA_CM  # nothing asks the sonar
        if ticks == 0 or (phase == TILT and ticks == p.tilt_ticks):
            self.sound(TONE_HZ, END_TONE_MS if phase == END else TONE_MS, VOLUME)
        if before.log_counter == 0:
            gyro_x, gyro_y = (min(reading, 2**15 - 1) for reading in readings.gyro)
            self.log(*duty_in(p, phase, ticks), phase, 0, gyro_x, gyro_y)
        if readings.elapsed_ms % LCD_MS == 0:
            self.show(NAME)
