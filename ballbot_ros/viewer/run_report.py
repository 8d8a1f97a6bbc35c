"""The report of the run on a live page."""

from __future__ import annotations

from html import escape
from pathlib import Path
from threading import Lock

from ballbot_ros.errors import BallbotError


class RunReport:
    """Makes the report of a recording when it is first asked for; any thread may ask."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._recording = ''
        self._page = b''

    def page(self, recording: str) -> bytes:
        """Return the page of a recording, or one that says why there is none."""
        with self._lock:
            if recording != self._recording:
                self._page = _page(recording)
                self._recording = recording
            return self._page


def _page(recording: str) -> bytes:
    if not recording:
        return _notice('This run has no report: it has not ended, or was not recorded.')
    # Imported only here: it takes half a second.
    from ballbot_ros.analysis.assessment import assess
    from ballbot_ros.analysis.report import make_report
    from ballbot_ros.analysis.run_data import read_run

    try:
        return make_report(assess(read_run(Path(recording)))).page.encode()
    except (BallbotError, OSError) as error:
        return _notice(f'There is no report: {error}')


def _notice(text: str) -> bytes:
    return f'<!DOCTYPE html><title>Report</title><p>{escape(text)}</p>'.encode()
