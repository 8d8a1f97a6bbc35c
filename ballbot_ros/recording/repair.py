"""Recovery of damaged recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Attachment, Channel, Message, Metadata, Schema, Statistics

from ballbot_ros.progress import ProgressCallback
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.rosbag2 import METADATA_NAME, RecordedTopic
from ballbot_ros.recording.salvage import Damage, Salvage
from ballbot_ros.recording.writer import RecordingWriter


@dataclass
class Repair:
    """Result of a repair.

    Attributes
    ----------
    output : Path or None
        The repaired recording; None if no repair was needed.
    message_count : int
        Number of messages kept.
    description : str
        Where the file is damaged, what is kept and what is lost, on one line.
    """

    output: Path | None
    message_count: int
    description: str


def repair(
    path: Path, output: Path | None = None, progress: ProgressCallback = lambda done, total: None
) -> Repair:
    """Copy the intact part of a damaged recording to a new one.

    Parameters
    ----------
    path : Path
    output : Path, optional
        The file to create; by default next to `path` with ``_repaired`` in its name.
    progress : callable, optional
        Called with the number of bytes done and their total.

    Raises
    ------
    RecordingError
        If the file is not a recording of ROS 2, can't be read or is still being written, or if
        `output` already exists or can't be written.
    """
    path = Path(path)
    output = Path(output) if output else path.with_name(f'{path.stem}_repaired{path.suffix}')
    with RecordingReader(path) as reader:
        if reader.being_written:
            raise RecordingError(
                f'{path}: still being recorded; repair it when its recorder has ended'
            )
        corruption = reader.corruption
    with Salvage(path) as salvage:
        survey = _Survey(salvage, lambda done: progress(done, 2 * salvage.size))
        count = survey.before.count + survey.behind.count
        if not corruption and not survey.damage:
            return Repair(None, count, f'no repair needed, {count} messages intact')
        description = survey.describe(salvage, corruption)
        writer = RecordingWriter(output)
        try:
            with writer:
                _copy(salvage, writer, lambda done: progress(salvage.size + done, 2 * salvage.size))
                writer.mark_incomplete(f'repaired: {description}')
        except BaseException:
            output.unlink(missing_ok=True)
            raise
    return Repair(output, count, description)


def _copy(salvage: Salvage, writer: RecordingWriter, progress: Callable[[int], None]) -> None:
    schemas: dict[int, Schema] = {}
    topics: dict[int, RecordedTopic] = {}
    for place, record in salvage.read():
        match record:
            case Schema():
                schemas[record.id] = record
            case Channel(id=number) if number not in topics:
                topics[number] = writer.copy_topic(record, schemas.get(record.schema_id))
            case Message(channel_id=number) if number in topics:
                writer.write(
                    topics[number],
                    record.log_time,
                    record.data,
                    record.sequence,
                    record.publish_time,
                )
            case Attachment():
                writer.add_attachment(
                    record.name, record.media_type, record.data, record.create_time, record.log_time
                )
            case Metadata(name=name) if name != METADATA_NAME:
                writer.add_metadata(name, record.metadata)
        progress(place)


@dataclass
class _Messages:
    """Number and stamps [ns] of messages."""

    count: int = 0
    oldest_ns: int = 2**63
    newest_ns: int = -1

    def add(self, stamp_ns: int) -> None:
        self.count += 1
        self.oldest_ns = min(self.oldest_ns, stamp_ns)
        self.newest_ns = max(self.newest_ns, stamp_ns)


class _Survey:
    """A first pass over the file: the damaged parts, and the messages before and behind the first.

    Without its channel, a message has no topic and is left out.
    """

    def __init__(self, salvage: Salvage, progress: Callable[[int], None]) -> None:
        self.damage: list[Damage] = []
        self.before, self.behind = _Messages(), _Messages()
        self._without_topic = 0
        self._total = 0
        channels: set[int] = set()
        for place, record in salvage.read():
            match record:
                case Damage():
                    self.damage.append(record)
                case Channel():
                    channels.add(record.id)
                case Message(channel_id=number) if number not in channels:
                    self._without_topic += 1
                case Message():
                    (self.behind if self.damage else self.before).add(record.log_time)
                case Statistics():
                    self._total = record.message_count
            progress(place)

    def describe(self, salvage: Salvage, corruption: str | None) -> str:
        """Return where the file is damaged, what is kept and what is lost."""
        kept = f'{self.before.count} messages'
        if self.before.count:
            kept += f' up to {self.before.newest_ns * 1e-9:.3f} s'
        if self.behind.count:
            kept += f' and {self.behind.count} from {self.behind.oldest_ns * 1e-9:.3f} s on'
        parts = [self._places(salvage, corruption), f'{kept} kept']
        if self._without_topic:
            parts.append(f'{self._without_topic} left out, because their topic is lost')
        if self._total:
            lost = self._total - self.before.count - self.behind.count
            parts.append(f'{lost or "none"} lost')
        return '; '.join(parts)

    def _places(self, salvage: Salvage, corruption: str | None) -> str:
        if not self.damage:
            return f'{corruption}, in a part without a checksum'
        places = []
        corrupt = self.damage[:-1] if salvage.is_cut_off else self.damage
        if corrupt:
            which = f' (the first of {len(corrupt)} places)' if len(corrupt) > 1 else ''
            why = f' ({corrupt[0].reason})' if corrupt[0].reason else ''
            places.append(f'corrupt from byte {corrupt[0].start} to {corrupt[0].end}{why}{which}')
        if salvage.is_cut_off:
            places.append(f'cut off at byte {salvage.size}')
        left_out = sum(damage.end - damage.start for damage in self.damage)
        return f'{", ".join(places)}: {left_out} bytes left out'
