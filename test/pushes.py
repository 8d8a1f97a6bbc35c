"""Pushes for tests."""

from ballbot_ros.engine.scenario.scenario import ScheduledPush


def pushes(time, duration, force_x, force_y=0.0):
    """Return pushes that together have these forces [N] on the planes."""
    return (
        ScheduledPush(time, duration, force=force_x, direction='forward'),
        ScheduledPush(time, duration, force=force_y, direction='right'),
    )
