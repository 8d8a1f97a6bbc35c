"""Complaints about inputs: each is seen at least once, and none twice at a time."""

from ballbot_ros.teleop.complaints import Complaints


def test_a_complaint_stays_until_it_is_healed_and_was_reported():
    complaints = Complaints()
    assert complaints.add('joy', 'axis 1 is nan')
    assert not complaints.add('joy', 'axis 1 is inf')
    assert str(complaints) == 'joy: axis 1 is inf'
    complaints.reported()
    assert str(complaints) == 'joy: axis 1 is inf'
    complaints.heal('joy')
    assert str(complaints) == 'joy: axis 1 is inf'
    complaints.reported()
    assert str(complaints) == ''
    assert complaints.add('joy', 'axis 1 is inf')


def test_what_goes_wrong_again_before_the_report_stays():
    complaints = Complaints()
    complaints.add('joy', 'axis 1 is nan')
    complaints.heal('joy')
    complaints.add('joy', 'axis 1 is nan')
    complaints.add('cmd_vel', 'linear.x is nan')
    complaints.reported()
    assert str(complaints) == 'joy: axis 1 is nan; cmd_vel: linear.x is nan'
