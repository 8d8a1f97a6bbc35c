"""Predicted limits on maps are those of the loop and of the motors."""

import numpy as np
import pytest

from ballbot_ros.controllers.design.loop_analysis import recoverable_states
from ballbot_ros.lab.studies.columns import ColumnKind, ResultColumn
from ballbot_ros.lab.studies.maps import predict, refined, usual_values
from ballbot_ros.lab.studies.survey import Axis, Extent
from ballbot_ros.parameters import ParameterSet

GAIN, DELAY = 'controller.pwm_gain', 'plant_sim.actuator_delay'
PITCH, RATE = 'plant_sim.start_pitch_x', 'plant_sim.start_pitch_rate_x'


def axis(name, values, kind=ColumnKind.FLOAT):
    extent = Extent()
    extent.add(np.asarray(values))
    return Axis.of(ResultColumn(name, kind), extent, 10_000, 20, is_grid=True)


def crossings(lines, place, column):
    """Return where lines cross a value of one of their columns."""
    found = []
    for line in lines:
        at, other = line[:, column] - place, line[:, 1 - column]
        for index in np.flatnonzero(at[1:] * at[:-1] <= 0.0):
            part = at[index] / (at[index] - at[index + 1]) if at[index] != at[index + 1] else 0.0
            found.append(other[index] + part * (other[index + 1] - other[index]))
    return sorted(found)


@pytest.mark.parametrize('turned', [False, True])
def test_the_loop_is_stable_between_two_gains_and_with_less_than_a_tick_of_dead_time(turned):
    gain = axis(GAIN, np.linspace(0.4, 1.6, 61))
    delay = axis(DELAY, np.arange(5), ColumnKind.INTEGER)
    pair = (delay, gain) if turned else (gain, delay)
    prediction = predict(ParameterSet(), *pair)
    column = 0 if turned else 1
    found = crossings(prediction.lines, 0.1, column)
    np.testing.assert_allclose(found, [0.523, 1.05], atol=0.01)
    # One tick of dead time: at the document's gain the loop is unstable.
    found = crossings(prediction.lines, 1.0001, 1 - column)
    assert [each for each in found if 3.0 < each < 4.0] == pytest.approx([3.5], abs=1e-3)
    assert 'without quantisation' in prediction.sentence


def test_a_map_that_the_limit_does_not_cross_says_so():
    mass = axis('plant_sim.body_mass', np.linspace(0.66, 0.7, 21))
    slow = ParameterSet()
    slow.set('plant_sim', 'actuator_delay', 8)
    for parameters, verdict in ((ParameterSet(), 'stable'), (slow, 'unstable')):
        gain = axis(GAIN, np.linspace(0.9, 1.0, 21))
        prediction = predict(parameters, mass, gain)
        assert prediction.lines == []
        assert f'the loop is {verdict} all over this map' in prediction.sentence


def test_a_variable_with_one_value_does_not_hide_the_prediction():
    constant = axis(GAIN, np.full(60, 0.8))
    prediction = predict(ParameterSet(), constant, axis('plant_sim.body_mass', [0.6, 0.7]))
    assert 'the loop is stable all over this map' in prediction.sentence


@pytest.mark.parametrize('turned', [False, True])
def test_the_limit_of_the_motors(turned):
    pitch, rate = axis(PITCH, np.linspace(-0.3, 0.3, 51)), axis(RATE, np.linspace(-1.5, 1.5, 51))
    pair = (rate, pitch) if turned else (pitch, rate)
    lines = predict(ParameterSet(), *pair).lines
    assert len(lines) == 2
    limit = recoverable_states(ParameterSet())
    for line in lines:
        x, y = line[:, ::-1].T if turned else line.T
        states = np.column_stack([0 * x, x, 0 * x, y])
        np.testing.assert_allclose(limit.share(states), 1.0, atol=1e-9)


def test_there_is_no_prediction_where_theory_knows_none():
    gain = axis(GAIN, np.linspace(0.5, 1.5, 11))
    noise = axis('gyro_driver.noise', np.linspace(0.0, 1.0, 11))
    words = axis('plant_sim.body_mass', np.array(['a', 'b']), ColumnKind.TEXT)
    other_plane = axis('plant_sim.start_pitch_rate_y', np.linspace(-1.0, 1.0, 11))
    pitch = axis(PITCH, np.linspace(-0.3, 0.3, 11))
    for pair in ((gain, noise), (gain, words), (pitch, other_plane), (pitch, gain)):
        assert predict(ParameterSet(), *pair) is None
    lqg = ParameterSet()
    lqg.set('controller', 'implementation', 'lqg')
    assert predict(lqg, gain, axis(DELAY, np.arange(5), ColumnKind.INTEGER)) is None


def test_a_grid_is_refined_only_near_zeros():
    """A kink next to a zero does not move it."""
    calls = []

    def field(x, y):
        calls.append((x, y))
        return max(-0.01, 10.0 * (x - 0.37 - 0.1 * y))

    coarse = np.linspace(0.0, 1.0, 9)
    x, y, values = refined(field, (coarse, coarse), (False, False), 4)
    assert values.shape == (129, 129)
    assert len(calls) == len(set(calls)) < values.size / 4
    for b, row in zip(y, values, strict=True):
        place = np.argmax(row > 0.0)
        assert x[place - 1] <= 0.37 + 0.1 * b <= x[place]
    x, y, _ = refined(field, (coarse, coarse), (True, False), 1)
    assert (len(x), len(y)) == (9, 17)


def test_usual_values():
    columns = {
        'number': np.array([1.0, 2.0, 9.0]),
        'whole': np.array([1, 2, 2, 4]),
        'word': np.array(['b', 'a', 'b']),
    }
    assert usual_values(columns) == {'number': 2.0, 'whole': 2, 'word': 'b'}
