"""How much of a silence counts on a machine that has more to do."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot_ros.simulation.patience import LOOK_S, Activity, Patience

IDLE = Activity(cpu_s=1.0, queued_s=0.0, is_due=False)


def looked(*looks):
    """Return a patience after looks at a silence that began at 0 s: each a time and what it saw."""
    patience = Patience()
    for now_s, processes in looks:
        patience.look(0.0, now_s, processes)
    return patience


@pytest.mark.parametrize(
    ('name', 'progress', 'counts'),
    [
        ('waits for a message, or is stopped', lambda now: IDLE, 1.0),
        ('computes without an end', lambda now: Activity(now, 0.0, is_due=True), 1.0),
        ('so with a tenth of a processor', lambda now: Activity(0.1 * now, now, True), 0.1),
        ('works now and then', lambda now: Activity(0.1 * now, 0.4 * now, False), 0.6),
        ('waits for its turn', lambda now: Activity(1.0, 0.0, is_due=True), 0.0),
    ],
)
def test_the_time_counts_that_the_machine_gave(name, progress, counts):
    patience = looked(*((0.1 * look, {7: progress(0.1 * look)}) for look in range(101)))
    assert patience.silence_s(7) == pytest.approx(10.0 * counts, abs=0.11)


def test_each_process_has_a_silence_of_its_own():
    looks = [
        (0.1 * look, {1: IDLE, 2: Activity(0.0, 0.05 * look, is_due=False)}) for look in range(101)
    ]
    patience = looked(*looks)
    assert patience.silence_s(1) == pytest.approx(10.0)
    assert patience.silence_s(2) == pytest.approx(5.0, abs=0.11)
    assert patience.silence_s() == pytest.approx(10.0), 'that of another machine'


def test_who_is_gone_has_had_the_time():
    patience = looked((0.1, {1: IDLE}), (0.2, {}), (0.3, {}))
    assert patience.silence_s(1) == pytest.approx(0.3)
    assert patience.silence_s(2) == pytest.approx(0.3), 'gone before the first look'


def test_of_who_has_just_come_only_that_counts():
    patience = looked((0.1, {1: IDLE}), (0.2, {1: IDLE, 2: IDLE}), (0.3, {1: IDLE, 2: IDLE}))
    assert patience.silence_s(2) == pytest.approx(0.2)


def test_who_did_not_look_has_heard_nothing():
    assert looked((0.1, {}), (100.0, {})).silence_s() == pytest.approx(0.1 + LOOK_S)


def test_another_silence_begins_at_nothing():
    patience = looked(*((0.1 * look, {1: IDLE}) for look in range(31)))
    patience.look(2.9, 3.0, {1: IDLE})
    assert patience.silence_s(1) == patience.silence_s() == pytest.approx(0.1)


@given(
    st.lists(
        st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 1.0), st.floats(0.0, 3.0), st.booleans()),
        min_size=1,
        max_size=30,
    )
)
def test_a_silence_is_never_longer_than_the_time_and_never_negative(steps):
    patience = Patience()
    now = cpu = queued = 0.0
    for span, used, waited, is_due in steps:
        now, cpu, queued = now + span, cpu + used, queued + waited
        patience.look(0.0, now, {1: Activity(cpu, queued, is_due)})
        assert 0.0 <= patience.silence_s(1) <= patience.silence_s() <= now + 1e-9
