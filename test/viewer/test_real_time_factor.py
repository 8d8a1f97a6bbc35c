"""The real-time factor on the page: over the last second of the current run."""

import pytest

from ballbot_ros.viewer.run_activity import RealTimeFactor


def test_it_is_that_of_the_last_second():
    factor = RealTimeFactor()
    for now_s, sim_time, expected in (
        (10.0, 1.0, 0.0),
        (10.0, 1.0, 0.0),
        (10.5, 2.0, 2.0),
        (11.0, 3.0, 2.0),
        (11.5, 3.0, 1.0),  # since 10.5
        (12.0, 3.0, 0.0),
        (20.0, 9.0, 0.0),
    ):
        assert factor.update(now_s, sim_time) == pytest.approx(expected), (now_s, sim_time)


def test_a_jump_back_in_sim_time_begins_again():
    factor = RealTimeFactor()
    for now_s, sim_time, expected in ((10.0, 5.0, 0.0), (10.2, 1.0, 0.0), (10.4, 1.1, 0.5)):
        assert factor.update(now_s, sim_time) == pytest.approx(expected), (now_s, sim_time)
