"""The choice of plots of recorded topics: a folder for each, read when it is opened."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from functools import partial
from html import escape
from typing import Any

import viser

from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.viewer.plots import Plots
from ballbot_ros.viewer.recorded_topics import RecordedTopics


class TopicChooser:
    """Closed folders, one for each topic, in the folder in which plots are chosen.

    viser does not report that a folder is opened. Therefore a button takes the place of a folder
    until then.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        plots: Plots,
        topics: RecordedTopics,
        notify: Callable[[str], None],
    ) -> None:
        self._gui, self._plots, self._topics, self._notify = gui, plots, topics, notify
        self._lock = threading.Lock()
        self._opened: set[str] = set()
        with plots.chooser:
            for topic in topics.names:
                button = gui.add_button(topic, color='gray', icon=viser.Icon.CHEVRON_DOWN)
                button.on_click(partial(self._on_click, topic, button))

    def _on_click(self, topic: str, button: viser.GuiButtonHandle, _: Any) -> None:
        """Open the folder of a topic; viser calls this in a thread of its own."""
        with self._lock:  # one after the other, and each only once
            if topic not in self._opened:
                self._open(topic, button)

    def _open(self, topic: str, button: viser.GuiButtonHandle) -> None:
        button.disabled = True
        with self._plots.chooser:
            bar: Any = self._gui.add_progress_bar(0.0, order=button.order)

        def show_progress(done: int, total: int) -> None:
            bar.value = 100.0 * done / total

        try:
            found = self._topics.read(topic, show_progress)
        except RecordingError as error:
            self._notify(str(error))
            button.disabled = False
            return
        finally:
            bar.remove()
        with self._plots.chooser, self._gui.add_folder(topic, order=button.order):
            self._plots.offer(found.kinds)
            if found.constants or not found.kinds:
                self._gui.add_html(_unchanging(found.constants))
        button.remove()
        self._opened.add(topic)


def _unchanging(constants: Mapping[str, float]) -> str:
    """Return a note about the columns that have no plot."""
    values = ', '.join(
        f'{escape(name)} {"–" if math.isnan(value) else format(value, "g")}'
        for name, value in constants.items()
    )
    return (
        '<div style="font-size:11px;line-height:1.35;opacity:0.7;margin:0 1em 0.6em;'
        f'overflow-wrap:anywhere">{f"never changes: {values}" if values else "no numbers"}</div>'
    )
