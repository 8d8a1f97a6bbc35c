"""Which messages belong to the run that is shown."""

import pytest

from ballbot_ros.viewer.snapshot import ShownRun


def test_a_sample_counts_from_the_start_of_its_run():
    run = ShownRun()
    assert run.includes(5, is_truth=True), 'a graph without runs is shown, too'
    run.announce('2 plant', 100, 1)
    assert not run.includes(99, is_truth=False), 'a late answer to the run before'
    assert not run.includes(99, is_truth=True)
    assert run.includes(100, is_truth=False)
    assert not run.includes(99, is_truth=False)
    assert run.includes(100, is_truth=True)
    assert run.includes(50, is_truth=True), 'a player has jumped back'


@pytest.mark.parametrize(
    ('events', 'name'),
    [
        ([('run', '1 a', 10)], '1 a'),
        ([('run', '1 a', 10), ('replace', 20)], ''),
        ([('run', '1 a', 10), ('replace', 20), ('run', '1 b', 30)], '1 b'),
        # The order of arrival says nothing: both are kept for late subscribers.
        ([('run', '1 b', 30), ('replace', 20)], '1 b'),
        ([('replace', 20), ('run', '1 a', 10)], ''),
        ([('replace', 20), ('run', '1 b', 30), ('replace', 20)], '1 b'),
        ([('run', '1 a', 10), ('run', '2 a', 20)], '2 a'),
    ],
)
def test_a_requested_run_replaces_those_that_were_announced_before(events, name):
    run = ShownRun()
    for kind, *what in events:
        if kind == 'run':
            assert run.announce(what[0], 0, what[1]) == (run.name == what[0])
        else:
            run.replace(*what)
    assert run.name == name
    assert run.is_awaited == (not name)
