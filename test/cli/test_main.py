import subprocess
import sys
from pathlib import Path

import pytest
from graph import BALLBOT

from ballbot_ros.cli.main import main


class InterruptedImport:
    """Ctrl-C comes as the next module is looked for."""

    def find_spec(self, *arguments):
        raise KeyboardInterrupt


def test_ctrl_c_while_modules_load_ends_quietly(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, 'ballbot_ros.cli.command', raising=False)
    monkeypatch.setattr(sys, 'meta_path', [InterruptedImport()])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 130
    assert capsys.readouterr() == ('', '')


@pytest.mark.parametrize('words', [['scenarios'], ['design']], ids=' '.join)
def test_what_can_not_be_printed_is_one_line(words):
    with Path('/dev/full').open('w') as full:
        done = subprocess.run(
            [*BALLBOT, *words], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.stderr == 'error: standard output: No space left on device\n'
    assert done.returncode == 2


def test_a_closed_standard_output_is_no_fault():
    done = subprocess.run(
        ['sh', '-c', '"$@" >&-', 'sh', *BALLBOT, 'scenarios'], capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, b'')
