"""Recovery of damaged recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    DataEnd,
    Message,
    Metadata,
    Schema,
    Statistics,
)

from ballbot_ros.progress import ProgressCallback
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.rosbag2 import METADATA_NAME, RecordedTopic
from ballbot_ros.recording.salvage import Damage, Salvage
from ballbot_ros.recording.writer import RecordingWriter

MAX_LISTED_PLACES = 5
"""Maximum number of damaged places listed individually."""


@dataclass
class LostSpan:
    """An interval of time with missing messages.

    Attributes
    ----------
    start_ns : int or None
        Stamp of the newest message before it [ns]; None if there is none.
    end_ns : int or None
        Stamp of the first message after it, or of the last one known to be missing [ns]; None if
        the end is unknown.
    open : bool
        Whether the file ends in this interval, so that more messages may have followed.
    """

    start_ns: int | None
    end_ns: int | None = None
    open: bool = False

    def __str__(self) -> str:
        start = 'the beginning' if self.start_ns is None else f'{self.start_ns * 1e-9:.3f} s'
        end = 'an unknown end' if self.end_ns is None else f'{self.end_ns * 1e-9:.3f} s'
        later = ' or later' if self.open and self.end_ns is not None else ''
        return f'from {start} to {end}{later}'


@dataclass
class LostMessages:
    """Number of missing messages of a topic.

    Attributes
    ----------
    count : int
    counted : bool
        Whether `count` is exact, not estimated.
    open : bool
        Whether more messages may be missing, since the file is cut off.
    """

    count: int
    counted: bool
    open: bool = False

    def __str__(self) -> str:
        number = f'{self.count}' if self.counted else f'about {self.count}'
        return f'{number} or more' if self.open else number


@dataclass
class Repair:
    """Result of a repair.

    Attributes
    ----------
    output : Path or None
        The repaired recording; None if no repair was needed.
    message_count : int
        Number of intact messages.
    damage : list of str
        Descriptions of the damaged places.
    spans : list of LostSpan
    lost : dict of str to LostMessages
        By topic: counted by the file's statistics or the publishers' sequence numbers, or else
        estimated from the topic's mean rate.
    nothing_lost : bool
        Whether it is certain that no message is missing.
    """

    output: Path | None
    message_count: int
    damage: list[str]
    spans: list[LostSpan]
    lost: dict[str, LostMessages]
    nothing_lost: bool

    @property
    def reason(self) -> str:
        """Summary on one line."""
        parts = list(self.damage)
        if self.spans:
            parts.append(f'messages lost {", ".join(map(str, self.spans))}')
        if self.lost:
            parts.append(', '.join(f'{count} of {topic}' for topic, count in self.lost.items()))
        elif self.nothing_lost:
            parts.append('no message lost')
        else:
            parts.append('number of lost messages unknown')
        return '; '.join(parts)


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
        if not corruption and not survey.damage:
            return Repair(None, survey.message_count, [], [], {}, True)
        found = Repair(
            output,
            survey.message_count,
            survey.describe(corruption),
            survey.spans,
            survey.lost,
            survey.nothing_lost,
        )
        writer = RecordingWriter(output)
        try:
            with writer:
                _copy(
                    salvage,
                    survey,
                    writer,
                    lambda done: progress(salvage.size + done, 2 * salvage.size),
                )
                writer.mark_incomplete(f'repaired: {found.reason}')
        except BaseException:
            output.unlink(missing_ok=True)
            raise
    return found


def _copy(
    salvage: Salvage, survey: _Survey, writer: RecordingWriter, progress: Callable[[int], None]
) -> None:
    topics: dict[int, RecordedTopic] = {
        number: writer.copy_topic(channel, survey.schemas.get(channel.schema_id))
        for number, channel in sorted(survey.channels.items())
    }
    for place, record in salvage.read():
        match record:
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
class _Seen:
    """Observations about a channel from its messages."""

    count: int = 0
    oldest_ns: int = 2**63
    newest_ns: int = 0
    sequence: int = 0
    numbered: bool = True
    missing: int = 0
    damages: int = 0


class _Survey:
    """A first pass over the file: what it contains, and what is missing."""

    def __init__(self, salvage: Salvage, progress: Callable[[int], None]) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.damage: list[Damage] = []
        self._size = salvage.size
        self._seen: dict[int, _Seen] = {}
        self._statistics: Statistics | None = None
        self._newest_ns: int | None = None
        self._spans: list[LostSpan] = []
        self._open: list[LostSpan] = []
        data_holds = False
        self._lost_attachments: set[str] = set()
        attachments: set[str] = set()
        for place, record in salvage.read():
            match record:
                case Message():
                    self._add_message(record)
                case Schema():
                    self.schemas.setdefault(record.id, record)
                case Channel():
                    self.channels.setdefault(record.id, record)
                case Statistics():
                    self._statistics = record
                case DataEnd():
                    data_holds = salvage.data_holds(place)
                case Attachment(name=name):
                    attachments.add(name)
                case AttachmentIndex(name=name) if name not in attachments:
                    self._lost_attachments.add(name)
                case Damage():
                    self._add_damage(record)
            progress(place)
        undescribed = self._seen.keys() - self.channels.keys()
        self._next_recording = next(
            (salvage.next_recording(each.start) for each in self.damage if each.in_summary), None
        )
        self._undescribed = sum(self._seen.pop(number).count for number in undescribed)
        self.message_count = sum(seen.count for seen in self._seen.values())
        if self._statistics is None:
            for span in self._open:
                span.open = True
        self.lost = self._lost()
        self.nothing_lost = (
            not self.lost
            and self._next_recording is None
            and (data_holds or self._statistics is not None)
        )
        self.spans = [] if self.nothing_lost else self._spans

    def _add_message(self, message: Message) -> None:
        stamp = message.log_time
        for span in self._open:
            span.end_ns = stamp
        self._open.clear()
        self._newest_ns = max(stamp, self._newest_ns or 0)
        seen = self._seen.setdefault(message.channel_id, _Seen(damages=len(self.damage)))
        step = message.sequence - seen.sequence
        if seen.count and seen.damages == len(self.damage):
            seen.numbered &= step == 1
        elif seen.count:
            seen.missing += max(0, step - 1)
        seen.count += 1
        seen.oldest_ns = min(seen.oldest_ns, stamp)
        seen.newest_ns = max(seen.newest_ns, stamp)
        seen.sequence = message.sequence
        seen.damages = len(self.damage)

    def _add_damage(self, damage: Damage) -> None:
        self.damage.append(damage)
        if damage.in_summary:
            return
        newest = damage.newest_ns
        known = newest is not None and newest >= (self._newest_ns or 0)
        span = LostSpan(self._newest_ns, newest if known else None)
        self._open.append(span)
        self._spans.append(span)

    def describe(self, corruption: str | None) -> list[str]:
        """Return descriptions of the damaged places."""
        places = [self._describe(damage) for damage in self.damage[:MAX_LISTED_PLACES]]
        if len(self.damage) > MAX_LISTED_PLACES:
            places.append(f'{len(self.damage) - MAX_LISTED_PLACES} more places')
        if not places:
            places.append(f'{corruption}, in a part without a checksum')
        if self._next_recording is not None:
            places.append(f'another recording begins at byte {self._next_recording}: left out')
        if self._undescribed:
            places.append(f'{self._undescribed} messages whose topic is lost')
        places += [f'attachment {name} lost' for name in sorted(self._lost_attachments)]
        return places

    def _describe(self, damage: Damage) -> str:
        if damage.in_summary:
            return f'the summary from byte {damage.start} on is missing or corrupt'
        if damage.end == self._size:
            return f'cut off at byte {self._size}'
        return f'corrupt from byte {damage.start} to {damage.end}'

    def _lost(self) -> dict[str, LostMessages]:
        lost: dict[str, LostMessages] = {}
        for number, channel in self.channels.items():
            missing = self._missing(number)
            if missing.count:
                lost[channel.topic] = missing
        return lost

    def _missing(self, number: int) -> LostMessages:
        seen = self._seen.get(number, _Seen())
        if self._statistics:
            total = self._statistics.channel_message_counts.get(number, 0)
            return LostMessages(max(0, total - seen.count), True)
        counted = seen.missing if seen.numbered else 0
        extent = seen.newest_ns - seen.oldest_ns
        if seen.count < 2 or extent <= 0:
            return LostMessages(counted, False, bool(self._open))
        guessed_spans = self._open if seen.numbered else self._spans
        guessed_ns = sum(
            span.end_ns - span.start_ns
            for span in guessed_spans
            if span.start_ns is not None and span.end_ns is not None
        )
        guessed = round(guessed_ns * (seen.count - 1) / extent)
        is_open = bool(self._open)
        return LostMessages(counted + guessed, seen.numbered and not is_open, is_open)
