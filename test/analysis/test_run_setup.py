"""What was changed between runs, each once, and labels that tell them apart."""

from pathlib import Path

from hypothesis import strategies as st
from laws import given

from ballbot_ros.analysis.run_setup import (
    ABSENT,
    RecordedSetup,
    SetupChange,
    labels_of,
    names_of,
    setup_changes,
)

TEXTS = st.dictionaries(st.sampled_from(('a.x', 'b.x', 'a.y', 'c')), st.sampled_from('123'))
SETUPS = st.builds(RecordedSetup, TEXTS, TEXTS)


@given(SETUPS, st.integers(2, 4))
def test_equal_runs_have_no_changes(setup, count):
    assert setup_changes([setup] * count) == []


@given(st.lists(SETUPS, min_size=2, max_size=3))
def test_what_differs_is_there_once_and_nothing_else(setups):
    changes = setup_changes(setups)
    assert all(len(set(each.values)) > 1 for each in changes)
    kept = {(each.short_name, each.values) for each in changes}
    for part in ('parameters', 'others'):
        for name in {name for each in setups for name in getattr(each, part)}:
            values = tuple(getattr(each, part).get(name, ABSENT) for each in setups)
            assert (len(set(values)) == 1) or (name.rpartition('.')[2], values) in kept
    alone = setup_changes([RecordedSetup(each.parameters, {}) for each in setups])
    names = [(each.name, each.values) for each in alone]
    assert len(names) == len(set(names))


def changed(before, after):
    changes = setup_changes([RecordedSetup(before, {}), RecordedSetup(after, {})])
    return [(each.name, each.text('AB')) for each in changes]


def test_a_shared_parameter_is_that_of_the_controller():
    shared = ('gamepad_teleop.k_thetadot', 'controller.k_thetadot')
    assert changed(dict.fromkeys(shared, '380'), dict.fromkeys(shared, '500')) == [
        ('controller.k_thetadot', '380 → 500')
    ]


def test_a_seed_of_all_devices_is_one_change():
    shared = ('gyro_driver.seed', 'sonar_driver.seed')
    assert changed(dict.fromkeys(shared, '1'), dict.fromkeys(shared, '2')) == [('seed', '1 → 2')]
    assert changed(dict.fromkeys(shared, '1'), dict(zip(shared, '12', strict=True))) == [
        ('sonar_driver.seed', '1 → 2')
    ]


def test_unknown_parameters_are_not_compared():
    known, unknown = RecordedSetup({'a.x': '1'}, {}), RecordedSetup(None, {})
    assert setup_changes([known, unknown]) == [SetupChange('parameters', ('known', 'unknown'))]
    assert setup_changes([unknown, unknown]) == []


def test_of_three_runs_those_with_one_value_are_named_together():
    assert SetupChange('a.x', ('1', '2', '1')).text('ABC') == 'A, C: 1; B: 2'


def test_recordings_are_named_by_what_tells_them_apart():
    for paths, names in (
        (('before.mcap', 'after.mcap'), ['before', 'after']),
        (('one/push.mcap', 'two/push.mcap'), ['one/push', 'two/push']),
        (('now_push/push.mcap', 'then_push/push.mcap'), ['now_push', 'then_push']),
        (('a/b/push.mcap', 'c/b/push.mcap'), ['a/b/push', 'c/b/push']),
        (('push/push.mcap', 'push/push.mcap'), ['push', 'push']),
    ):
        assert names_of([Path(path) for path in paths]) == names


SEGMENTS = st.lists(st.sampled_from('ab'), min_size=1, max_size=4)


@given(st.lists(SEGMENTS, min_size=2, max_size=5))
def test_different_recordings_have_different_names(paths):
    files = [Path('/root', *each[:-1], f'{each[-1]}.mcap') for each in paths]
    names = names_of(files)
    assert len(set(zip(files, names, strict=True))) == len(set(files)) == len(set(names))


def test_a_label_names_few_changes_and_counts_many():
    changes = [SetupChange('controller.k_thetadot', ('380', '500', '380'))]
    assert labels_of(['now', 'then', 'again'], changes) == [
        'A now', 'B then (k_thetadot 500)', 'C again',
    ]  # fmt: skip
    assert labels_of(['a', 'b'], [SetupChange(f'n.{i}', ('1', '2')) for i in range(3)]) == [
        'A a', 'B b (3 changes)',
    ]  # fmt: skip
