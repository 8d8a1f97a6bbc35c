"""The brick's data log as CSV, in the format of the PC tool."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple, fields
from pathlib import Path
from typing import TextIO

from ballbot_ros.errors import RecordingError, TeleopError, printable
from ballbot_ros.robot.brick.bluetooth import CLOCK_PERIOD_MS, LogPacket, PacketError

HEADER = (
    'Time,Data1,Data2,Battery,Motor Rev A,Motor Rev B,Motor Rev C,ADC S1,ADC S2,ADC S3,ADC S4,I2C'
)


class CsvLog:
    """Writes log packets, with a separate file for each run.

    The first file, `path`, is created at once. The files of further runs, ``…_2.csv`` and so on,
    are created with their first packet: the announcement of a run can overtake the last packets of
    the previous run. The time of a packet shows which run it belongs to. Files are never
    overwritten; `paths` are those so far.

    Raises
    ------
    TeleopError
        If a file already exists or can't be written; the message begins with its path.
    """

    def __init__(self, path: Path) -> None:
        self.paths = [path]
        self._run_start_ms: int | None = None
        self._next_start_ms: int | None = None
        try:
            self._file = _create(path)
        except FileExistsError:
            raise TeleopError(f'{path}: already exists; choose another file') from None
        except OSError as error:
            raise TeleopError(f'{path}: {error.strerror}') from None

    def begin_run(self, start_ms: int) -> None:
        """Note the announcement of a run by the sim time of its first tick [ms]."""
        if self._run_start_ms is None:
            self._run_start_ms = start_ms
        else:
            self._next_start_ms = start_ms

    def write(self, packet: LogPacket) -> None:
        """Write a packet."""
        with self._writing():
            if self._next_start_ms is not None and _is_since(packet.time_ms, self._next_start_ms):
                self._run_start_ms, self._next_start_ms = self._next_start_ms, None
                self._file.close()
                self._file = self._create_next()
            self._file.write(','.join(map(str, astuple(packet))) + '\n')

    def flush(self) -> None:
        """Pass everything to the operating system."""
        with self._writing():
            self._file.flush()

    def close(self) -> None:
        """Finish the file."""
        with self._writing():
            self._file.close()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise TeleopError(f'{self.paths[-1]}: {error.strerror}') from None

    def _create_next(self) -> TextIO:
        first, number = self.paths[0], len(self.paths) + 1
        while True:
            path = first.with_name(f'{first.stem}_{number}{first.suffix}')
            self.paths.append(path)
            try:
                return _create(path)
            except FileExistsError:
                self.paths.pop()
                number += 1


def read_csv_log(path: Path) -> list[LogPacket]:
    """Return the packets in a file of :class:`CsvLog`.

    Raises
    ------
    RecordingError
        If it can't be read, is not such a file, or the times of its packets do not increase. The
        message begins with the path and the number of the line.
    """
    try:
        # The last line may have been cut off while it was written.
        lines = path.read_text('ascii').rpartition('\n')[0].splitlines()
    except OSError as error:
        raise RecordingError(f'{path}: {error.strerror}') from None
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


def _create(path: Path) -> TextIO:
    file = path.open('x', encoding='ascii', newline='')
    file.write(HEADER + '\n')
    # Flush the header, so that a full disk or an exceeded limit shows at once.
    file.flush()
    return file


def _is_since(time_ms: int, start_ms: int) -> bool:
    """Return whether a time is at or after `start_ms` on the brick's clock, which wraps around."""
    return (time_ms - start_ms) % CLOCK_PERIOD_MS < CLOCK_PERIOD_MS // 2
