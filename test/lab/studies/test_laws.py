"""Studies of own controllers whose law is a function on numbers."""

from types import SimpleNamespace

import numpy as np
import pytest
from simulated_runs import EVERYTHING, assert_same, compiled_simulator, spec_of

from ballbot_ros.engine.compilation import functions_sha256
from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.programs import programs_of, why_not_compiled
from ballbot_ros.lab.studies.runs import (
    CompiledSimulator,
    OrdinarySimulator,
    Samples,
    simulator_for,
)

MODULE = """\
import math
from dataclasses import dataclass
from typing import NamedTuple

from ballbot_ros.controllers import Controller, LawController, duty_of_voltage, quantity

STRENGTH = 2.0


@dataclass(frozen=True)
class Gains:
    pitch: float = quantity(1.5, 'V/deg', (0.0, 20.0), 'gain')
    power: int = quantity(2, '1', (0, 9), 'of the time')


class State(NamedTuple):
    pitch: tuple = (0.0, 0.0)
    offset: tuple = (0.0, 0.0)
    ticks: int = 0
    is_upright: bool = True


def law(p, state, readings):
    if readings.elapsed_ms < 1000:
        n = state.ticks + 1
        gyro, offset = readings.gyro, state.offset
        offset = (offset[0] + (gyro[0] - offset[0]) / n, offset[1] + (gyro[1] - offset[1]) / n)
        return State(state.pitch, offset, n, True), (0, 0)
    x, rate_x = estimate(state.pitch[0], readings.gyro[0] - state.offset[0])
    y, rate_y = estimate(state.pitch[1], readings.gyro[1] - state.offset[1])
    gain = p.pitch + math.sqrt(0.01 * p.power)
    voltages = gain * x + 0.18 * rate_x, gain * y + 0.18 * rate_y
    after = State((x, y), state.offset, state.ticks, state.is_upright and abs(x) < 20.0)
    return after, tuple_of(voltages, readings.battery_mv)


def estimate(pitch, rate):
    return pitch + 0.004 * rate, STRENGTH / 2.0 * rate


def tuple_of(voltages, battery_mv):
    return duty_of_voltage(voltages[0], battery_mv), duty_of_voltage(voltages[1], battery_mv)


class Own(LawController[Gains]):
    law = law

    @classmethod
    def initial_state(cls, constants):
        return State()

"""

FAILING = """
def fails(p, state, readings):
    after, (x, y) = law(p, state, readings)
    late = readings.elapsed_ms - 1400
    {failure}
    return after, (x, y)


class Fails(Own):
    law = fails
"""

FAILURES = (
    'x += int(1.0 / late) * 0',
    'x += 1 // late * 0',
    'x = x if late < 0 else 300',
    'x = x if late < 0 else duty_of_voltage(math.inf - math.inf, 8000)',
    'x = x if late < 0 else {"a": x}["b"]',
    'after = after if late < 0 else State((math.nan, 0.0), after.offset, 0, True)',
)
"""What a law does for each value of its parameter ``power``, from a certain time on."""


@pytest.fixture
def module(tmp_path):
    def write(text=''):
        path = tmp_path / 'own.py'
        path.write_text(MODULE + text, encoding='utf-8')
        return path

    return write


def test_an_own_law_runs_and_fails_as_interpreted(module):
    chosen = '\n    '.join(f'if p.power == {at}: {each}' for at, each in enumerate(FAILURES))
    spec = spec_of('stationary', controller=f'{module(FAILING.format(failure=chosen))}:Fails')
    assert not why_not_compiled(spec)
    checked, simulator = [], compiled_simulator(spec, EVERYTHING[:1])
    ordinary = OrdinarySimulator(spec, EVERYTHING[:1])
    simulator._ordinary = SimpleNamespace(
        simulate=lambda part: checked.append(part.count) or ordinary.simulate(part),
        simulate_into=ordinary.simulate_into,
    )
    healthy = {
        'controller.user.pitch': np.array([1.4, 1.6, 0.0]),
        'controller.user.power': np.array([7, 8, 9]),
    }
    samples = Samples(3, healthy)
    compiled = simulator.simulate(samples)
    assert checked == [1]
    assert_same(compiled, ordinary.simulate(samples))
    assert len({each.tobytes() for each in compiled.duty_sha256}) == 3

    numbers = np.arange(len(FAILURES) + 1)
    samples = Samples(len(numbers), {'controller.user.power': numbers})
    expected = ordinary.simulate(samples)
    assert_same(simulator.simulate(samples), expected)
    assert expected.failed.tolist() == [True] * len(FAILURES) + [False]
    # The law refuses a pitch that is no number at the next tick.
    assert expected.ticks.tolist() == [350] * (len(FAILURES) - 1) + [351, 750]


def test_a_law_that_is_not_compiled_runs_all_the_same(module):
    line = 'x += eval("0") if late == 0 else 0'
    spec = spec_of('stationary', controller=f'{module(FAILING.format(failure=line))}:Fails')
    assert isinstance(simulator_for(spec, []), OrdinarySimulator)
    # A worker may find this out only by compiling it.
    simulator = CompiledSimulator(spec, EVERYTHING[:1], programs_of(spec))
    samples = Samples(2, {'plant_sim.seed': np.arange(2)})
    ordinary = OrdinarySimulator(spec, EVERYTHING[:1]).simulate(samples)
    assert_same(simulator.simulate(samples), ordinary)
    assert not ordinary.failed.any()


@pytest.mark.parametrize(
    ('line', 'reason'),
    [
        ('x += eval("0")', "own.py:56: Untyped global name 'eval'"),
        ('x = x if late < 0 else math.nan', 'own.py:53: it returns a state with other types'),
        ('x = float(x)', 'own.py:53: it returns a state with other types'),
        ('x += len(f"{late:9}")', 'own.py:56: format spec in f-strings not supported'),
    ],
)
def test_why_a_law_is_not_compiled(module, line, reason):
    path = module(FAILING.format(failure=line))
    problem = why_not_compiled(spec_of('stationary', controller=f'{path}:Fails'))
    assert '\n' not in problem
    assert reason in problem


def test_other_duties_than_those_of_the_interpreter_are_told(module):
    line = 'x += (2**62 + late) * 4 % 3 if late == 0 else 0'
    spec = spec_of('stationary', controller=f'{module(FAILING.format(failure=line))}:Fails')
    samples = Samples(2, {'plant_sim.seed': np.arange(2)}, first=40)
    with pytest.raises(StudyError, match=r'^run 40: the compiled law gives other duties than'):
        compiled_simulator(spec, EVERYTHING[:1]).simulate(samples)


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('law = print', 'Other.law is no function'),
        ('law = outer()', 'own.py:55: it reads variables of the function around it'),
        (
            'law = law\n    initial_state = classmethod(lambda cls, constants: State([1.0]))',
            'the initial state of Other: [1.0] is no number, switch or tuple',
        ),
        (
            'law = law\n    constants = classmethod(lambda cls, *values: None)',
            'the constants of Other: None is no named tuple',
        ),
    ],
)
def test_what_is_no_law_on_numbers(module, text, problem):
    outer = 'def outer():\n    own = 1\n    return lambda p, state, readings: (state, (own, 0))\n'
    path = module(f'\n{outer}\nclass Other(Own):\n    {text}\n')
    assert why_not_compiled(spec_of('stationary', controller=f'{path}:Other')).endswith(problem)


def test_a_class_with_tick_has_no_law(module):
    path = module(
        '\nclass Plain(Controller):\n    def tick(self, readings):\n        return 0, 0\n'
    )
    spec = spec_of('stationary', controller=f'{path}:Plain')
    assert why_not_compiled(spec) == 'Plain has no law, see docs/controllers.md'


def test_other_numbers_and_functions_of_the_module_need_other_code(module):
    def digest(text, module='own'):
        names = {'__name__': module}
        exec(compile(text, 'own.py', 'exec'), names)
        return functions_sha256(names['law'])

    first = digest(MODULE)
    assert digest(MODULE) == first
    # Kept code refers to the classes of a module by its name, which a file has from its content.
    assert digest(MODULE, 'other') != first
    single = MODULE.replace('STRENGTH = 2.0', 'import numpy as np\nSTRENGTH = np.float32(2.0)')
    for old, new in (('STRENGTH = 2.0', 'STRENGTH = 2.5'), ('0.004 * rate', '0.005 * rate')):
        assert digest(MODULE.replace(old, new)) != first
    assert digest(single) != digest(single.replace('(2.0)', '(2.5)'))


POLICY = """\
import math
from dataclasses import dataclass
from typing import NamedTuple

from ballbot_ros.controllers import quantity
from ballbot_ros.controllers.policy import PolicyController


@dataclass(frozen=True)
class Weights:
    pitch: tuple[float, ...] = quantity((0.02, 0.15), '1', (0.0, 9.0), 'of rate and pitch')
    last_s: float = quantity(9.0, 's', (0.0, 9.0), 'after that, it fails')


class State(NamedTuple):
    x: float = 0.0
    y: float = 0.0
    time_s: float = 0.0


def act(p, state, observation):
    rate_x, rate_y, encoder_x, encoder_y, _, distance_cm, command_x, command_y = observation
    x, y = state.x + 0.02 * rate_x, state.y + 0.02 * rate_y
    lean = command_x / 400.0 if distance_cm > 50.0 else 0.0
    action_x = share(p.pitch, rate_x, x - lean) + encoder_x / 900.0
    action_y = share(p.pitch, rate_y, y) + encoder_y / 900.0
    after = State(x, y, state.time_s + 0.02)
    return after, (action_x if after.time_s < p.last_s else math.nan, action_y)


def share(weights, *inputs):
    total = 0.0
    for number in range(len(weights)):
        total += weights[number] * inputs[number]
    return total


class Own(PolicyController[Weights]):
    policy = act
    step_ms = 20
    drives = True

    @classmethod
    def initial_state(cls, constants):
        return State()


class Object(PolicyController[Weights]):
    def make_policy(self):
        return lambda observation: (0.0, 0.0)


def outer():
    own = 0.0
    return lambda p, state, observation: (state, (own, own))


class Inner(Own):
    policy = outer()


class Uneven(Own):
    policy = lambda p, state, observation: (state, (0.0, 0.0, 0.0))
"""


def test_a_policy_runs_and_fails_as_interpreted(tmp_path):
    path = tmp_path / 'own.py'
    path.write_text(POLICY, encoding='utf-8')
    spec = spec_of('forward_backward', controller=f'{path}:Own')
    simulator, ordinary = (
        make(spec, EVERYTHING[:1]) for make in (compiled_simulator, OrdinarySimulator)
    )
    samples = Samples(3, {'controller.user.last_s': np.array([9.0, 1.5, 0.0])})
    compiled, expected = simulator.simulate(samples), ordinary.simulate(samples)
    assert_same(compiled, expected)
    assert expected.failed.tolist() == [False, True, True]
    assert len({each.tobytes() for each in compiled.duty_sha256}) == 3


@pytest.mark.parametrize(
    ('name', 'reason'),
    [
        ('Object', 'Object has no policy on numbers, see docs/learning.md'),
        ('Inner', 'own.py:55: it reads variables of the function around it'),
        ('Uneven', 'expected 2, got 3'),
    ],
)
def test_why_a_policy_is_not_compiled(tmp_path, name, reason):
    path = tmp_path / 'own.py'
    path.write_text(POLICY, encoding='utf-8')
    problem = why_not_compiled(spec_of('stationary', controller=f'{path}:{name}'))
    assert '\n' not in problem
    assert reason in problem
