"""The processor of the brick in the panel, while a run stands still."""

import re

import numpy as np

from ballbot_ros.recording.messages.jobs import Jobs
from ballbot_ros.viewer.processor_panel import WINDOW_US, timeline_svg

UNTIL_US = 2_000_000
FIRST_US = UNTIL_US - WINDOW_US


def jobs(*rows):
    """Return jobs of two tasks: task, release, start, end, preempted [µs], and whether lost."""
    columns = np.array(rows, np.int64).reshape(-1, 6).T
    return Jobs(('fast', 'a<b'), *columns[:5], columns[5] > 0)


def bars(svg):
    """Return x, width and height of the bars [px]."""
    found = re.findall(r'<rect x="([\d.]+)" y="[\d.]+" width="([\d.]+)" height="([\d.]+)"', svg)
    return [tuple(map(float, each)) for each in found]


def test_a_job_is_a_bar_from_start_to_end_on_a_line_from_its_release():
    svg = timeline_svg(
        jobs((0, FIRST_US + 4000, FIRST_US + 5000, FIRST_US + 9000, 0, 0)), UNTIL_US, 1.0, 0
    )
    assert bars(svg) == [(108.0, 52.5, 1.5), (118.5, 42.0, 10.0)]
    assert 'last 20 ms before 1.000 s' in svg
    assert 'a&lt;b' in svg


def test_a_preempted_job_has_two_bars():
    svg = timeline_svg(
        jobs(
            (0, FIRST_US + 2000, FIRST_US + 2000, FIRST_US + 3000, 0, 0),
            (1, FIRST_US + 1000, FIRST_US + 1000, FIRST_US + 5000, 1000, 0),
        ),
        UNTIL_US,
        1.0,
        0,
    )
    assert sorted(x for x, _, height in bars(svg) if height == 10.0)[:2] == [76.5, 87.0]


def test_jobs_outside_are_not_shown_and_those_at_the_edges_are_cut():
    inside = (0, FIRST_US - 500, FIRST_US - 500, FIRST_US + 500, 0, 0)
    svg = timeline_svg(
        jobs((0, 10, 10, 20, 0, 0), inside, (1, UNTIL_US, UNTIL_US, UNTIL_US + 9, 0, 0)),
        UNTIL_US,
        1.0,
        0,
    )
    assert bars(svg) == [(66.0, 5.25, 1.5), (66.0, 5.25, 10.0)]


def test_a_lost_alarm_is_a_cross():
    at = FIRST_US + 10_000
    assert '<text x="171.00" y="26.0" fill="#d55e00">×</text>' in (
        timeline_svg(jobs((1, at, at, at, 0, 1)), UNTIL_US, 1.0, 0)
    )
    assert '×' not in timeline_svg(jobs(), UNTIL_US, 1.0, 0)
