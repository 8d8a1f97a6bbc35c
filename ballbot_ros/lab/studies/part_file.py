"""A part of a study's results: a Parquet file, which is written as a whole or not at all.

A part has a row a run. Its metadata name the study, the part and the numbers of runs, and have a
SHA-256 of the whole file, so that any damage is found without trust in the rest of the file. The
pages have checksums as well, for those who read single columns.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np

from ballbot_ros.engine.rows import Column
from ballbot_ros.errors import StudyError, importing, one_line
from ballbot_ros.files import read_bytes
from ballbot_ros.lab.studies.columns import (
    FALLEN,
    NUMBER,
    OUTCOME,
    PASSED,
    TICKS,
    ColumnKind,
    ResultColumn,
)
from ballbot_ros.lab.studies.manifest import PartSummary, StudyRecord
from ballbot_ros.lockstep.run_actions import Outcome

PARTS = 'parts'
"""Name of the folder of the parts."""

TEMPORARY_SUFFIX = '.tmp'

_HASH_BYTES = hashlib.sha256().digest_size
_DIGEST_MARK = b'ballbot-sha256:'
_NO_DIGEST = b'0' * (2 * _HASH_BYTES)
_STUDY, _PART, _SUMMARY, _DIGEST = (
    b'ballbot_study', b'ballbot_part', b'ballbot_summary', b'ballbot_sha256',
)  # fmt: skip
_MORE_ATTEMPTS = 2


class DamagedPartError(StudyError):
    """A part is missing, damaged, or not this part; its `reason` is the message without path."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f'{path}: {reason}')
        self.reason = reason


class EncodedPart(NamedTuple):
    """The bytes of a part's file."""

    data: bytes
    summary: PartSummary


def encode_part(study: StudyRecord, part: int, columns: Sequence[Column]) -> EncodedPart:
    """Return the bytes of a part's file, for those who can't write the folder themselves.

    The columns, (r,) each, are those of the study, in their order; hashes are rows of bytes. It
    raises StudyError if pyarrow is not installed.
    """
    values = dict(zip((each.name for each in study.columns), columns, strict=True))
    passed, fallen = values[PASSED.name], values[FALLEN.name]
    failed = values[OUTCOME.name] == Outcome.FAILED
    summary = PartSummary(len(passed), *map(int, map(np.count_nonzero, (passed, failed, fallen))))
    if summary.runs != len(study.numbers(part)):
        raise ValueError(f'part {part} has {len(study.numbers(part))} runs, not {summary.runs}')
    arrow = load_pyarrow()
    schema = _schema(arrow, study, part, summary)
    arrays = [_array(arrow, field.type, values[field.name]) for field in schema]
    table = arrow.Table.from_arrays(arrays, schema=schema)
    repeated = [each.name for each in study.columns if _repeats(each, values[each.name])]
    stream = BytesIO()
    arrow.parquet.write_table(
        table,
        stream,
        row_group_size=summary.runs,
        use_dictionary=repeated,
        column_encoding={
            each.name: _ENCODINGS[each.kind] for each in study.columns if each.name not in repeated
        },
        # Hashes can't be compressed.
        compression={
            each.name: 'NONE' if each.kind == ColumnKind.SHA256 else 'ZSTD'
            for each in study.columns
        },
        write_statistics=[each.name for each in study.columns if each.kind != ColumnKind.SHA256],
        write_page_checksum=True,
    )
    return EncodedPart(_with_digest(stream.getvalue()), summary)


def store_part(folder: Path, study: StudyRecord, part: int, data: bytes) -> None:
    """Write the file of a part into the folder of a study; an existing one is replaced.

    A process that is killed, or a power cut, leaves the whole part or none. Two processes that
    write the same part do no harm. It raises StudyError if it can't be written.
    """
    path = folder / PARTS / study.part_name(part)
    with writing(path):
        for _ in range(_MORE_ATTEMPTS):
            # A command that resumes the study takes the temporary file for that of a dead process.
            with suppress(FileNotFoundError):
                write_atomically(path, data)
                return
        write_atomically(path, data)


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that it exists as a whole or not at all, even after a power cut.

    It raises OSError if it can't be written; nothing remains then.
    """
    # Readers of Parquet data sets skip names that begin with a full stop.
    temporary = path.with_name(f'.{path.name}.{uuid4().hex}{TEMPORARY_SUFFIX}')
    try:
        with temporary.open('xb') as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Let the names in a folder survive a power cut."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network file systems have no such operation; their server decides.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Raise StudyError if a file or folder can't be written in this context."""
    try:
        yield
    except OSError as error:
        remedy = 'choose another --output'
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            remedy = 'the parts in the folder are kept: make room and give the same command again'
        raise StudyError(f'{path}: {error.strerror}; {remedy}') from None


def check_part(path: Path, study: StudyRecord, part: int) -> PartSummary:
    """Read a part's file completely and return its numbers of runs.

    It raises DamagedPartError if it is missing, damaged, or not this part of this study.
    """
    data = _undamaged(path)
    arrow = load_pyarrow()
    with _reading(path):
        file = arrow.parquet.ParquetFile(BytesIO(data))
        return _belonging(path, file, study, part)


def read_part(path: Path, study: StudyRecord, part: int) -> Any:
    """Return a part as a table of pyarrow; raises as :func:`check_part` does."""
    data = _undamaged(path)
    arrow = load_pyarrow()
    with _reading(path):
        file = arrow.parquet.ParquetFile(BytesIO(data))
        _belonging(path, file, study, part)
        return file.read(use_threads=False)


def read_columns(
    path: Path, study: StudyRecord, part: int, names: Sequence[str]
) -> dict[str, Column]:
    """Return some columns of a part, and read no more of its file; NaN where there is no value.

    The checksums of the pages find most damage, :func:`check_part` finds any. It raises as that
    does.
    """
    arrow = load_pyarrow()
    with _reading(path), arrow.parquet.ParquetFile(path, page_checksum_verification=True) as file:
        _belonging(path, file, study, part)
        table = file.read(columns=list(names), use_threads=False)
        return {name: _column(arrow, table.column(name)) for name in names}


def load_pyarrow() -> Any:
    """Return pyarrow.

    It raises MissingExtraError if it is not installed.
    """
    with importing('study'):
        import pyarrow
        import pyarrow.parquet
    return pyarrow


_ENCODINGS: Mapping[ColumnKind, str] = {
    # The bytes of random numbers compress only if those of equal weight are together.
    ColumnKind.FLOAT: 'BYTE_STREAM_SPLIT',
    ColumnKind.INTEGER: 'DELTA_BINARY_PACKED',
    ColumnKind.BOOLEAN: 'PLAIN',
    ColumnKind.TEXT: 'PLAIN',
    ColumnKind.SHA256: 'PLAIN',
}


def _repeats(column: ResultColumn, values: Column) -> bool:
    """Return whether a dictionary saves space: values of a list or grid, and multiples of ticks."""
    if column.kind == ColumnKind.TEXT:
        return True
    if column in (NUMBER, TICKS) or column.kind in (ColumnKind.BOOLEAN, ColumnKind.SHA256):
        return False
    return 2 * len(np.unique(values)) <= len(values)


def _schema(arrow: Any, study: StudyRecord, part: int, summary: PartSummary) -> Any:
    types = {
        ColumnKind.FLOAT: arrow.float64(),
        ColumnKind.INTEGER: arrow.int64(),
        ColumnKind.BOOLEAN: arrow.bool_(),
        ColumnKind.TEXT: arrow.dictionary(arrow.int32(), arrow.string()),
        ColumnKind.SHA256: arrow.binary(_HASH_BYTES),
    }
    fields = [
        arrow.field(
            each.name,
            types[each.kind],
            nullable=each in study.measures,
            metadata={'unit': each.unit, 'meaning': each.meaning},
        )
        for each in study.columns
    ]
    metadata = {
        _STUDY: study.identity,
        _PART: str(part),
        _SUMMARY: json.dumps(asdict(summary)),
        _DIGEST: _DIGEST_MARK + _NO_DIGEST,
    }
    return arrow.schema(fields, metadata=metadata)


def _array(arrow: Any, kind: object, values: Column) -> object:
    if arrow.types.is_fixed_size_binary(kind):
        buffer = arrow.py_buffer(np.ascontiguousarray(values).tobytes())
        return arrow.FixedSizeBinaryArray.from_buffers(kind, len(values), [None, buffer])
    if arrow.types.is_dictionary(kind):
        names, codes = np.unique(np.asarray(values, str), return_inverse=True)
        return arrow.DictionaryArray.from_arrays(
            arrow.array(codes, arrow.int32()), arrow.array(names.tolist(), arrow.string())
        )
    # A missing value is null, which SQL leaves out of its means; NaN would make them NaN.
    return arrow.array(np.ascontiguousarray(values), kind, from_pandas=True)


def _column(arrow: Any, values: Any) -> Column:
    if arrow.types.is_dictionary(values.type):
        return np.asarray(values.cast('string').to_numpy()).astype(str)
    return np.asarray(values.to_numpy())


def _with_digest(data: bytes) -> bytes:
    """Return the file with its digest in the place that the metadata have for it."""
    place = data.rfind(_DIGEST_MARK) + len(_DIGEST_MARK)
    digest = hashlib.sha256(data).hexdigest().encode()
    return data[:place] + digest + data[place + len(digest) :]


def _undamaged(path: Path) -> bytes:
    """Return the bytes of a file that agrees with its digest."""
    with _reading(path):
        data = read_bytes(path)
    if not data:
        raise DamagedPartError(path, 'empty')
    mark = data.rfind(_DIGEST_MARK)
    if mark < 0:
        raise DamagedPartError(path, 'truncated, or not a part of a study')
    start = mark + len(_DIGEST_MARK)
    stop = start + len(_NO_DIGEST)
    digest = hashlib.sha256(memoryview(data)[:start])
    digest.update(_NO_DIGEST)
    digest.update(memoryview(data)[stop:])
    if digest.hexdigest().encode() != data[start:stop]:
        raise DamagedPartError(path, 'damaged')
    return data


def _belonging(path: Path, file: Any, study: StudyRecord, part: int) -> PartSummary:
    """Return the numbers of runs of a file that is a certain part of a study."""
    metadata = file.schema_arrow.metadata or {}
    if metadata.get(_STUDY) != study.identity.encode():
        raise DamagedPartError(path, 'not a part of this study')
    if metadata.get(_PART) != str(part).encode():
        raise DamagedPartError(path, 'another part of this study')
    summary = PartSummary(**json.loads(metadata[_SUMMARY]))
    if not file.metadata.num_rows == summary.runs == len(study.numbers(part)):
        raise DamagedPartError(path, 'wrong number of runs')
    return summary


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Make one error of all that reading a damaged file may raise."""
    try:
        yield
    except FileNotFoundError:
        raise DamagedPartError(path, 'missing') from None
    except StudyError:
        raise
    except OSError as error:
        # Pyarrow's own have no number.
        raise DamagedPartError(path, error.strerror or one_line(error) or 'damaged') from None
    except (LookupError, MemoryError, RuntimeError, TypeError, ValueError) as error:
        raise DamagedPartError(path, f'damaged: {one_line(error)}') from None
