"""The robot with the quantisers off: the plant and the law that run, with exact samples and duties.

It tells what the rounding of the NXT adds: the loop is then as linear as its plant, as long as the
duty does not reach its limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
import parts

from ballbot_ros.controllers.document import axis
from ballbot_ros.controllers.document.axis import ProgramConstants, Single
from ballbot_ros.controllers.document.program import max_motor_voltage
from ballbot_ros.engine.devices import ENCODER_DEVICE, GYRO_DEVICE, AnyDevice
from ballbot_ros.engine.plant import Plant
from ballbot_ros.parameters import ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.parameters.timing import FIRST_TICK_NS
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.sensors import battery_mv
from ballbot_ros.robot.plant.ground_truth import Push

Number: TypeAlias = type[np.float64] | type[np.float32]
"""The precision of the law."""


class UnquantisedRun(NamedTuple):
    """Plane x in a run with the quantisers off.

    Attributes
    ----------
    states : ndarray, shape (n, 4)
        theta, psi [rad] and their rates [rad/s] at each tick.
    duties : ndarray, shape (n,)
        The duties [%] computed there.
    """

    states: Floats
    duties: Floats


def run_unquantised(
    parameters: ParameterSet,
    ticks: int,
    *,
    number: Number = np.float64,
    stick: float = 0.0,
    pushes: Iterable[Push] = (),
    until_saturated: bool = False,
) -> UnquantisedRun:
    """Run plane x of the robot under the document's program with exact samples and duties.

    The program controls from the first tick on, so `plant_sim.hold_time` should be 0, unless the
    robot shall be held while it does.

    Parameters
    ----------
    ticks : int
        Length of the run [ticks].
    number : type
        The law is evaluated in double or, as on the brick, in single precision.
    stick : float
        Speed command.
    pushes : iterable of Push
        Pushes of the plant.
    until_saturated : bool
        Whether the run ends with the first duty of ±100 %.
    """
    plant_values = parameters.of(PlantParameters)
    plant = Plant(plant_values, FIRST_TICK_NS)
    for push in pushes:
        plant.push(push)
    devices: tuple[AnyDevice, ...] = (GYRO_DEVICE, ENCODER_DEVICE)
    plant.keep_steps(max(each.longest_delay(parameters.of(each.parameters)) for each in devices))
    measures = [parts.sampled(device, parameters.of(device.parameters)) for device in devices]
    gains, *others = axis.constants_of(ProgramConstants.of(parameters.of(ControllerParameters)))
    constants = cast(axis.Constants, (tuple(map(number, gains)), *map(number, others)))
    volts = max_motor_voltage(_single(number, battery_mv(plant_values.battery_voltage)))
    command = _single(number, stick)

    state = cast(axis.AxisState, (number(0),) * 6)
    states, duties = [], []
    for _ in range(ticks):
        truth = plant.truth()
        gyro, angle = (_single(number, math.degrees(measured(truth)[0])) for measured in measures)
        state, _, duty = axis.control(constants, state, gyro, angle, command, volts)
        states.append((
            truth.position[0] / plant_values.ball_radius, truth.psi[0],
            truth.velocity[0] / plant_values.ball_radius, truth.psi_rate[0],
        ))  # fmt: skip
        duties.append(float(duty))
        if until_saturated and abs(duty) >= axis.HUNDRED:
            break
        # The real motors are given whole percent only.
        plant.tick(cast(Any, float(duty)), 0)
    return UnquantisedRun(np.array(states), np.array(duties))


def _single(number: Number, value: float) -> Single:
    """Return a value in the law's precision; the law's types are those of the brick."""
    return cast(Single, number(value))
