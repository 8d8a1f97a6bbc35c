"""The memory and work of a report: bounded for each tick."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from ballbot_ros.analysis.assessment import assess
from ballbot_ros.analysis.extraction import STAMPED_TOPICS
from ballbot_ros.analysis.limit_cycle import spectrum_table
from ballbot_ros.analysis.run_data import Series, read_run
from ballbot_ros.analysis.run_figures import FIGURES
from ballbot_ros.engine.trajectory import Trajectory
from ballbot_ros.parameters.timing import TICK_NS
from ballbot_ros.recording.reader import RecordingReader

TICKS = 100_000

KEPT = 150
"""Bytes that a tick may occupy: with the 900 000 ticks of an hour, a report may take 300 MB."""

ON_THE_WAY = 64
"""Additional bytes per tick that may be needed temporarily."""


def test_stamped_messages_are_not_decoded_one_by_one(driven, monkeypatch):
    decoded = []
    decode = RecordingReader.decode

    def count(reader, raw):
        decoded.append(raw.topic)
        return decode(reader, raw)

    monkeypatch.setattr(RecordingReader, 'decode', count)
    read_run(driven[0])
    stamped = {topic.resolved() for topic in STAMPED_TOPICS}
    assert sum(name in stamped for name in decoded) <= len(stamped)


def test_a_tick_takes_few_bytes_of_memory(driven):
    run = read_run(driven[0])
    arrays = [
        column for each in (*run.series.values(), run.trajectory) for column in vars(each).values()
    ]
    buffers = {column.__array_interface__['data'][0]: column.nbytes for column in arrays}
    assert sum(buffers.values()) < KEPT * len(run.trajectory.time)


@pytest.fixture(scope='module')
def long(short_assessment):
    """A run of many ticks with random numbers."""
    random = np.random.default_rng(1)
    run = short_assessment.run
    stamps = 10**9 + TICK_NS * np.arange(TICKS)
    time = stamps * 1e-9 - 1.0
    values = {
        topic: random.normal(size=(TICKS, width)).astype(kind)
        for topic, (kind, width, _) in STAMPED_TOPICS.items()
    }
    series = {
        topic: Series(stamps, time, values[topic]) if topic.period_ns == TICK_NS else known
        for topic, known in run.series.items()
    }
    position, psi, duty = (random.normal(size=(TICKS, 2)) for _ in range(3))
    return replace(run, series=series, trajectory=Trajectory(time, position, psi, duty))


def needed(function, run):
    """Return the additional bytes that a function needs."""
    tracemalloc.start()
    try:
        function(run)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_measuring_takes_little_additional_memory(long):
    assert needed(assess, long) < ON_THE_WAY * TICKS


@pytest.mark.parametrize('figure', FIGURES, ids=lambda figure: figure.name)
def test_a_figure_takes_little_additional_memory(long, figure):
    assert needed(figure.table, long) < ON_THE_WAY * TICKS


def test_a_spectrum_takes_little_additional_memory(long):
    assert needed(spectrum_table, long) < ON_THE_WAY * TICKS
