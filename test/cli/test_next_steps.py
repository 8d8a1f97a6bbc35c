"""The commands that are recommended after a run."""

from pathlib import Path

import pytest

from ballbot_ros.cli.next_steps import COMMAND_ENV, next_steps


@pytest.mark.parametrize(
    ('program', 'path', 'report'),
    [
        (None, 'runs/a/push.mcap', 'ballbot report runs/a/push.mcap'),
        ('scripts/run', 'runs/a b/push.mcap', "scripts/run report 'runs/a b/push.mcap'"),
    ],
)
def test_a_recommended_command_can_be_copied(monkeypatch, program, path, report):
    monkeypatch.delenv(COMMAND_ENV, raising=False)
    if program:
        monkeypatch.setenv(COMMAND_ENV, program)
    first, second = next_steps(Path(path))
    assert first == f'report it  {report}'
    assert second == f'watch it   {report.replace("report", "view", 1)}'
