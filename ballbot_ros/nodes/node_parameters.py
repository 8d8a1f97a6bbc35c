"""A node's ROS parameters: declared from the table, checked, and applied at the start of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Generic, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.parameters import (
    CONTROLLER,
    DRIVER_PERIODS_NS,
    NOT_DESIGNED,
    TABLE,
    NodeParameters,
    Parameter,
    ParameterError,
    TakesEffect,
    Value,
    is_own,
    parameters_of,
    suggest,
)
from ballbot_ros.parameters.timing import SECOND_NS, TICK_NS
from ballbot_ros.robot.brick.faults import faults_from

SIM_TIME = 'use_sim_time'
_ROS_PARAMETERS = {SIM_TIME, 'start_type_description_service'}
"""Parameters that every ROS node has."""

NEXT_RUN = 'takes effect in the next run (plant_sim/reset starts one)'
UNCHANGED = 'read-only; it already has this value'


P = TypeVar('P', bound=NodeParameters)
"""The parameters of a node's role."""


class ParameterNode(Node, Generic[P]):
    """A node with the parameters of one role.

    It raises ParameterError if a value is not allowed, or a given parameter exists in no node.

    Parameters
    ----------
    cls : type
        Class of the node's parameters, which determines its role; the role is also the node's name
        unless ROS remaps it.
    parameters : NodeParameters or None
        Initial values, for a node created by a program; None for the values from the command line
        and from parameter files.
    use_sim_time : bool
        Whether the node's clock is ``/clock`` by default.

    Attributes
    ----------
    parameters : NodeParameters
        The values in effect.
    start_ns, now_ns : int or None
        Start of its run, None before the first; stamp of its newest sample in it, or 0 [ns].
    """

    def __init__(
        self, cls: type[P], parameters: P | None = None, *, use_sim_time: bool = False
    ) -> None:
        given = parameters.values() if parameters else {}
        super().__init__(
            cls.node,
            parameter_overrides=[_ros_parameter(name, value) for name, value in given.items()],
            use_global_arguments=parameters is None,
        )
        self.role = cls.node
        self._rows = parameters_of(cls.node)
        self._sim_time_reason = ''
        self.start_ns: int | None = None
        self.now_ns = 0
        self._lasting: dict[str, Value] = {}
        requested = cls().with_values(self._declare_all(self._rows))
        further = {row.name: row for row in self.further_parameters(requested)}
        self._rows = {**self._rows, **further}
        self._requested = requested.with_values(self._declare_all(further))
        self.parameters = self._requested
        self._refuse_unknown()
        if use_sim_time and SIM_TIME not in self._parameter_overrides:
            super().set_parameters_atomically([RosParameter(SIM_TIME, value=True)])

    def require_sim_time(self, reason: str) -> None:
        """Require ``/clock`` as the node's clock from now on; ParameterError if it has another."""
        self._sim_time_reason = reason
        self._check_sim_time(self.get_parameter(SIM_TIME).value)

    def _check_sim_time(self, value: object) -> None:
        if self._sim_time_reason and value is False:
            raise ParameterError(f'{self.get_name()}.{SIM_TIME}: false: {self._sim_time_reason}')

    def further_parameters(self, parameters: P) -> Iterable[Parameter]:
        """Return the parameters that the node has for these values of those of its role."""
        return ()

    def _declare_all(self, rows: Mapping[str, Parameter]) -> dict[str, Value]:
        return {name: self._declare(row) for name, row in rows.items()}

    def _declare(self, row: Parameter) -> Value:
        descriptor = ParameterDescriptor(
            description=row.hint,
            read_only=row.takes_effect is TakesEffect.READ_ONLY,
        )
        if row.choices:
            descriptor.additional_constraints = f'one of {row.choices_text}'
        elif row.bounds and (row.or_zero or isinstance(row.default, tuple)):
            each = 'each within ' if isinstance(row.default, tuple) else ''
            descriptor.additional_constraints = each + row.bounds_text
        elif row.bounds and isinstance(row.default, int):
            descriptor.integer_range = [
                IntegerRange(from_value=int(row.bounds[0]), to_value=int(row.bounds[1]))
            ]
        elif row.bounds:
            low, high = row.bounds
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        value = row.default
        if given := self._parameter_overrides.pop(row.name, None):
            value = row.check(_read(row, given), f'{self.get_name()}.')
        elif row.is_designed:
            raise ParameterError(f'{self.get_name()}.{row.name}: {NOT_DESIGNED}')
        self.declare_parameter(row.name, _ros_parameter(row.name, value).value, descriptor)
        return value

    def _refuse_unknown(self) -> None:
        """Raise ParameterError for a parameter that no node has, such as a typo."""
        known = {row.name for row in TABLE} | _ROS_PARAMETERS
        for name in self._parameter_overrides:
            is_of_controller = is_own(name) and self.role != CONTROLLER
            if not (name in known or is_of_controller or name.startswith('qos_overrides.')):
                raise self._unknown(name)

    def _unknown(self, name: str) -> ParameterError:
        return ParameterError(
            f'{self.get_name()} has no parameter {name!r}; {suggest(name, self._rows)}'
        )

    def set_parameters(self, parameter_list: list[RosParameter]) -> list[SetParametersResult]:
        """Set parameters one by one, as :meth:`set_parameters_atomically` does."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Set parameters, all or none; the answer says when they take effect.

        Setting a read-only parameter to its current value is not an error, so that the output
        of ``ros2 param dump`` can be loaded.
        """
        changes = [each for each in parameter_list if not self._is_kept(each)]
        if not changes:
            return SetParametersResult(successful=True, reason=UNCHANGED)
        requested = self._requested
        try:
            for each in changes:
                if row := self._rows.get(each.name):
                    value = row.check(_read(row, each), f'{self.get_name()}.')
                    if self.is_of_run(row):
                        value = faults_from(self.earliest_change, str(value), self.parameters)
                    requested = requested.with_values({row.name: value})
                elif each.name == SIM_TIME:
                    self._check_sim_time(each.value)
                elif not self.has_parameter(each.name):
                    raise self._unknown(each.name)
            values = requested.values()
            rows = [self._rows[each.name] for each in changes if each.name in self._rows]
            at_once = {row.name: values[row.name] for row in rows if self.is_live(row)}
            live = self.parameters.with_values(at_once)
            if requested != self._requested:
                self.check(requested)
            if live not in (self.parameters, requested):
                self.check(live)
        except BallbotError as error:
            return SetParametersResult(successful=False, reason=one_line(error))
        given = [_ros_parameter(each.name, values.get(each.name, each.value)) for each in changes]
        result = super().set_parameters_atomically(given)
        if result.successful:
            self._requested = requested
            if live != self.parameters:
                self.parameters = live
                self.on_parameters_changed()
            now = self.parameters.values()
            waits = any(now[row.name] != values[row.name] for row in rows)
            result.reason = NEXT_RUN if waits else ''
        return result

    def _is_kept(self, parameter: RosParameter) -> bool:
        """Return whether this sets a read-only parameter to the value that it already has."""
        name = parameter.name
        if not self.has_parameter(name) or not self.describe_parameter(name).read_only:
            return False
        value, row = parameter.value, self._rows.get(name)
        with suppress(ParameterError):  # refused later, where the caller gets an answer
            if row:  # its declared type may be another, such as that of a whole number
                value = _ros_parameter(name, row.check(_read(row, parameter), '')).value
        return bool(value == self.get_parameter(name).value)

    def is_live(self, row: Parameter) -> bool:
        """Return whether a new value of a parameter takes effect immediately."""
        return row.is_live or self.is_of_run(row)

    def is_of_run(self, row: Parameter) -> bool:
        """Return whether a new value takes effect in the present run, and only in it."""
        return row.takes_effect is TakesEffect.THIS_RUN and self.start_ns is not None

    @property
    def earliest_change(self) -> float:
        """When faults given now can begin [s]: after the next sample, which they may hold."""
        period_ns, start_ns = DRIVER_PERIODS_NS.get(self.role, TICK_NS), self.start_ns or 0
        return (max(self.now_ns + period_ns - start_ns, 0) + period_ns) / SECOND_NS

    def apply_parameters(self) -> None:
        """Apply the new parameter values at the start of a run."""
        self._requested = self._requested.with_values(self._lasting)
        super().set_parameters_atomically([_ros_parameter(*each) for each in self._lasting.items()])
        self.parameters, values = self._requested, self._requested.values()
        of_run = filter(self.is_of_run, self._rows.values())
        self._lasting = {row.name: values[row.name] for row in of_run}

    def check(self, parameters: P) -> None:
        """Raise BallbotError if values are not compatible; called before they are applied."""

    def on_parameters_changed(self) -> None:
        """React to new values of parameters that take effect at once."""


def _ros_parameter(name: str, value: object) -> RosParameter:
    return RosParameter(name, value=list(value) if isinstance(value, tuple) else value)


def _read(row: Parameter, parameter: RosParameter) -> object:
    """Return the parameter's value in its declared type."""
    value = parameter.value
    if hasattr(value, 'tolist'):
        return value.tolist()
    if isinstance(row.default, float) and isinstance(value, str):
        # YAML reads 1e-05 as text, which `ros2 param load` passes on.
        try:
            return float(value)
        except ValueError:
            return value
    return value
