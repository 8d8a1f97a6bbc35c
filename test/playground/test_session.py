"""A run that the page steers: back to any moment and on from there, to the bit."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from playground_python import load

from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS

session = load('session.py')

TIME, X, Y, PITCH_X, PITCH_Y, DUTY_X, DUTY_Y, GAIN, END = range(9)
MARK_S = session.MARK_TICKS * TICK_NS / SECOND_NS

SHARES = st.sampled_from((-1.0, -0.5, 0.0, 0.25, 1.0))
ACTIONS = st.one_of(
    st.tuples(st.just('push'), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)),
    st.tuples(st.just('hold'), SHARES, SHARES),
    st.tuples(st.just('scale_gain'), st.floats(0.7, 1.5)),
)
STEPS = st.lists(st.tuples(ACTIONS, st.integers(1, 60)), min_size=1, max_size=6)


def table(rows):
    width = len(session.ROW)
    return [tuple(rows[at : at + width]) for at in range(0, len(rows), width)]


def act(run, steps):
    rows = []
    for (action, *values), ticks in steps:
        getattr(run, action)(*values)
        rows += table(run.advance(ticks))
    return rows


@settings(max_examples=40, deadline=None)
@given(scenario=st.sampled_from(('stationary', 'hardware_standing', 'push')), before=STEPS,
       after=STEPS, seconds=st.floats(0.0, 4.0))  # fmt: skip
def test_going_back_leads_to_the_same_run(scenario, before, after, seconds):
    run = session.Session(scenario)
    rows = table(run.advance(400)) + act(run, before)
    time = run.go_back(seconds)
    assert 0.0 <= min(seconds, rows[-1][TIME]) - time < MARK_S
    first = next(number for number, row in enumerate(rows) if row[TIME] >= time)
    assert run.gain == rows[first][GAIN]
    run.hold(0.0, 0.0)
    branch = act(run, after)
    assert run.go_back(time) == time
    run.hold(0.0, 0.0)
    assert act(run, after) == branch


def test_going_back_without_a_change_repeats_the_run():
    run = session.Session('square')
    rows = table(run.advance(1500))
    run.go_back(1.0)
    assert table(run.advance(1250)) == rows[250:]


def test_the_history_is_bounded(monkeypatch):
    monkeypatch.setattr(session, 'KEPT_MARKS', 3)
    run = session.Session('stationary')
    run.advance(session.MARK_TICKS * 10)
    assert run.go_back(0.0) == pytest.approx(7 * MARK_S)


def test_a_stick_that_is_held_replaces_the_scenarios():
    held, free = session.Session('square'), session.Session('square')
    held.hold(1.0, 0.0)
    rows, others = table(held.advance(1500)), table(free.advance(1500))
    assert rows[-1][X] > others[-1][X] + 0.1
    assert abs(rows[-1][Y]) < 0.01


def test_a_push_is_one_in_plane_signs():
    run = session.Session('stationary')
    run.advance(750)
    run.push(0.0, 1.0)
    rows = table(run.advance(100))
    # The ball rolls away first, so that the body leans back.
    assert min(row[PITCH_Y] for row in rows) < math.radians(-2.0)
    assert max(abs(row[PITCH_X]) for row in rows) < math.radians(1.0)


def test_more_gain_rings_and_less_lets_it_fall():
    run = session.Session('stationary')
    run.advance(500)
    run.scale_gain(1.4)
    duties = [row[DUTY_X] for row in table(run.advance(750))][-250:]
    alternating = sum(duty * (-1) ** number for number, duty in enumerate(duties)) / len(duties)
    assert abs(alternating) > 50.0
    run.scale_gain(0.3)
    assert table(run.advance(2000))[-1][END] == 1.0


def test_a_wall_ends_the_run():
    run = session.Session('remote_wall')
    run.advance(250)
    run.hold(0.0, 1.0)
    rows = table(run.advance(2000))
    assert rows[-1][END] == 2.0
    assert len(rows) < 2000
    assert not run.advance(10)
