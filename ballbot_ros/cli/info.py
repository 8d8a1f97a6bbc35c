"""`ballbot info`: the content of a recording, and whether it is complete."""

from __future__ import annotations

import json
from pathlib import Path

import click
import yaml
from rich.console import Console

from ballbot_ros.cli.file_progress import file_progress
from ballbot_ros.cli.path_types import RECORDING
from ballbot_ros.messages.topics import RUN
from ballbot_ros.recording.attachments import PARAMETERS, SCENARIO, VERSIONS
from ballbot_ros.recording.overview import Overview, TopicOverview, read_overview


@click.command('info')
@click.argument('file', type=RECORDING)
@click.option('--json', 'as_json', is_flag=True, help='Print one JSON object.')
def command(file: Path, as_json: bool) -> None:
    """Describe the recording FILE: content, origin, and whether it is complete.

    It may come from any ROS 2 tool, and may be damaged.
    """
    with file_progress(f'reading {file.name}') as progress:
        overview = read_overview(file, RUN.resolved(), progress)
    (_print_json if as_json else _print_text)(overview)


def _print_json(overview: Overview) -> None:
    first, last = overview.first_ns, overview.last_ns
    content = {
        'file': str(overview.path),
        'size_bytes': overview.size,
        'library': overview.library,
        'complete': overview.damage is None and not overview.being_written,
        'being_written': overview.being_written,
        'missing': overview.damage,
        'start_s': _seconds(first),
        'end_s': _seconds(last),
        'duration_s': None if first is None or last is None else (last - first) / 1e9,
        'message_count': overview.message_count,
        'runs_s': [stamp / 1e9 for stamp in overview.runs_ns],
        'outcome': overview.outcome or None,
        'made_by': _made_by(overview),
        'topics': {
            name: {
                'type': topic.type_name,
                'count': topic.count,
                'rate_hz': topic.rate_hz,
                'largest_gap_s': _seconds(topic.gap_ns),
                'largest_gap_at_s': _seconds(topic.gap_at_ns),
            }
            for name, topic in sorted(overview.topics.items())
        },
        'attachments': {
            name: {'media_type': file.media_type, 'size_bytes': len(file.data)}
            for name, file in overview.attachments.items()
        },
        'metadata': overview.metadata,
    }
    print(json.dumps(content, indent=2, allow_nan=False))


def _print_text(overview: Overview) -> None:
    console = Console(highlight=False, markup=False, soft_wrap=True)
    for label, text in _lines(overview):
        console.print(f'{label:<12}{text}')
    rows = [('topic', 'type', 'messages', 'mean rate', 'largest gap', 'at')]
    for name, topic in sorted(overview.topics.items()):
        rows.append((name, topic.type_name, str(topic.count), *_timing(topic)))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    console.print()
    for row in rows if overview.topics else ():
        cells = [
            f'{cell:<{width}}' if number < 2 else f'{cell:>{width}}'
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        console.print('  '.join(cells).rstrip())


def _lines(overview: Overview) -> list[tuple[str, str]]:
    first, last = overview.first_ns, overview.last_ns
    lines = [
        ('file', str(overview.path)),
        (
            'size',
            f'{overview.size / 1e6:.3f} MB, written by {overview.library or "an unknown tool"}',
        ),
        ('state', _state(overview)),
    ]
    if first is None or last is None:
        lines.append(('duration', 'no messages'))
    else:
        extent = f'{(last - first) / 1e9:.3f} s, from {first / 1e9:.3f} s to {last / 1e9:.3f} s'
        lines.append(('duration', extent))
    lines.append(('messages', str(overview.message_count)))
    if overview.runs_ns:
        starts = ', '.join(f'{stamp / 1e9:.3f} s' for stamp in overview.runs_ns)
        lines.append(('runs', f'{len(overview.runs_ns)}, from {starts}'))
    if overview.outcome:
        reason = overview.outcome.get('reason', '')
        lines.append(
            ('outcome', overview.outcome.get('outcome', '') + (f': {reason}' if reason else ''))
        )
    for name, content in _made_by(overview).items():
        text = (
            ', '.join(f'{key} {value}' for key, value in content.items())
            if isinstance(content, dict)
            else str(content)
        )
        lines.append((name, text))
    for name, file in overview.attachments.items():
        lines.append(('attachment', f'{name}, {len(file.data)} bytes'))
    for name, content in overview.metadata.items():
        text = ', '.join(f'{key}: {value}' for key, value in content.items())
        lines.append(('metadata', f'{name}: {text}'))
    return lines


def _state(overview: Overview) -> str:
    if overview.being_written:
        return 'being recorded; this is its content so far'
    if overview.corruption:
        return f'{overview.damage}; `ballbot repair` recovers the intact part'
    return overview.damage or 'complete'


def _timing(topic: TopicOverview) -> tuple[str, str, str]:
    rate = '' if topic.rate_hz is None else f'{topic.rate_hz:.2f} Hz'
    if topic.gap_ns is None or topic.gap_at_ns is None:
        return rate, '', ''
    return rate, f'{topic.gap_ns / 1e9:.3f} s', f'{topic.gap_at_ns / 1e9:.3f} s'


def _made_by(overview: Overview) -> dict[str, object]:
    """Return scenario, seed and versions from the attachments of `ballbot run`."""
    scenario = _attached(overview, SCENARIO)
    parameters = _attached(overview, PARAMETERS)
    content = {
        'purpose': scenario.get('purpose'),
        'profile': scenario.get('profile'),
        'seed': next(
            (
                node['ros__parameters']['seed']
                for node in parameters.values()
                if isinstance(node, dict) and 'seed' in (node.get('ros__parameters') or {})
            ),
            None,
        ),
        'versions': _attached(overview, VERSIONS),
    }
    return {name: value for name, value in content.items() if value not in (None, {})}


def _attached(overview: Overview, name: str) -> dict[str, object]:
    file = overview.attachments.get(name)
    try:
        content = yaml.safe_load(file.data) if file else None
    except (yaml.YAMLError, UnicodeDecodeError):
        content = None
    return content if isinstance(content, dict) else {}


def _seconds(stamp_ns: int | None) -> float | None:
    return None if stamp_ns is None else stamp_ns / 1e9
