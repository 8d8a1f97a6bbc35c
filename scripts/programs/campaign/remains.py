"""The remains of a recording after a fault."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import make_reader

from ballbot_ros.errors import RecordingError
from ballbot_ros.parameters.timing import FIRST_TICK_NS, TICK_NS
from ballbot_ros.recording.messages.conversions import is_stop, stamp_ns
from ballbot_ros.recording.messages.topics import MOTOR_DUTY, PLANT_IMU
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.repair import repair

Duty = tuple[float, float]


@dataclass(frozen=True)
class Remains:
    """The content of a recording, repaired if its recorder did not finish it.

    Attributes
    ----------
    problem : str
        Why it can't be read; empty if it can.
    finished : bool
        Whether no repair was needed.
    missing : str
        What is missing according to the recorder.
    truths : int
        Number of messages on plant/imu, of which the plant sends one per tick.
    duties : tuple
        Duties [%] by tick, from the first.
    strange : int
        Number of messages on motor_duty that are malformed or not of the next tick.
    motors_off : bool
        Whether the last duty is a motor stop.
    """

    problem: str = ''
    finished: bool = False
    missing: str = ''
    truths: int = 0
    duties: tuple[Duty, ...] = ()
    strange: int = 0
    motors_off: bool = False


def read_remains(path: Path, folder: Path) -> Remains | None:
    """Read the remains of a recording; None if there is no file.

    Parameters
    ----------
    path : Path
        The recording.
    folder : Path
        Folder for a repaired copy.
    """
    if not path.exists():
        return None
    try:
        with RecordingReader(path) as reader:
            finished, missing = reader.corruption is None, reader.damage or ''
        if not finished:
            path = repair(path, folder / f'{path.stem}_repaired.mcap').output or path
            with RecordingReader(path) as reader:
                if reader.corruption:
                    return Remains(problem=f'still damaged after the repair: {reader.corruption}')
        with path.open('rb') as file:
            read_by_others = sum(1 for _ in make_reader(file).iter_messages())
        with RecordingReader(path) as reader:
            if reader.count != read_by_others:
                problem = f'{reader.count} messages, but the package mcap reads {read_by_others}'
                return Remains(problem=problem)
            topics = reader.topics()
            truths = topics.get(PLANT_IMU.resolved())
            remains = Remains(
                finished=finished,
                missing=missing if finished else '',
                truths=truths.message_count if truths else 0,
            )
            return _with_duties(remains, reader) if MOTOR_DUTY.resolved() in topics else remains
    except (RecordingError, McapError) as error:
        return Remains(problem=str(error))


def _with_duties(remains: Remains, reader: RecordingReader) -> Remains:
    found: list[Duty] = []
    strange, motors_off = 0, False
    for raw in reader.raw_messages([MOTOR_DUTY.resolved()]):
        motors_off = is_stop(raw.data)
        if motors_off:
            continue
        try:
            message = reader.decode(raw)
        except RecordingError:
            strange += 1
            continue
        if stamp_ns(message) == FIRST_TICK_NS + len(found) * TICK_NS:
            found.append((message.vector.x, message.vector.y))
        else:
            strange += 1
    return replace(remains, duties=tuple(found), strange=strange, motors_off=motors_off)
