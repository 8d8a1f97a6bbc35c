"""The parameters of a controller's class, and the design of its gains."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass, replace
from functools import lru_cache
from typing import Any

from ballbot_ros.controllers.controller import Controller, with_design
from ballbot_ros.controllers.loading import LoadedController
from ballbot_ros.errors import ControllerError, one_line, short_repr
from ballbot_ros.parameters import (
    CONTROLLER,
    MAX_DESIGNED,
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
from ballbot_ros.parameters.controller import MODEL, USER
from ballbot_ros.robot.plant.model import PhysicalParameters


@lru_cache(maxsize=8)
def own_rows(loaded: LoadedController) -> tuple[Parameter, ...]:
    """Return the parameters of a controller: those of its class, and the physical values.

    Raises
    ------
    ControllerError
        If its class does not declare its parameters as it should.
    """
    try:
        _check_settings(loaded)
        return (*_user_rows(loaded), *_model_rows())
    except ControllerError as error:
        raise ControllerError(f'{loaded.code.shown}: {error}') from None
    except Exception as error:  # of annotations and defaults, which are the user's
        cls = loaded.cls.parameters_class
        name = getattr(cls, '__name__', short_repr(cls))
        raise ControllerError(f'{loaded.code.shown}: {name}: {one_line(error)}') from None


def _check_settings(loaded: LoadedController) -> None:
    """Check the names of the settings that the class takes over during a run."""
    rows = parameters_of(CONTROLLER).values()
    allowed = [row.name for row in rows if row.is_live]
    for name in loaded.cls.tunable_settings:
        if name not in allowed:
            raise ControllerError(
                f'tunable_settings: {short_repr(name)} is not one of {", ".join(allowed)}'
            )


def _user_rows(loaded: LoadedController) -> Iterator[Parameter]:
    cls = loaded.cls.parameters_class
    name = getattr(cls, '__name__', short_repr(cls))
    if not (isinstance(cls, type) and is_dataclass(cls)) or not _is_frozen(cls):
        raise ControllerError(f'{name} is not a dataclass with frozen=True')
    for each in fields(cls):
        if not each.metadata or each.default is MISSING:
            raise ControllerError(
                f'{name}.{each.name} is not declared by quantity, setting or designed'
            )
    for row in declared_in(cls, CONTROLLER, USER):
        if row.is_designed:
            yield row
            continue
        is_whole = isinstance(row.default, int) and not isinstance(row.default, bool)
        if is_whole and not all(abs(each) < 2**63 for each in (row.default, *(row.bounds or ()))):
            raise ControllerError(f'{name}.{row.name}: a whole number has at most 63 bits')
        if isinstance(row.default, tuple) and len(row.default) > MAX_DESIGNED:
            raise ControllerError(f'{name}.{row.name}: more than {MAX_DESIGNED} numbers')
        try:
            yield replace(row, default=row.check(row.default, 'default of '))
        except ParameterError as error:
            raise ControllerError(str(error)) from None


def _is_frozen(cls: type) -> bool:
    return bool(cls.__dataclass_params__.frozen)  # type: ignore[attr-defined]


def _model_rows() -> Iterator[Parameter]:
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
    except KeyboardInterrupt:
        raise
    except BaseException as error:
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


def missing_design(parameters: ControllerParameters, rows: Iterable[Parameter]) -> list[str]:
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
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise ControllerError(f'{loaded.code.describe(error)} ({where})') from None
    for name in missing:
        value = getattr(designed, name.removeprefix(USER))
        parameters.set(CONTROLLER, name, value, f'{loaded.code.shown}: {where}')
