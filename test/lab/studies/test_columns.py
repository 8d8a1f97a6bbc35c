"""Columns of measures have names of their own, and know which value is the worst."""

import numpy as np

from ballbot_ros.engine.scenario.scenario import Expectation, Measure
from ballbot_ros.lab.studies.columns import MeasureColumn

VALUES = np.array([1.4, 0.3, np.nan, 2.5, 1.8])
WORST = {(1, 0, 4, 3): 'smallest', (3, 4, 0, 1): 'largest', (1, 3, 4, 0): 'farthest'}
"""Places of the values, the worst first; the middle of the bounds is 1.5."""


def worst(measure, expectations=()):
    badness = MeasureColumn.of(measure, expectations).badness(VALUES)
    assert np.isnan(badness[2])
    return WORST[tuple(np.argsort(-badness, kind='stable')[:4].tolist())]


def test_the_bounds_say_which_value_is_the_worst():
    pitch = Measure('peak_pitch_deg')
    for expectations, expected in (
        ((), 'largest'),
        ((Expectation('peak_pitch_deg', maximum=1.0),), 'largest'),
        ((Expectation('peak_pitch_deg', minimum=1.0),), 'smallest'),
        ((Expectation('peak_pitch_deg', minimum=1.0, end=2.0),), 'largest'),
        ((Expectation('peak_pitch_deg', 1.0, 2.0),), 'farthest'),
        (
            (
                Expectation('peak_pitch_deg', minimum=1.0),
                Expectation('peak_pitch_deg', maximum=2.0),
            ),
            'farthest',
        ),
    ):
        assert worst(pitch, expectations) == expected, expectations
    assert worst(Measure('wall_clearance_m', 1.0)) == 'smallest'
    clearance = (Expectation('wall_clearance_m', maximum=0.1),)
    assert worst(Measure('wall_clearance_m'), clearance) == 'largest'


def test_columns_of_windows_have_names_of_their_own():
    for window, suffix in (
        ((), ''),
        ((0.0, 7.5), '[0,7.5]'),
        ((2.0,), '[2,end]'),
        ((0.1234567891, 1e6), '[0.1234567891,1000000]'),
    ):
        name = MeasureColumn.of(Measure('peak_pitch_deg', *window)).name
        assert name == f'peak_pitch_deg{suffix}'
