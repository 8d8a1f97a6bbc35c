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
