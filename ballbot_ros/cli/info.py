"""`ballbot info`: the content of a recording, and whether it is complete."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from operator import attrgetter
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from ballbot_ros.analysis.metrics import number
from ballbot_ros.analysis.parent import Parent
from ballbot_ros.analysis.recorded_controller import ControllerIdentity, decode_controller
from ballbot_ros.analysis.recorded_runs import is_real_robot
from ballbot_ros.analysis.recorded_scenario import (
    RecordedAttachments,
    external_push,
    faults_in,
    outside_pushes,
    outside_pushes_in,
    read_attachments,
)
from ballbot_ros.cli.options import RECORDING
from ballbot_ros.cli.progress import file_progress
from ballbot_ros.errors import printable
from ballbot_ros.files import own_command
from ballbot_ros.parameters import GyroParameters
from ballbot_ros.process import ProgressCallback
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.recording.messages.topics import RUN
from ballbot_ros.recording.overview import read_topics
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.rosbag2 import METADATA_NAME
from ballbot_ros.recording.writer import RUN_OUTCOME

_NUMBERS = (
    ('rate_hz', '.2f', 'Hz'),
    ('largest_gap_s', '.3f', 's'),
    ('largest_gap_at_s', '.3f', 's'),
)


@click.command('info')
@click.argument('file', type=RECORDING)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def command(file: Path, as_json: bool) -> None:
    """Describe the recording FILE: content, origin, and whether it is complete.

    It may come from any ROS 2 tool, and may be damaged.
    """
    with open_recording(file) as reader:
        with file_progress(f'reading {file.name}') as progress:
            content = _read(reader, progress)
        state = _state(reader)
    if as_json:
        print(json.dumps(content, indent=2, allow_nan=False, default=str))
    else:
        _print_text(content, state)


def _read(reader: RecordingReader, progress: ProgressCallback) -> dict[str, object]:
    """Return the content of a recording, as in the JSON object."""
    topics, runs_ns = read_topics(reader, RUN.resolved(), progress)
    first = min((each.first_ns for each in topics if each.count), default=None)
    last = max((each.last_ns for each in topics if each.count), default=None)
    derived = reader.derived()
    metadata = dict(reader.metadata())
    metadata.pop(METADATA_NAME, None)
    outcome = metadata.pop(RUN_OUTCOME, None) or None
    attached = read_attachments(reader.attachments())
    made_by = _made_by(attached)
    if is_real := is_real_robot(reader):
        made_by.pop('seed', None)
    return {
        'file': str(reader.path),
        'size_bytes': reader.size,
        'library': reader.library,
        'real_robot': is_real,
        'complete': reader.complete and not reader.being_written,
        'being_written': reader.being_written,
        'missing': reader.damage,
        'start_s': _seconds(first),
        'end_s': _seconds(last),
        'duration_s': None if first is None or last is None else (last - first) / 1e9,
        'message_count': sum(topic.count for topic in topics),
        'runs_s': [stamp_ns / 1e9 for stamp_ns in runs_ns],
        'outcome': outcome,
        'external_pushes': [push.as_json() for push in outside_pushes_in(reader, runs_ns)],
        'faults': [str(each) for each in faults_in(reader, attached.parameters)],
        'made_by': made_by,
        'parent': (parent := Parent.decode(reader.attachments())) and asdict(parent),
        'topics': {
            each.topic: {
                'type': each.type_name,
                'count': each.count,
                'rate_hz': number(each.rate_hz),
                'largest_gap_s': each.gap_ns / 1e9 if each.count > 1 else None,
                'largest_gap_at_s': each.gap_at_ns / 1e9 if each.count > 1 else None,
                'derived': each.topic in derived,
            }
            for each in sorted(topics, key=attrgetter('topic'))
        },
        'attachments': {
            name: {'media_type': file.media_type, 'size_bytes': len(file.data)}
            for name, file in reader.attachments().items()
        },
        'metadata': metadata,
    }


def _print_text(content: Mapping[str, Any], state: str) -> None:
    console = Console(highlight=False, markup=False, soft_wrap=True)
    for label, text in _lines(content, state):
        console.print(f'{label:<12}{printable(text)}')
    rows = [('topic', 'type', 'messages', 'mean rate', 'largest gap', 'at')]
    for name, topic in content['topics'].items():
        cells = [
            '' if topic[key] is None else f'{topic[key]:{digits}} {unit}'
            for key, digits, unit in _NUMBERS
        ]
        kind = f'{topic["type"]}, derived' if topic['derived'] else topic['type']
        rows.append((name, kind, str(topic['count']), *cells))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    console.print()
    for row in rows if content['topics'] else ():
        cells = [
            f'{cell:<{width}}' if number < 2 else f'{cell:>{width}}'
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        console.print(printable('  '.join(cells).rstrip()))


def _lines(content: Mapping[str, Any], state: str) -> list[tuple[str, str]]:
    size = f'{content["size_bytes"] / 1e6:.3f} MB'
    start, end, duration = (content[name] for name in ('start_s', 'end_s', 'duration_s'))
    lines = [
        ('file', content['file']),
        ('size', f'{size}, written by {content["library"] or "an unknown tool"}'),
        ('state', state),
        (
            'duration',
            'no messages'
            if duration is None
            else f'{duration:.3f} s, from {start:.3f} s to {end:.3f} s',
        ),
        ('messages', str(content['message_count'])),
    ]
    if runs := content['runs_s']:
        lines.append(('runs', f'{len(runs)}, from {", ".join(f"{run:.3f} s" for run in runs)}'))
    if outcome := content['outcome']:
        words = (outcome.get('outcome', ''), outcome.get('reason', ''))
        lines.append(('outcome', ': '.join(filter(None, words))))
    if pushes := [external_push(each) for each in content['external_pushes']]:
        lines.append(('pushes', outside_pushes(pushes)))
    if content['real_robot']:
        lines.append(('robot', 'real: estimates of its controller, without true motion'))
    if parent := content['parent']:
        lines.append(('branch of', str(Parent(**parent))))
    lines += [('fault', each) for each in content['faults']]
    for name, value in content['made_by'].items():
        if name == 'controller':
            lines.append((name, ControllerIdentity(**value).description))
        else:
            lines.append((name, _listed(value, ' ') if isinstance(value, dict) else str(value)))
    for name, file in content['attachments'].items():
        lines.append(('attachment', f'{name}, {file["size_bytes"]} bytes'))
    for name, record in content['metadata'].items():
        lines.append(('metadata', f'{name}: {_listed(record, ": ")}'))
    return lines


def _listed(values: Mapping[str, object], separator: str) -> str:
    return ', '.join(f'{key}{separator}{value}' for key, value in values.items())


def _state(reader: RecordingReader) -> str:
    if reader.being_written:
        return 'being recorded; this is its content so far'
    if reader.corruption:
        return f'{reader.damage}; `{own_command("repair", reader.path)}` recovers the intact part'
    return reader.damage or 'complete'


def _made_by(attached: RecordedAttachments) -> dict[str, object]:
    """Return controller, scenario, seed and versions from the attachments of `ballbot run`."""
    identity, scenario = decode_controller(attached.files), attached.scenario
    seed = attached.parameters.of(GyroParameters).seed
    versions = {name: text for name, text in attached.versions.items() if name != 'controller'}
    content = {
        'controller': identity and asdict(identity),
        'purpose': scenario and scenario.purpose,
        'profile': scenario and scenario.profile,
        'seed': seed if attached.has_parameters else None,
        'versions': versions,
    }
    return {name: value for name, value in content.items() if value not in (None, '', {})}


def _seconds(stamp_ns: int | None) -> float | None:
    return None if stamp_ns is None else stamp_ns / 1e9
