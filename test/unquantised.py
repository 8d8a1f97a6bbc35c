"""The robot with the quantisers off: the plant and the law that run, with exact samples and duties.

Only plane x moves. The law is evaluated in double or, as on the brick, in single precision.
"""

import math

import numpy as np

from ballbot_ros.brick.battery_monitor import battery_mv
from ballbot_ros.controllers.document import axis
from ballbot_ros.controllers.document.constants import ProgramConstants
from ballbot_ros.controllers.document.program import max_motor_voltage
from ballbot_ros.parameters import ControllerParameters, PlantParameters
from ballbot_ros.plant.plant import Plant
from ballbot_ros.simulation.devices import ENCODER_DEVICE, GYRO_DEVICE
from ballbot_ros.timing import FIRST_TICK_NS


def run_unquantised(parameters, ticks, *, number=np.float64, stick=0, pushes=()):
    """Return the states (ticks, 4) [rad, rad/s] at each tick and the duties [%] computed there."""
    plant_values = parameters.of(PlantParameters)
    plant = Plant(plant_values, FIRST_TICK_NS)
    for push in pushes:
        plant.push(push)
    ages = {}
    for device in (GYRO_DEVICE, ENCODER_DEVICE):
        dead_time = device.dead_time(parameters.of(device.parameters))
        ages[device] = dead_time.age
        plant.keep_steps(max(dead_time.longest, len(plant.truth().steps) - 1))
    gains, *others = axis.constants_of(ProgramConstants.of(parameters.of(ControllerParameters)))
    constants = (tuple(map(number, gains)), *map(number, others))
    volts = max_motor_voltage(number(battery_mv(plant_values.battery_voltage)))

    state = (number(0),) * 6
    states, duties = [], []
    for _ in range(ticks):
        truth = plant.truth()
        samples = []
        for device, age in ages.items():
            steps = truth.steps or (truth,)
            measured = device.measured(steps[-1 - age(truth.stamp_ns)])
            samples.append(number(math.degrees(measured[0])))
        state, _, duty = axis.control(constants, state, *samples, number(stick), volts)
        states.append([
            truth.position[0] / plant_values.ball_radius, truth.psi[0],
            truth.velocity[0] / plant_values.ball_radius, truth.psi_rate[0],
        ])  # fmt: skip
        duties.append(float(duty))
        plant.tick(float(duty), 0.0)
    return np.array(states), np.array(duties)
