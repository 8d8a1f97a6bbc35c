"""Errors in scenario files."""

from ballbot_ros.errors import BallbotError


class ScenarioError(BallbotError):
    """An unknown scenario, or a file that does not describe one."""
