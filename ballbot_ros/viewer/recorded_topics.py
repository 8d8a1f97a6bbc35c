"""Plots of the numbers in any recorded topic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballbot_ros.analysis.table import envelope
from ballbot_ros.analysis.topic_samples import TopicSamples
from ballbot_ros.progress import ProgressCallback
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.plot_kinds import (
    Floats,
    PlotData,
    PlotKind,
    ghost_columns,
    plot_data,
    topic_kind,
)
from ballbot_ros.viewer.recorded_plots import MAX_ROWS


@dataclass(frozen=True)
class TopicPlots:
    """What can be plotted of a topic: the plots by column, and the values that never change."""

    kinds: Mapping[str, PlotKind]
    constants: Mapping[str, float]


class RecordedTopics:
    """The topics of recorded runs; the messages of a topic are read once, when it is chosen.

    Attributes
    ----------
    names : list of str
        The topics whose messages can have numbers, in any of the runs.
    """

    def __init__(self, runs: Sequence[PlaybackRun]) -> None:
        self._topics_of = [(run, frozenset(run.topics())) for run in runs]
        self.names = sorted(frozenset().union(*(names for _, names in self._topics_of)))
        self._samples: dict[PlotKind, tuple[str, list[TopicSamples]]] = {}

    def read(self, topic: str, progress: ProgressCallback) -> TopicPlots:
        """Read a topic in all runs.

        Raises
        ------
        RecordingError
            As :func:`~ballbot_ros.analysis.topic_samples.read_topic`.
        """
        count = sum(topic in names for _, names in self._topics_of)
        samples: list[TopicSamples] = []
        before = 0
        for run, names in self._topics_of:
            if topic in names:
                samples.append(run.read_topic(topic, _part(progress, before, count)))
                before += 1
            else:
                samples.append(TopicSamples(np.zeros(0), {}))
        changing = dict.fromkeys(name for each in samples for name in each.changing)
        kinds = {name: topic_kind(topic, name) for name in changing}
        self._samples |= {kind: (name, samples) for name, kind in kinds.items()}
        return TopicPlots(kinds, _constants(samples, changing))

    def plot(self, kind: PlotKind) -> PlotData | None:
        """Return a plot of :meth:`read`; None if it is another plot.

        It spans the runs, with the samples at their own times. If two runs have samples at
        different times, each keeps its newest value at those of the other.
        """
        if kind not in self._samples:
            return None
        name, samples = self._samples[kind]
        end = max(run.end for run, _ in self._topics_of)
        time = np.unique(np.concatenate([[0.0, end], *(each.time for each in samples)]))
        table: dict[str, Floats] = {}
        for number, each in enumerate(samples):
            columns = {name: each.newest(name, time)} if name in each.columns else {}
            table |= ghost_columns(columns) if number else columns
        if len(samples) > 1:
            kind = kind.with_ghost()
        reduced = dict(envelope(time, table, MAX_ROWS))
        return plot_data(kind, reduced.pop('time_s'), reduced)


def _part(progress: ProgressCallback, before: int, count: int) -> ProgressCallback:
    """Return the progress of one of `count` equal parts, with the number of those before it."""
    return lambda done, total: progress(before * total + done, count * total)


def _constants(samples: Sequence[TopicSamples], changing: Mapping[str, object]) -> dict[str, float]:
    """Return the values that do not change, of the first run that has them."""
    return {
        name: float(values[0])
        for each in reversed(samples)
        for name, values in each.columns.items()
        if name not in changing
    }
