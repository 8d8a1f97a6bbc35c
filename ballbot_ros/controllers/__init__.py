"""Controllers of the robot: the base class for your own, and those that ship. No ROS."""

from ballbot_ros.controllers.controller import (
    Controller,
    Duty,
    LawController,
    Readings,
    as_numbers,
    duty_of_voltage,
    max_voltage,
    task,
)
from ballbot_ros.controllers.interface import Estimates, OperatingState
from ballbot_ros.errors import ControllerError
from ballbot_ros.parameters import ControllerParameters, TakesEffect, designed, quantity, setting
from ballbot_ros.parameters.timing import TICK_S
from ballbot_ros.robot.plant.model import PhysicalParameters

__all__ = [
    'TICK_S', 'Controller', 'ControllerError', 'ControllerParameters', 'Duty', 'Estimates',
    'LawController', 'OperatingState', 'PhysicalParameters', 'Readings', 'TakesEffect',
    'as_numbers', 'designed', 'duty_of_voltage', 'max_voltage', 'quantity', 'setting', 'task',
]  # fmt: skip
