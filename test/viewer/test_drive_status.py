"""The status of a robot that is driven by hand."""

import math

import pytest

from ballbot_ros.controllers.interface import OperatingState
from ballbot_ros.viewer.run_activity import drive_status
from ballbot_ros.viewer.snapshot import Snapshot

ROBOT = Snapshot(
    4.34, (0.123, -0.04), (math.radians(0.4), math.radians(-0.1)), speed=(0.171, 0.0),
    sonar=0.85, state='remote',
)  # fmt: skip


def test_forward_and_rightward_are_positive():
    assert drive_status(ROBOT, 0.998) == {
        'sim time': '4.3 s   1.00 × real time',
        'state': 'remote',
        'position': 'forward   +12.3 cm     rightward    -4.0 cm',
        'pitch': 'forward    +0.4 °      rightward    -0.1 °',
        'speed': 'forward   +17.1 cm/s   rightward    +0.0 cm/s',
        'sonar': '85 cm',
    }


@pytest.mark.parametrize(('distance', 'text'), [(math.inf, 'no echo'), (math.nan, '–')])
def test_a_distance_may_be_unknown(distance, text):
    assert drive_status(ROBOT._replace(sonar=distance), 1.0)['sonar'] == text


def test_before_the_first_pose_the_rows_are_there():
    assert drive_status(None, 0.0).keys() == drive_status(ROBOT, 0.0).keys()


def test_a_restart_is_advised_only_after_a_fall():
    advised = [
        state
        for state in OperatingState
        if 'press r' in drive_status(ROBOT._replace(state=state), 1.0)['state']
    ]
    assert advised == [OperatingState.OUT_OF_CONTROL]
