"""The parameters of a controller's class, and the design of its gains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from ballbot_ros.controllers.controller import Controller, with_design
from ballbot_ros.controllers.errors import ControllerError
from ballbot_ros.controllers.loading import LoadedController
from ballbot_ros.parameters import (
    CONTROLLER,
    PLANT,
    ControllerParameters,
    Parameter,
    ParameterError,
    ParameterSet,
    TakesEffect,
    Value,
    declared_in,
    parameters_of,
)
from ballbot_ros.plant.model import PhysicalParameters

USER, MODEL = 'user.', 'model.'


def own_rows(loaded: LoadedController) -> Iterator[Parameter]:
    """Yield the parameters of a controller: those of its class, and the physical values.

    Raises
    ------
    ControllerError
        If its class does not declare its parameters as it should.
    """
    cls = loaded.cls.parameters_class
    name = f'{loaded.code.shown}: {cls.__name__}'
    if not is_dataclass(cls) or not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        raise ControllerError(f'{name} is not a dataclass with frozen=True')
    for each in fields(cls):
        if not each.metadata:
            raise ControllerError(
                f'{name}.{each.name} is not declared by quantity, setting or designed'
            )
    try:
        rows = list(declared_in(cls, CONTROLLER, USER))
    except (NameError, TypeError, ValueError) as error:
        raise ControllerError(f'{name}: {error}') from None
    for row in rows:
        if not row.is_designed:
            try:
                row.check(row.default, f'{loaded.code.shown}: default of ')
            except ParameterError as error:
                raise ControllerError(str(error)) from None
    yield from rows
    known = parameters_of(PLANT)
    for each in fields(PhysicalParameters):
        row = known[each.name]
        yield replace(
            row,
            nodes=(CONTROLLER,),
            name=MODEL + row.name,
            description=f'{row.description}, to design for',
            takes_effect=TakesEffect.NEXT_RUN,
        )


def user_parameters(loaded: LoadedController, parameters: ControllerParameters) -> Any:
    """Return an instance of the class of the controller's parameters."""
    values = _with_prefix(parameters.values(), USER)
    try:
        return loaded.cls.parameters_class(**values)
    except (Exception, SystemExit) as error:
        raise ControllerError(loaded.code.describe(error)) from None


def design_model(parameters: ControllerParameters) -> PhysicalParameters:
    """Return the physical values to design for."""
    return PhysicalParameters(**_with_prefix(parameters.values(), MODEL))  # type: ignore[arg-type]


def _with_prefix(values: Mapping[str, Value], prefix: str) -> dict[str, Value]:
    return {
        name.removeprefix(prefix): value
        for name, value in values.items()
        if name.startswith(prefix)
    }


def missing_design(parameters: ControllerParameters, rows: Iterator[Parameter]) -> list[str]:
    """Return the names of the parameters that have to be designed first."""
    values = parameters.values()
    return [row.name for row in rows if row.is_designed and not values[row.name]]


def design(loaded: LoadedController, parameters: ParameterSet) -> None:
    """Design the values that are not set, and set them.

    Raises
    ------
    ControllerError, ParameterError
        If the design fails, or gives values that are not allowed.
    """
    given = parameters.of(ControllerParameters)
    missing = missing_design(given, own_rows(loaded))
    if not missing:
        return
    user = user_parameters(loaded, given)
    where = f'{loaded.cls.__name__}.{Controller.design.__name__}'
    try:
        designed = with_design(loaded.cls, user, design_model(given))
    except (Exception, SystemExit) as error:
        raise ControllerError(f'{loaded.code.describe(error)} ({where})') from None
    for name in missing:
        value = getattr(designed, name.removeprefix(USER))
        parameters.set(CONTROLLER, name, value, f'{loaded.code.shown}: {where}')
