"""The brick's 16 x 8 character display, as nxtOSEK's ``ecrobot_status_monitor`` fills it."""

from __future__ import annotations

from collections.abc import Sequence

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

    Parameters
    ----------
    name : str
        Program name, the first line.
    systick_ms, battery_mv : int
        Shown in s and in 0.1 V.
    revolutions : sequence of int, length 3
        Motors A, B, C [deg].
    adc : sequence of int, length 4
        Sensor ports S1 ... S4.
    bluetooth_connected : bool
        Shown as 1 or 0 before the sonar's distance [cm].
    sonar_cm : int
        The program's last reading of the ultrasonic sensor; -1 before its first request.
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
