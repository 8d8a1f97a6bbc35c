"""The plots of recorded topics: which there are, and their curves."""

import numpy as np

from ballbot_ros.analysis.topic_samples import TopicSamples
from ballbot_ros.viewer.plots import MAX_ROWS, PLOT_KINDS
from ballbot_ros.viewer.recording_page import RecordedTopics

STATE = '/controller/state'


def column(*values):
    return np.array(values, float)


class TopicRun:
    """A run with a topic, and the number of times that it was read."""

    end = 4.0

    def __init__(self, time, **columns):
        self.samples = TopicSamples(column(*time), columns)
        self.reads = 0

    def topics(self):
        return [STATE] if len(self.samples.time) else []

    def read_topic(self, topic, progress):
        assert topic == STATE
        self.reads += 1
        progress(1, 2)
        progress(2, 2)
        return self.samples


def read(*runs):
    topics, seen = RecordedTopics(runs), []
    kinds, constants = topics.read(STATE, lambda done, total: seen.append(done / total))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    return topics, kinds, constants


def curves(data):
    return {
        curve.label: values.tolist() for curve, values in zip(data.curves, data.values, strict=True)
    }


def test_only_columns_that_change_are_offered():
    run = TopicRun(
        [1.0, 2.0], a=column(0, 1), b=column(3, 3), c=column(np.nan, np.nan), d=column(np.nan, 2)
    )
    topics, kinds, constants = read(run)
    assert topics.names == [STATE]
    assert {name: kind.label for name, kind in kinds.items()} == {
        'a': '/controller/state a', 'd': '/controller/state d',
    }  # fmt: skip
    assert list(constants) == ['b', 'c']
    assert constants['b'] == 3.0


def test_samples_are_at_their_own_times_in_a_plot_of_the_whole_run():
    run = TopicRun([1.0, 2.5], a=column(7, 8))
    topics, kinds, _ = read(run)
    data = topics.plot(kinds['a'])
    assert data.time.tolist() == [0.0, 1.0, 2.5, 4.0]
    np.testing.assert_array_equal(data.values[0], [np.nan, 7.0, 8.0, np.nan])
    topics.plot(kinds['a'])
    assert run.reads == 1
    assert all(topics.plot(kind) is None for kind in PLOT_KINDS), 'they are not of a topic'


def test_a_second_run_is_a_ghost_that_keeps_its_newest_value():
    run, ghost = TopicRun([0.0, 2.0, 4.0], a=column(1, 2, 3)), TopicRun([0.0, 1.0], a=column(5, 5))
    topics, kinds, _ = read(run, ghost)
    data = topics.plot(kinds['a'])
    assert data.time.tolist() == [0.0, 1.0, 2.0, 4.0]
    shown = curves(data)
    assert shown['value'] == [1.0, 1.0, 2.0, 3.0]
    np.testing.assert_array_equal(shown['ghost value'], [5.0, 5.0, np.nan, np.nan])


def test_a_topic_of_one_run_only_has_one_curve():
    run, other = TopicRun([0.0, 4.0], a=column(1, 2)), TopicRun([])
    for runs, label in (((run, other), 'value'), ((other, run), 'ghost value')):
        topics, kinds, _ = read(*runs)
        assert curves(topics.plot(kinds['a'])) == {label: [1.0, 2.0]}


def test_a_long_run_is_reduced_to_its_extremes():
    time = np.linspace(0.0, 4.0, 3 * MAX_ROWS)
    topics, kinds, _ = read(TopicRun(time, a=np.sin(time)))
    data = topics.plot(kinds['a'])
    assert len(data.time) <= MAX_ROWS
    assert (np.diff(data.time) > 0.0).all()
    assert data.values[0].max() == np.sin(time).max()
