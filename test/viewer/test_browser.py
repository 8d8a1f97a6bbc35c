"""The headless browser: one that does not start is named, with its own words."""

import pytest

pytest.importorskip('playwright', reason='the extra viewer is not installed')

from ballbot_ros.errors import ViewerError
from ballbot_ros.viewer.browser import browser_page


@pytest.mark.parametrize(
    ('script', 'reason'),
    [
        ('echo "no libfoo" >&2\necho "more" >&2\nexit 127', 'no libfoo'),
        ('exit 1', 'BrowserType.launch: Target page, context or browser has been closed'),
    ],
)
def test_a_browser_that_does_not_start_is_named_in_one_line(tmp_path, monkeypatch, script, reason):
    program = tmp_path / 'chromium'
    program.write_text(f'#!/bin/sh\n{script}\n')
    program.chmod(0o755)
    monkeypatch.setenv('PATH', str(tmp_path), prepend=':')
    with pytest.raises(ViewerError) as told, browser_page(100, 100):
        pass
    assert str(told.value) == f'{program} does not start: {reason}'
