"""The brick from the control program's view: ports to read, actuators to set (section 7.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from ballbot_ros.robot.brick.bluetooth import LogPacket
from ballbot_ros.robot.brick.kernel import Job
from ballbot_ros.robot.brick.sensors import NO_DATA_CM

COLUMNS = 16
ROWS = 8


def status_page(
    name: str,
    *,
    systick_ms: int,
    battery_mv: int,
    revolutions: Sequence[int],
    adc: Sequence[int],
    bluetooth_connected: bool,
    sonar_cm: int,
) -> str:
    """Return the page: eight lines of sixteen characters.

    Below the program's `name` it shows the time in s, the battery in 0.1 V, motors A, B, C [deg],
    ports S1 ... S4, whether Bluetooth is connected, and the program's last reading of the sonar
    [cm], which is -1 before its first request.
    """
    lines = (
        name,
        f'TIME:{systick_ms // 1000}',
        f'BATT:{battery_mv // 100}',
        f'REV: {revolutions[0]}{revolutions[1]:>6}',
        f'     {revolutions[2]}',
        f'ADC: {adc[0]}{adc[1]:>5}',
        f'     {adc[2]}{adc[3]:>5}',
        f'BT/DST: {bluetooth_connected:d}{sonar_cm:>5}',
    )
    return '\n'.join(line[:COLUMNS].ljust(COLUMNS) for line in lines)


UINT32_MASK = 0xFFFFFFFF


class DeviceInputs(NamedTuple):
    """The device samples at one tick; None if a device has no new sample.

    Attributes
    ----------
    gyro : tuple of int
        Ports S1 (plane x) and S2 (plane y) [deg/s + offset].
    revolutions : tuple of int
        Motors B (plane x) and C (plane y) [deg].
    sonar_cm : int or None
        Port S3 [cm]; `NO_DATA_CM` if the sensor does not answer.
    battery_mv : int or None
        Battery voltage [mV].
    sticks : tuple of int or None
        The packet's left vertical and right horizontal, -128 ... 127.
    """

    gyro: tuple[int, int]
    revolutions: tuple[int, int]
    sonar_cm: int | None = None
    battery_mv: int | None = None
    sticks: tuple[int, int] | None = None


NO_SAMPLE = -(2**31)
"""Stands for the sample of a device that has no new one at a tick."""


class Inputs(NamedTuple):
    """The samples of a tick as in :class:`DeviceInputs`, with :data:`NO_SAMPLE` instead of None."""

    gyro_x: int
    gyro_y: int
    revolution_x: int
    revolution_y: int
    sonar_cm: int
    battery_mv: int
    vertical: int
    horizontal: int


NUMBERS_OF = {
    'gyro': ('gyro_x', 'gyro_y'),
    'revolutions': ('revolution_x', 'revolution_y'),
    'sonar_cm': ('sonar_cm',),
}
"""The numbers of :class:`Inputs` that a device's field of :class:`DeviceInputs` stands for."""


def as_numbers(inputs: DeviceInputs) -> Inputs:
    """Return the samples of a tick as numbers."""
    (gyro_x, gyro_y), (revolution_x, revolution_y), sonar_cm, battery_mv, sticks = inputs
    vertical, horizontal = sticks or (NO_SAMPLE, NO_SAMPLE)
    return Inputs(
        gyro_x, gyro_y, revolution_x, revolution_y,
        NO_SAMPLE if sonar_cm is None else sonar_cm,
        NO_SAMPLE if battery_mv is None else battery_mv,
        vertical, horizontal,
    )  # fmt: skip


def from_numbers(inputs: Inputs) -> DeviceInputs:
    """Return the samples of a tick that numbers stand for."""
    gyro_x, gyro_y, revolution_x, revolution_y, sonar_cm, battery_mv, vertical, horizontal = inputs
    return DeviceInputs(
        (gyro_x, gyro_y),
        (revolution_x, revolution_y),
        None if sonar_cm == NO_SAMPLE else sonar_cm,
        None if battery_mv == NO_SAMPLE else battery_mv,
        None if vertical == NO_SAMPLE else (vertical, horizontal),
    )


class MotorDuty(NamedTuple):
    """Duty [%] of motors B (plane x) and C (plane y), and time until it leaves the brick [ns]."""

    x: int
    y: int
    delay_ns: int = 0


class Tone(NamedTuple):
    """A tone: frequency [Hz], duration [ms], volume [%]."""

    frequency_hz: int
    duration_ms: int
    volume: int


@dataclass
class DeviceOutputs:
    """The outputs of a tick.

    The duty [%] of motors B (plane x) and C (plane y) holds until the next one. It takes effect
    `delay_ns` after the tick. `pages` are those of the LCD, `jobs` those that the kernel has ended
    or lost.
    """

    duty: tuple[int, int] = (0, 0)
    delay_ns: int = 0
    log: list[LogPacket] = field(default_factory=list)
    tones: list[Tone] = field(default_factory=list)
    pages: list[str] = field(default_factory=list)
    jobs: list[Job] = field(default_factory=list)


class Brick:
    """Ports and actuators of the brick, and the order of a tick: inputs, tasks, outputs.

    Attributes
    ----------
    gyro, revolutions : tuple of int
        As in :class:`DeviceInputs`.
    sonar_cm : int
        The program's last reading of the sonar; -1 before its first request.
    sonar_reply : int
        The next reading: the distance at the previous request, 0 before the first.
    battery_mv : int
        The newest sample.
    systick_ms : int
        uint32 system time.
    """

    def __init__(self) -> None:
        self.gyro = (0, 0)
        self.revolutions = (0, 0)
        self.sonar_cm = NO_DATA_CM
        self.sonar_reply = 0
        self._sonar_register = 0
        self.battery_mv = 0
        self.systick_ms = 0
        self.duty = (0, 0)
        self._connected = False
        self._outputs = DeviceOutputs()

    def tick(
        self,
        systick_ms: int,
        inputs: DeviceInputs,
        run_tasks: Callable[[], None],
        *,
        is_same_tick: bool = False,
    ) -> DeviceOutputs:
        """Latch the inputs, run the tasks, return the outputs; add to them in the same tick."""
        self.systick_ms = systick_ms & UINT32_MASK
        self.gyro = inputs.gyro
        self.revolutions = inputs.revolutions
        if inputs.sonar_cm is not None:
            self._sonar_register = inputs.sonar_cm
        if inputs.battery_mv is not None:
            self.battery_mv = inputs.battery_mv
        if inputs.sticks is not None:
            self._connected = True
        if not is_same_tick:
            self._outputs = DeviceOutputs()
        outputs = self._outputs
        run_tasks()
        outputs.duty = self.duty
        return outputs

    def read_sonar(self) -> int:
        """Return the distance [cm] at the previous request, and request the next one.

        nxtOSEK fetches the sensor's register over I2C after the call, so the program sees a value
        one period of the calling task later.
        """
        self.sonar_cm, self.sonar_reply = self.sonar_reply, self._sonar_register
        return self.sonar_cm

    def log(
        self, data1: int, data2: int, adc1: int, adc2: int, adc3: int = 0, adc4: int = 0
    ) -> None:
        """Send a record of the data logger with two 8-bit and four 16-bit values."""
        rev_b, rev_c = self.revolutions
        self._outputs.log.append(
            LogPacket(
                time_ms=self.systick_ms, data1=data1, data2=data2, battery_mv=self.battery_mv,
                rev_a=0, rev_b=rev_b, rev_c=rev_c,
                adc1=adc1, adc2=adc2, adc3=adc3, adc4=adc4, sonar_cm=self.sonar_cm,
            )
        )  # fmt: skip

    def sound_tone(self, frequency_hz: int, duration_ms: int, volume: int) -> None:
        """Sound a tone."""
        self._outputs.tones.append(Tone(frequency_hz, duration_ms, volume))

    def show_status(self, name: str) -> None:
        """Refresh the display."""
        self._outputs.pages.append(
            status_page(
                name,
                systick_ms=self.systick_ms,
                battery_mv=self.battery_mv,
                revolutions=(0, *self.revolutions),
                adc=(*self.gyro, 0, 0),
                bluetooth_connected=self._connected,
                sonar_cm=self.sonar_cm,
            )
        )
