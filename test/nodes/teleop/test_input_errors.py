"""Input errors: each is reported at least once, and an input has only one at a time."""

from ballbot_ros.nodes.teleop.gamepad import InputErrors


def test_an_error_stays_until_it_is_cleared_and_was_reported():
    errors = InputErrors()
    assert errors.add('joy', 'axis 1 is nan')
    assert not errors.add('joy', 'axis 1 is inf')
    assert str(errors) == 'joy: axis 1 is inf'
    errors.remove_cleared()
    assert str(errors) == 'joy: axis 1 is inf'
    errors.clear('joy')
    assert str(errors) == 'joy: axis 1 is inf'
    errors.remove_cleared()
    assert str(errors) == ''
    assert errors.add('joy', 'axis 1 is inf')


def test_an_error_that_recurs_before_the_report_stays():
    errors = InputErrors()
    errors.add('joy', 'axis 1 is nan')
    errors.clear('joy')
    errors.add('joy', 'axis 1 is nan')
    errors.add('cmd_vel', 'linear.x is nan')
    errors.remove_cleared()
    assert str(errors) == 'joy: axis 1 is nan; cmd_vel: linear.x is nan'
