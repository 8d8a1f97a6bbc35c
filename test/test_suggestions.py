"""Hints about misspelt names: which names count as misspelt ones, and which are simply others."""

import pytest

from ballbot_ros.errors import did_you_mean, similar


@pytest.mark.parametrize(
    ('name', 'known', 'hint'),
    [
        ('stationry', ['push', 'stationary'], ' (did you mean stationary?)'),
        ('cuont', ['count'], ' (did you mean count?)'),
        ('k_y', ['k_i', 'gain'], ' (did you mean k_i?)'),
        ('plant', ['controller', 'plant_sim'], ' (did you mean plant_sim?)'),
        ('k', ['k_i', 'gain'], ' (did you mean k_i?)'),
        # Three letters agree, but nobody who types `real` means `ideal`.
        ('real', ['hardware', 'ideal'], ''),
        ('moon', ['corridor', 'track'], ''),
        ('', ['corridor', 'track'], ''),
        ('anything', [], ''),
    ],
)
def test_only_names_that_may_be_meant_are_suggested(name, known, hint):
    assert did_you_mean(name, known) == hint


def test_the_most_similar_name_comes_first_and_no_more_than_three():
    assert similar('gain_1', ['gain_2x', 'gain_1x', 'gain_3', 'gain_4']) == (
        'gain_1x or gain_3 or gain_4'
    )
    assert similar('gan', ['gain'], prefix='controller.') == 'controller.gain'
