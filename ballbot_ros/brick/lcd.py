"""The status page on the brick's 16 x 8 character display."""

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
        Ultrasonic sensor reading.
    """
    lines = (
        name,
        f'TIME:{systick_ms // 1000:>11}',
        f'BATT:{battery_mv // 100:>11}',
        f'REV:{revolutions[0]:>6}{revolutions[1]:>6}',
        f'{revolutions[2]:>16}',
        f'ADC:{adc[0]:>6}{adc[1]:>6}',
        f'{adc[2]:>10}{adc[3]:>6}',
        f'BT/DST:{bluetooth_connected:>4d}{sonar_cm:>5}',
    )
    return '\n'.join(line[:COLUMNS].ljust(COLUMNS) for line in lines)
