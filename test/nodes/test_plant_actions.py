"""Execution of the master's actions by the plant's node."""

from typing import get_args

import pytest

from ballbot_ros.simulation.run_actions import Action

pytest.importorskip('rclpy')

from ballbot_ros.nodes.plant_actions import PlantActions


def test_every_action_of_the_master_can_be_carried_out():
    handled = vars(PlantActions)['_carry_out'].dispatcher.registry
    assert set(get_args(Action)) == set(handled) - {object}
