"""`ballbot repair`: a whole recording from a damaged one."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from ballbot_ros.cli.file_progress import file_progress
from ballbot_ros.recording.repair import repair


def repair_file(path: Path, output: Path | None) -> None:
    """Repair a recording, and say what was lost."""
    with file_progress(f'repairing {path.name}') as progress:
        found = repair(path, output, progress)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    if found.output is None:
        console.print(f'{path}: nothing to repair, {found.message_count} messages are whole')
        return
    console.print(f'{path}:')
    for damage in found.damage:
        console.print(f'  {damage}')
    for span in found.spans:
        console.print(f'  messages are lost {span}')
    for topic, lost in found.lost.items():
        console.print(f'  {topic}: {lost} lost')
    if found.nothing_lost:
        console.print('  no message is lost')
    elif not found.lost:
        console.print('  how many messages are lost is not known')
    console.print(f'{found.message_count} messages are whole: {found.output}')
