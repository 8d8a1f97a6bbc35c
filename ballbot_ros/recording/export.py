"""Export of a recording as tables."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from ballbot_ros.errors import RecordingError
from ballbot_ros.process import ProgressCallback
from ballbot_ros.recording.columns import (
    FORMATS,
    OWN_STAMP,
    ColumnHints,
    Table,
    TopicColumns,
    Value,
)
from ballbot_ros.recording.reader import RecordingReader

JOINED = 'joined'
"""Name of the joined table."""

LATENESS_S = 1
"""Maximum delay of a message behind the newest one [s]; after that, its row has been written."""

MAX_ROWS = 2**24
"""Largest number of rows of a joined table, 18 hours of ticks."""

MAX_GAP_S = 3600
"""Gap between stamps from which another clock is assumed, not a pause of all topics [s]."""

MAX_NAME = 100
"""Longest name of a table, without its ending."""

_SECOND_NS = 10**9


@dataclass
class Exporter:
    """Writes the tables of a recording, the `files`, into a folder that is created if necessary.

    No file in it is overwritten. `file_format` is a key of `columns.FORMATS`; `hints` are by topic
    and type; `progress` is called with the number of messages done and their total.
    """

    reader: RecordingReader
    folder: Path
    file_format: str
    topics: Sequence[str]
    hints: Mapping[tuple[str, str], ColumnHints]
    progress: ProgressCallback = lambda done, total: None
    files: list[Path] = field(default_factory=list)

    def write_topics(self) -> None:
        """Write a table for each topic with messages, one row per message or as its hints say.

        It raises RecordingError if a table already exists or can't be written, or messages don't
        fit in columns; no table remains then.
        """
        tables: dict[str, tuple[TopicColumns, Table]] = {}
        with self._writing(), ExitStack() as stack:
            for topic, stamp_ns, message in self._rows():
                if topic not in tables:
                    columns = TopicColumns(message, self._hints(topic))
                    named = [(column.name, column.kind) for column in columns.columns]
                    named.insert(0, ('time_s', float))
                    table = self._table(_file_name(topic), named, len(self.topics))
                    stack.callback(table.close)
                    tables[topic] = columns, table
                columns, table = tables[topic]
                table.add([stamp_ns / _SECOND_NS, *self._row(topic, stamp_ns, columns, message)])

    def write_joined(self, period_ns: int, texts: Sequence[str] = ()) -> None:
        """Write one table of all topics, with a row each `period_ns`.

        Each column has the newest value at the time of the row, and none before the first message
        of its topic. Text columns are included only for the topics in `texts`. It raises
        RecordingError as `write_topics`, and if the messages are not ordered in time.
        """
        topics = [topic for topic in self.topics if not self._hints(topic).rows]
        columns = self._first_columns(topics)
        if not columns:
            return
        for topic, each in columns.items():
            each.columns = [
                column
                for column in each.columns
                if column.name != OWN_STAMP and (column.kind is not str or topic in texts)
            ]
        named = [
            (f'{_file_name(topic)}_{column.name}', column.kind)
            for topic, each in columns.items()
            for column in each.columns
        ]
        grid = _Grid({topic: len(each.columns) for topic, each in columns.items()})
        with self._writing(), ExitStack() as stack:
            table = self._table(JOINED, [('time_s', float), *named])
            stack.callback(table.close)
            lateness = LATENESS_S * _SECOND_NS // period_ns
            longest = MAX_GAP_S * _SECOND_NS // period_ns
            for topic, stamp_ns, message in self._messages(topics):
                row = self._row(topic, stamp_ns, columns[topic], message)
                tick = -(-stamp_ns // period_ns)
                if not grid.put(tick, topic, row, longest):
                    raise RecordingError(
                        f'{self.reader.path}: {topic} at {stamp_ns / _SECOND_NS:.3f} s is out of '
                        'order or far ahead, so the joined table cannot be completed'
                    )
                for ready, values in grid.rows(lateness):
                    table.add([ready * period_ns / _SECOND_NS, *values])
            for ready, values in grid.rows(0):
                table.add([ready * period_ns / _SECOND_NS, *values])

    @contextmanager
    def _writing(self) -> Iterator[None]:
        is_new = not self.folder.exists()
        try:
            yield
        except BaseException as error:
            # Remove the tables: an incomplete one looks like a complete one.
            for file in self.files:
                file.unlink(missing_ok=True)
            if is_new and self.folder.is_dir() and not any(self.folder.iterdir()):
                self.folder.rmdir()
            if isinstance(error, OSError):
                raise RecordingError(f'{self.folder}: {error.strerror}') from None
            raise

    def _messages(self, topics: Sequence[str]) -> Iterator[tuple[str, int, object]]:
        for done, found in enumerate(self.reader.messages(topics), 1):
            yield found
            self.progress(done, self.reader.count)

    def _rows(self) -> Iterator[tuple[str, int, object]]:
        rows = {each: self._hints(each).rows or (lambda one: (one,)) for each in self.topics}
        for topic, stamp_ns, message in self._messages(self.topics):
            try:
                parts = rows[topic](message)
            except ValueError as error:
                raise self._unlike(topic, stamp_ns, error) from None
            for part in parts:
                yield topic, stamp_ns, part

    def _hints(self, topic: str) -> ColumnHints:
        type_name = self.reader.topics()[topic].type_name
        return self.hints.get((topic, type_name), ColumnHints())

    def _first_columns(self, topics: Sequence[str]) -> dict[str, TopicColumns]:
        """Return the columns of each topic with messages."""
        columns: dict[str, TopicColumns] = {}
        summaries = self.reader.topics()
        for topic in topics:
            has_messages = summaries[topic].message_count > 0
            if has_messages and (first := next(self.reader.messages([topic]), None)):
                columns[topic] = TopicColumns(first[2], self._hints(topic))
        return columns

    def _row(
        self, topic: str, stamp_ns: int, columns: TopicColumns, message: object
    ) -> list[Value]:
        try:
            return columns.row(message)
        except RecordingError as error:
            raise self._unlike(topic, stamp_ns, error) from None

    def _unlike(self, topic: str, stamp_ns: int, error: Exception) -> RecordingError:
        return RecordingError(
            f'{self.reader.path}: {topic} at {stamp_ns / _SECOND_NS:.3f} s: {error}'
        )

    def _table(self, name: str, columns: Sequence[tuple[str, type]], tables: int = 1) -> Table:
        taken = {path.stem for path in self.files}
        while name in taken:
            name += '_'
        path = self.folder / f'{name}.{self.file_format}'
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except FileExistsError:
            raise RecordingError(f'{self.folder}: not a folder; choose another --output') from None
        try:
            table = FORMATS[self.file_format](path, columns, tables)
        except FileExistsError:
            raise RecordingError(f'{path}: already exists; choose another --output') from None
        self.files.append(path)
        return table


def _file_name(topic: str) -> str:
    """Return a name for files and columns: a topic can be any text."""
    return re.sub(r'[^\w.-]', '_', topic.strip('/'))[:MAX_NAME] or '_'


class _Grid:
    """Values of all topics by tick, held until the next value."""

    def __init__(self, widths: Mapping[str, int]) -> None:
        self._held: dict[str, Sequence[Value | None]] = {
            topic: [None] * width for topic, width in widths.items()
        }
        self._pending: dict[int, dict[str, Sequence[Value | None]]] = {}
        self._newest: int | None = None
        self._last = 0
        self._next: int | None = None

    def put(self, tick: int, topic: str, values: Sequence[Value | None], longest_gap: int) -> bool:
        """Store values; return False if the row of `tick` is written or beyond `longest_gap`.

        A late message that only repeats the values held, such as a roll call, changes nothing.
        """
        if self._newest is None:
            self._newest, self._last = tick, tick + MAX_ROWS
        if (
            tick > self._last
            or abs(tick - self._newest) > longest_gap
            or (self._next is not None and tick < self._next)
        ):
            return tick < self._newest and self._held[topic] == values
        self._pending.setdefault(tick, {})[topic] = values
        self._newest = max(self._newest, tick)
        return True

    def rows(self, lateness: int) -> Iterator[tuple[int, list[Value | None]]]:
        """Iterate over the rows at least `lateness` ticks older than the newest."""
        if self._newest is None:
            return
        if self._next is None:
            if self._newest - min(self._pending) < lateness:
                return
            self._next = min(self._pending)
        while self._next <= self._newest - lateness:
            self._held.update(self._pending.pop(self._next, {}))
            self._next += 1
            yield self._next - 1, [value for values in self._held.values() for value in values]
