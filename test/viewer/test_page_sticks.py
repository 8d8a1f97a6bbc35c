"""When a page's stick counts as held."""

import pytest

from ballbot_ros.viewer.live_controls import PageSticks
from ballbot_ros.viewer.overlay import Hold


def value(now_s, *reports):
    sticks = PageSticks()
    for report in reports:
        sticks.hold(Hold(*report))
    return sticks.value(now_s)


@pytest.mark.parametrize(
    ('reports', 'held'),
    [
        ([], None),
        ([(1, 1.0, 0.0, 0.0)], None),  # a single report, as from a hidden page
        ([(1, 1.0, 0.0, 0.0), (1, 1.0, 0.0, 0.05)], (1.0, 0.0)),
        ([(1, 1.0, 0.0, 0.0), (1, 0.5, -0.5, 0.05)], (0.5, -0.5)),  # the newest counts
        ([(1, 1.0, 0.0, 0.0), (1, 0.0, 0.0, 0.05)], None),  # released
        ([(1, 1.0, 0.0, -1.0), (1, 1.0, 0.0, 0.0)], None),  # one report a second
        ([(1, 1.0, 0.0, 0.0), (2, 1.0, 0.0, 0.05)], None),  # of two pages
        ([(1, 1.0, 0.0, -0.3), (1, 1.0, 0.0, -0.25)], None),  # silent since
        (
            [(page, 0.7, sign, 0.0) for page, sign in ((1, 1.0), (2, -1.0)) for _ in 'ab'],
            (1.0, 0.0),
        ),
    ],
)
def test_value(reports, held):
    assert value(0.1, *reports) == held


def test_pages_that_have_left_are_forgotten():
    sticks = PageSticks()
    for page in range(100):
        sticks.hold(Hold(page, 1.0, 0.0, 0.0))
    sticks.value(1.0)
    assert not sticks._reports
