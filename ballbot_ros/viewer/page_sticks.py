"""The sticks of all pages."""

from __future__ import annotations

from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.viewer.overlay import MAX_HELD, Hold

RELEASE_S = 0.3
"""A stick counts as released when its page has been silent for this long."""


class PageSticks:
    """The sticks of all pages, each held as long as its page keeps reporting it.

    A single report does not count: a browser slows a hidden page down to one report a second, and a
    hidden page must not drive.
    """

    def __init__(self) -> None:
        self._reports: dict[int, tuple[Hold | None, Hold]] = {}

    def hold(self, report: Hold) -> None:
        """Note a report."""
        _, last = self._reports.get(report.page, (None, None))
        self._reports[report.page] = last, report

    def value(self, now_s: float) -> Pair | None:
        """Return forward and rightward at `now_s` [s], each −1 ... 1; None if no stick is held.

        Sticks of several pages add up.
        """
        self._reports = {
            page: reports
            for page, reports in self._reports.items()
            if now_s - reports[1].at_s < RELEASE_S
        }
        held = [last for before, last in self._reports.values() if _is_held(before, last)]
        if not held:
            return None
        return _limited(sum(each.forward for each in held)), _limited(
            sum(each.rightward for each in held)
        )


def _is_held(before: Hold | None, last: Hold) -> bool:
    is_repeated = before is not None and last.at_s - before.at_s < RELEASE_S
    return is_repeated and (last.forward, last.rightward) != (0.0, 0.0)


def _limited(value: float) -> float:
    return max(-MAX_HELD, min(MAX_HELD, value))
