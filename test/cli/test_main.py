import sys

import pytest

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
