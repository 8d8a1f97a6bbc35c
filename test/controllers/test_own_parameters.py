"""The parameters of a controller's class: declared, checked, designed once, and kept."""

import pytest

from ballbot_ros.controllers.codegen.implementation import compose_controller, implementation_for
from ballbot_ros.errors import BallbotError
from ballbot_ros.parameters import (
    CONTROLLER,
    PLANT,
    ControllerParameters,
    ParameterError,
    ParameterSet,
    PlantParameters,
)
from ballbot_ros.parameters.files import assign, format_parameters, read_parameter_file
from ballbot_ros.robot.plant.model import PhysicalParameters

DESIGNING = """\
from dataclasses import dataclass, replace
from typing import Literal

from ballbot_ros.controllers import Controller, designed, quantity, setting

calls = []


@dataclass(frozen=True)
class Weights:
    q: float = quantity(2, '1', (0.0, 10.0), 'weight')
    count: int = quantity(3, '1', (1, 5), 'number')
    label: str = setting('a', 'text')
    kind: Literal['slow', 'fast'] = setting('slow', 'choice')
    on: bool = setting(True, 'switch')
    pair: tuple[float, float] = quantity((1.0, 2.0), 'V', None, 'pair')
    gain: tuple[float, ...] = designed('V/deg', (-100.0, 100.0), 'gain')
    poles: tuple[float, ...] = designed('1/s', None, 'poles')


class Mine(Controller[Weights]):
    @classmethod
    def design(cls, parameters, model):
        calls.append(parameters)
        return replace(
            parameters, gain=[[parameters.q, model.body_mass]], poles=(-parameters.q,)
        )

    def tick(self, readings):
        return round(self.parameters.gain[0]), round(10 * self.parameters.gain[1])
"""


@pytest.fixture
def compose(tmp_path, monkeypatch):
    """Compose the parameters of a run of a class in a file with this text."""
    monkeypatch.chdir(tmp_path)

    def compose(*assignments, text=DESIGNING):
        (tmp_path / 'mine.py').write_text(text)
        parameters = ParameterSet()
        for each in assignments:
            assign(parameters, f'{CONTROLLER}.{each}')
        parameters.set(CONTROLLER, 'implementation', 'mine.py:Mine')
        loaded = compose_controller(parameters)
        return parameters, loaded

    return compose


def own(parameters, name):
    return parameters.of(ControllerParameters).values()[name]


def test_unset_values_have_their_defaults_and_types(compose):
    parameters, _ = compose()
    values = parameters.of(ControllerParameters).values()
    assert (values['user.q'], type(values['user.q'])) == (2.0, float)
    assert (values['user.count'], values['user.kind'], values['user.on']) == (3, 'slow', True)
    assert values['user.pair'] == (1.0, 2.0)


def test_gains_are_designed_once_for_the_set_values(compose):
    parameters, loaded = compose('user.q=4', 'model.body_mass=0.5')
    assert own(parameters, 'user.gain') == (4.0, 0.5)
    assert own(parameters, 'user.poles') == (-4.0,)
    calls = loaded.cls.design.__globals__['calls']
    assert len(calls) == 1
    compose_controller(parameters)
    for _ in range(2):
        implementation_for(parameters.of(ControllerParameters)).make()
    assert len(calls) == 1


def test_set_gains_are_not_designed(compose):
    parameters, loaded = compose('user.gain=[1, 2, 3]', 'user.poles=[-1]')
    assert own(parameters, 'user.gain') == (1.0, 2.0, 3.0)
    assert loaded.cls.design.__globals__['calls'] == []
    parameters, _ = compose('user.gain=[1, 2, 3]')
    assert own(parameters, 'user.gain') == (1.0, 2.0, 3.0)
    assert own(parameters, 'user.poles') == (-2.0,)


def test_the_model_has_the_values_of_the_document_whatever_the_plant_has(compose):
    parameters, _ = compose()
    nominal = PhysicalParameters.from_parameters(PlantParameters())
    parameters.set(PLANT, 'body_mass', 0.9)
    assert own(parameters, 'model.body_mass') == nominal.body_mass
    assert own(parameters, 'user.gain')[1] == nominal.body_mass


@pytest.mark.parametrize(
    ('assignment', 'told'),
    [
        ('user.q=11', 'controller.user.q: 11 is not within 0 … 10'),
        ('user.q=x', "controller.user.q: 'x' is not a number"),
        ('user.q=.nan', 'controller.user.q: nan is not within 0 … 10'),
        ('user.count=2.5', 'controller.user.count: 2.5 is not a whole number'),
        ('user.kind=medium', "controller.user.kind: 'medium' is not one of slow, fast"),
        ('user.on=1', 'controller.user.on: 1 is not true or false'),
        ('user.pair=[1]', 'controller.user.pair: [1] is not a list of 2 numbers'),
        ('user.gain=[]', 'controller.user.gain: [] is not a list of 1 … 10000 numbers'),
        ('user.gain=[200]', 'controller.user.gain: 200 is not within -100 … 100 V/deg'),
        ('user.r=1', "the controller Mine has no parameter 'user.r'; it has user.count, user.gain"),
        ('user.cuont=1', 'did you mean user.count?'),
        ('model.body_mass=0', 'controller.model.body_mass: 0 is not within 1e-06 … 100 kg'),
        ('model.body_width=1', "the controller Mine has no parameter 'model.body_width'"),
    ],
)
def test_a_value_that_is_not_allowed_is_refused_where_it_was_set(compose, assignment, told):
    with pytest.raises(ParameterError) as raised:
        compose(assignment)
    assert str(raised.value).startswith(f'--set controller.{assignment}: ')
    assert told in str(raised.value)


@pytest.mark.parametrize(
    ('change', 'told'),
    [
        (('frozen=True', ''), 'mine.py: Weights is not a dataclass with frozen=True'),
        (('@dataclass(frozen=True)', ''), 'mine.py: Weights is not a dataclass with frozen=True'),
        (("quantity(2, '1', (0.0, 10.0), 'weight')", '2.0'), 'mine.py: Weights.q is not declared'),
        (('quantity(2,', 'quantity(12,'), 'mine.py: default of user.q: 12.0 is not within 0 … 10'),
        (('q: float', 'q: Unknown'), "mine.py: Weights: name 'Unknown' is not defined"),
        (('model.body_mass', 'model.mass'), "AttributeError: 'PhysicalParameters' object has no"),
        (
            ('[[parameters.q, model.body_mass]]', '"12"'),
            "gain: '12' are not real, finite numb",
        ),
        (('[[parameters.q, model.body_mass]]', '500'), 'mine.py: Mine.design: controller.user.gai'),
        (('[[parameters.q, model.body_mass]]', '()'), 'user.gain: () is not a list of'),
        (('[[parameters.q, model.body_mass]]', 'float("nan")'), 'gain: nan are not real, finite'),
        (('[[parameters.q, model.body_mass]]', '[1j]'), 'gain: [1j] are not real, finite numbers'),
        (
            ('[[parameters.q, model.body_mass]]', '[1.0] * 20000'),
            'is not a list of 1 … 10000 numbers',
        ),
        (('(0.0, 10.0)', "('a', 'b')"), 'mine.py: Weights: '),
        (('(0.0, 10.0)', '(0.0,)'), 'mine.py: Weights: '),
        (('(1, 5)', '(1, 2**70)'), 'Weights.user.count: a whole number has at m'),
        (('(1, 5)', '(1, float("inf"))'), 'Weights.user.count: a whole number has at m'),
        (("'text')", "'text'); plain: int = 3"), 'mine.py: Weights.plain is not declared'),
        (
            ('Controller[Weights]', 'Controller[3]'),
            'mine.py:22: TypeError: Controller[3]: it i',
        ),
        (
            ('    def tick', "    portable = 'no'\n\n    def tick"),
            "Mine.portable: 'no' is not True or",
        ),
        (('return replace(', 'return ('), 'mine.py:'),
    ],
)
def test_a_class_with_faulty_parameters_or_design_is_refused(compose, change, told):
    with pytest.raises(BallbotError) as raised:
        compose(text='from __future__ import annotations\n' + DESIGNING.replace(*change))
    assert told in str(raised.value)
    assert '\n' not in str(raised.value)


def test_a_file_of_parameters_keeps_all_values(compose, tmp_path):
    parameters, _ = compose('user.q=4', 'user.label=b', 'model.gravity=9.0')
    file = tmp_path / 'all.yaml'
    file.write_text(format_parameters(parameters))
    again = read_parameter_file(file)
    assert compose_controller(again)
    assert again.of(ControllerParameters) == parameters.of(ControllerParameters)


def test_names_with_dots_may_be_nested_in_a_file(compose, tmp_path):
    file = tmp_path / 'nested.yaml'
    file.write_text(
        '/**:\n  ros__parameters:\n    user: {q: 4}\n'
        'controller:\n  ros__parameters:\n    model:\n      gravity: 9.0\n'
        '    implementation: mine.py:Mine\n'
    )
    compose()
    parameters = read_parameter_file(file)
    compose_controller(parameters)
    assert own(parameters, 'user.q') == 4.0
    assert own(parameters, 'model.gravity') == 9.0
    file.write_text('controller:\n  ros__parameters:\n    user:\n      q: 40\n')
    parameters = read_parameter_file(file)
    parameters.set(CONTROLLER, 'implementation', 'mine.py:Mine')
    with pytest.raises(ParameterError, match=r'nested\.yaml:4: controller\.user\.q: 40 is not'):
        compose_controller(parameters)
    file.write_text('controller:\n  ros__parameters:\n    user:\n')
    with pytest.raises(ParameterError, match='no parameter'):
        read_parameter_file(file)


@pytest.mark.parametrize('name', ['user.q', 'model.gravity'])
def test_the_documents_program_has_none_of_these(name):
    parameters = ParameterSet()
    assign(parameters, f'controller.{name}=1')
    with pytest.raises(ParameterError, match=f'the controller python has no parameter {name!r}'):
        compose_controller(parameters)


def test_a_later_set_replaces_an_earlier_one(compose):
    parameters, _ = compose('user.q=4')
    other = ParameterSet()
    assign(other, 'controller.user.count=5')
    parameters.update(other)
    assert (own(parameters, 'user.q'), own(parameters, 'user.count')) == (4.0, 5)
    fresh = ParameterSet()
    fresh.update(parameters)
    assert own(fresh, 'user.gain') == own(parameters, 'user.gain')
    assign(other, 'controller.user.count=9')
    with pytest.raises(ParameterError, match='9 is not within'):
        fresh.update(other)


def test_a_program_without_a_design_is_refused(compose):
    parameters, _ = compose()
    values = parameters.of(ControllerParameters).with_values({'user.poles': ()})
    with pytest.raises(
        ParameterError, match=r'controller\.user\.poles: not designed: the commands run and drive'
    ):
        implementation_for(values)
