"""The brick's data log as CSV, in the format of the PC tool."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple, fields
from pathlib import Path

from ballbot_ros.errors import RecordingError, os_errors, printable
from ballbot_ros.robot.brick.bluetooth import CLOCK_PERIOD_MS, LogPacket, PacketError

HEADER = (
    'Time,Data1,Data2,Battery,Motor Rev A,Motor Rev B,Motor Rev C,ADC S1,ADC S2,ADC S3,ADC S4,I2C'
)


def write_csv_log(path: Path, packets: Iterable[LogPacket]) -> None:
    """Write the packets of a run to a new file.

    It raises RecordingError, which begins with the path, if it already exists or can't be written.
    """
    rows = [HEADER, *(','.join(map(str, astuple(each))) for each in packets), '']
    creating = os_errors(RecordingError, path, '--output')
    with creating, path.open('x', encoding='ascii', newline='') as file:
        file.write('\n'.join(rows))


def read_csv_log(path: Path) -> list[LogPacket]:
    """Return the packets in a file of :func:`write_csv_log`.

    It raises RecordingError if it can't be read, is not such a file, or the times of its packets do
    not increase. The message begins with the path and the number of the line.
    """
    try:
        with os_errors(RecordingError, path):
            # The last line may have been cut off while it was written.
            lines = path.read_text('ascii').rpartition('\n')[0].splitlines()
    except UnicodeDecodeError:
        raise RecordingError(f'{path}: is not a data log: it is not ASCII text') from None
    if not lines or lines[0].strip() != HEADER:
        raise RecordingError(f'{path}: is not a data log: its first line must be {HEADER!r}')
    packets: list[LogPacket] = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            packet = _packet(line)
        except (ValueError, PacketError) as error:
            raise RecordingError(f'{path}, line {number}: {error}') from None
        if packets and not _is_since(packet.time_ms, packets[-1].time_ms + 1):
            raise RecordingError(
                f'{path}, line {number}: its time, {packet.time_ms} ms, is not after '
                f'{packets[-1].time_ms} ms; a file holds one run'
            )
        packets.append(packet)
    return packets


def _packet(line: str) -> LogPacket:
    cells = line.split(',')
    if len(cells) != (count := len(fields(LogPacket))):
        raise ValueError(f'{count} values are needed, not {len(cells)}')
    packet = LogPacket(*map(_integer, cells))
    packet.encode()  # raises an error if a value does not fit its field
    return packet


def _integer(cell: str) -> int:
    if not cell.strip().removeprefix('-').isdecimal():
        raise ValueError(f'{printable(cell)!r} is not a whole number')
    return int(cell)


def _is_since(time_ms: int, start_ms: int) -> bool:
    """Return whether a time is at or after `start_ms` on the brick's clock, which wraps around."""
    return (time_ms - start_ms) % CLOCK_PERIOD_MS < CLOCK_PERIOD_MS // 2
