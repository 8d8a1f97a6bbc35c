"""The robot as a physical object: a plant with its constants, its state and its buffers."""

from __future__ import annotations

import struct
from copy import copy
from typing import Any, NamedTuple

from ballbot_ros.engine.devices import numbers_of
from ballbot_ros.engine.plant_tick import (
    NEVER_NS,
    PlantState,
    initial_state,
    motor_angles,
    plant_constants,
    plant_tick,
    position,
    waiting_count,
)
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.parameters.timing import STEP_NS
from ballbot_ros.robot.brick.fault_effects import fault_row, plant_faults, voltage_drop
from ballbot_ros.robot.brick.faults import faults_of
from ballbot_ros.robot.plant.ground_truth import STEP_VALUES, GroundTruth, Push
from ballbot_ros.robot.plant.laws import WallHit, motor_current
from ballbot_ros.robot.world.world import World

_FLOAT32 = struct.Struct('<f')


class SavedPlant(NamedTuple):
    """The state of a plant, and the content of its buffers."""

    state: PlantState
    push_times: tuple[int, ...]
    push_forces: tuple[float, ...]
    effects_ns: tuple[int, ...]
    waiting_duties: tuple[int, ...]
    steps: tuple[float, ...]
    faults: tuple[float, ...]


class Plant:
    """Both planes of the ballbot, from the first tick at `start_ns` on.

    Parameters
    ----------
    world : World or None
        None for an unlimited floor.
    faults : list of float or None
        All faults of the run, if others of them act elsewhere; None for the plant's own.

    Attributes
    ----------
    kept_steps : list of float
        The ring of the newest steps.
    faults : list of float
        See :mod:`~ballbot_ros.robot.brick.fault_effects`.
    sides : array of int32
        Distances to walls, as in :class:`~ballbot_ros.robot.world.world.Footprint`; () for none.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        start_ns: int,
        world: World | None = None,
        faults: list[float] | None = None,
    ) -> None:
        c = self.constants = plant_constants(numbers_of(parameters), start_ns)
        self._torque_constant = parameters.torque_constant
        self._world = world
        walls: tuple[Any, Any] = world.walls_as_numbers if world else ((), ())
        self.sides, self._walls_before = walls
        self.faults = fault_row(faults_of(parameters), start_ns) if faults is None else faults
        self.state = initial_state(c, start_ns, 0, voltage_drop(self.faults, start_ns))
        self._push_times: list[int] = []
        self._push_forces: list[float] = []
        waiting = waiting_count(c.actuator_delay + c.actuator_jitter, c.has_late_duties)
        self._effects_ns = [NEVER_NS] * waiting
        self._waiting_duties = [0] * (2 * waiting)
        self.kept_steps: list[float] = []

    @property
    def time_ns(self) -> int:
        """Sim time [ns]."""
        return self.state.time_ns

    @property
    def fallen(self) -> bool:
        """Whether the body has fallen."""
        return self.state.is_fallen

    @property
    def stopped(self) -> bool:
        """Whether a wall hit has ended the run; the motors are then off."""
        return self.state.is_stopped

    @property
    def pushes(self) -> int:
        """Number of active and pending pushes."""
        return self.state.pushes

    def keep_steps(self, age: int) -> None:
        """Keep the physics steps up to this age for the truth; 0 for none.

        Steps from before the start, or before they were kept, are like the first one known.
        """
        size = (age + 1) * STEP_VALUES if age else 0
        if size == len(self.kept_steps):
            return
        known = self.steps or self._newest_step()
        missing = max(size - len(known), 0) // STEP_VALUES
        steps = [*known[:STEP_VALUES] * missing, *known]
        self.kept_steps = steps[len(steps) - size :]
        at = size - self._oldest_place
        self.kept_steps = self.kept_steps[at:] + self.kept_steps[:at]

    def push(self, push: Push) -> None:
        """Add a disturbance; a push that has already ended has no effect."""
        del self._push_times[2 * self.pushes :], self._push_forces[4 * self.pushes :]
        self._push_times += (push.start_ns, push.end_ns)
        self._push_forces += (*push.force, *push.torque)
        self.state = self.state._replace(pushes=self.pushes + 1)

    def tick(self, duty_x: int, duty_y: int, delay_ns: int = 0) -> None:
        """Advance by one tick of 4 ms under integer duties within -100 ... 100 %.

        They leave the brick `delay_ns` after the present time, if the plant has late duties.
        """
        duty_x, duty_y, *drops = plant_faults(
            self.faults, duty_x, duty_y, self.time_ns, self.constants.key
        )
        self.state = plant_tick(
            self.constants, self.state, duty_x, duty_y, delay_ns,
            self._push_times, self._push_forces,
            self._effects_ns, self._waiting_duties, self.kept_steps, self.sides, self._walls_before,
            *drops,
        )  # fmt: skip

    @property
    def wall_hit(self) -> bool:
        """Whether there was a wall hit in the 20 ms up to the last multiple of 20 ms."""
        return self.state.in_contact

    @property
    def newest_hit(self) -> WallHit | None:
        """The most recent wall hit; None before the first."""
        s = self.state
        if s.hit_ns < 0 or self._world is None:
            return None
        parts = self._world.touching((s.tried_x, s.tried_y))
        return WallHit(s.hit_ns, (s.hit_x, s.hit_y), parts)

    @property
    def steps(self) -> tuple[float, ...]:
        """The kept steps, as in `GroundTruth`."""
        kept, at = self.kept_steps, self._oldest_place
        return (*kept[at:], *kept[:at])

    @property
    def _oldest_place(self) -> int:
        """Where the oldest step is in the ring."""
        count = len(self.kept_steps) // STEP_VALUES
        return (self.time_ns // STEP_NS + 1) % count * STEP_VALUES if count else 0

    def truth(self) -> GroundTruth:
        """Return the current state of the robot."""
        volts: float = _FLOAT32.unpack(_FLOAT32.pack(self.state.measured_volts))[0]
        return self.truth_of(self.state, volts, self.steps)

    def truth_of(
        self, state: PlantState, volts: float, steps: tuple[float, ...] = ()
    ) -> GroundTruth:
        """Return what a state is of the robot; the numbers may be columns.

        The battery's voltage is that in single precision [V].
        """
        c, s = self.constants, state
        _, psi_x, theta_dot_x, psi_dot_x = s.x
        _, psi_y, theta_dot_y, psi_dot_y = s.y
        ratio, radius, kt = c.ratio, c.radius, self._torque_constant
        return GroundTruth(
            s.time_ns,
            motor_angles(c, s),
            (ratio * (theta_dot_x - psi_dot_x), ratio * (theta_dot_y - psi_dot_y)),
            (
                kt * motor_current(s.voltage_x, theta_dot_x, psi_dot_x, c.back_emf, c.ohms),
                kt * motor_current(s.voltage_y, theta_dot_y, psi_dot_y, c.back_emf, c.ohms),
            ),
            (psi_x, psi_y),
            (psi_dot_x, psi_dot_y),
            position(c, s),
            (radius * theta_dot_x, radius * theta_dot_y),
            volts,
            steps,
        )

    def _newest_step(self) -> tuple[float, ...]:
        c, s = self.constants, self.state
        return (*motor_angles(c, s), s.x[3], s.y[3], *position(c, s))

    def copy(self) -> Plant:
        """Return a plant in the same state, which goes on by itself."""
        twin = copy(self)
        twin.faults = []
        twin.restore_state(self.save_state())
        return twin

    def save_state(self) -> SavedPlant:
        """Return the present state."""
        return SavedPlant(
            self.state,
            tuple(self._push_times),
            tuple(self._push_forces),
            tuple(self._effects_ns),
            tuple(self._waiting_duties),
            tuple(self.kept_steps),
            tuple(self.faults),
        )

    def restore_state(self, saved: SavedPlant) -> None:
        """Continue from a state of a plant with the same parameters, start and world."""
        self.state = saved.state
        self._push_times, self._push_forces = list(saved.push_times), list(saved.push_forces)
        self._effects_ns = list(saved.effects_ns)
        self._waiting_duties = list(saved.waiting_duties)
        self.kept_steps = list(saved.steps)
        self.faults[:] = saved.faults
