"""Columns of measures have names of their own, and know which value is the worst."""

from ballbot_ros.engine.scenario.scenario import Expectation, Measure
from ballbot_ros.lab.studies.columns import MeasureColumn


def test_the_bounds_say_which_value_is_the_worst():
    pitch = Measure('peak_pitch_deg')
    for expectations, worst in (
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
        assert MeasureColumn.of(pitch, expectations).worst == worst, expectations
    assert MeasureColumn.of(Measure('wall_clearance_m', 1.0)).worst == 'smallest'
    clearance = (Expectation('wall_clearance_m', maximum=0.1),)
    assert MeasureColumn.of(Measure('wall_clearance_m'), clearance).worst == 'largest'


def test_columns_of_windows_have_names_of_their_own():
    for window, suffix in (
        ((), ''),
        ((0.0, 7.5), '[0,7.5]'),
        ((2.0,), '[2,end]'),
        ((0.1234567891, 1e6), '[0.1234567891,1000000]'),
    ):
        name = MeasureColumn.of(Measure('peak_pitch_deg', *window)).name
        assert name == f'peak_pitch_deg{suffix}'
