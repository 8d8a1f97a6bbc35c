"""A controller as a control program, and how its mistakes are told."""

import time

import numpy as np
import parts
import pytest
from own_controllers import BALANCE, FAULTY, line_in_faulty
from parts import AT_REST, values_of

from ballbot_ros.controllers import Controller
from ballbot_ros.controllers.codegen.implementation import compose_controller, implementation_for
from ballbot_ros.controllers.controller_program import TickTimes
from ballbot_ros.errors import ControllerError
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet
from ballbot_ros.robot.brick.brick import Tone

START_MS = 2**32 - 100  # the system time wraps


@pytest.fixture
def make(tmp_path, monkeypatch):
    """Return a program of a class in a file with this text."""
    monkeypatch.chdir(tmp_path)

    def make(text, class_name='Mine'):
        (tmp_path / 'mine.py').write_text(text)
        parameters = ParameterSet()
        parameters.set(CONTROLLER, 'implementation', f'mine.py:{class_name}')
        compose_controller(parameters)
        return implementation_for(parameters.of(ControllerParameters)).make()

    return make


def run(program, ticks, inputs=AT_REST):
    return [parts.tick(program, 4 * tick, START_MS + 4 * tick, inputs) for tick in range(ticks)]


def mine(body, imports='Controller, task'):
    return f'from ballbot_ros.controllers import {imports}\nclass Mine(Controller):\n{body}\n'


def test_each_tick_has_the_newest_readings(make):
    program = make(
        mine(
            ' def start(self): self.all = []\n'
            ' def tick(self, r):\n  self.all.append(r)\n  return 0, 0'
        )
    )
    parts.tick(program, 0, START_MS, AT_REST._replace(sticks=None))
    quiet = AT_REST._replace(gyro=(1, 2), sonar_cm=None, battery_mv=None, sticks=None)
    parts.tick(program, 4, START_MS + 4, quiet._replace(sticks=(5, 6)))
    parts.tick(program, 8, START_MS + 8, quiet._replace(sonar_cm=40))
    parts.tick(program, 104, START_MS + 104, quiet._replace(sonar_cm=-1))
    readings = program.controller.all
    assert [each.elapsed_ms for each in readings] == [0, 4, 8, 104]
    assert [each.gyro for each in readings] == [(600, 600), (1, 2), (1, 2), (1, 2)]
    assert [each.battery_mv for each in readings] == [8003] * 4
    assert [each.sticks for each in readings] == [(0, 0), (5, 6), (5, 6), (5, 6)]
    assert [each.distance_cm for each in readings] == [255, 255, 40, 255]
    assert readings[0].max_voltage == pytest.approx(0.001089 * 8003 - 0.625)


def test_outputs_and_estimates_reach_the_brick(make):
    program = make(
        mine(
            ' def tick(self, r):\n  self.sound(440, 100, 70)\n  self.log(1, -2, 3, adc4=-4)\n'
            "  self.show('MINE')\n  self.x.psi = 1.5\n"
            '  self.operating_state = OperatingState.FORWARD\n  return -100, 100',
            'Controller, OperatingState',
        )
    )
    (outputs,) = run(program, 1)
    assert outputs.duty == (-100, 100)
    assert outputs.tones == [Tone(440, 100, 70)]
    (packet,) = outputs.log
    assert (packet.data1, packet.data2, packet.adc1, packet.adc4) == (1, -2, 3, -4)
    assert outputs.pages[0].startswith('MINE ')
    assert program.x.psi == 1.5
    assert np.isnan(program.y.psi)
    assert program.operating_state == 'forward'


@pytest.mark.parametrize(
    ('call', 'told'),
    [
        ('self.sound(30, 100, 70)', 'frequency_hz: 30 is not a whole number in 31 … 14080'),
        ('self.sound(440, 1.5, 70)', 'duration_ms: 1.5 is not a whole number in 0 … 65535'),
        ('self.sound(440, 1, 101)', 'volume: 101 is not a whole number in 0 … 100'),
        ('self.log(128)', 'data1: 128 is not a whole number in -128 … 127'),
        ('self.log(0, -129)', 'data2: -129 is not a whole number in -128 … 127'),
        ('self.log(adc3=40000)', 'adc3: 40000 is not a whole number in -32768 … 32767'),
        ('self.x.theta = None', 'mine.py: Mine.x.theta: None is not a number'),
        ("self.x.theta = '3'", "mine.py: Mine.x.theta: '3' is not a number"),
        ('self.x.theta = 1j', 'mine.py: Mine.x.theta: 1j is not a number'),
        ('self.x.theta = 10**400', 'Mine.x.theta: 1000'),
        ("self.show('\\udc80')", "name: '\\udc80' is not a printable text"),
        ('self.show(3)', 'name: 3 is not a printable text'),
        ('self.y = 3', 'Mine.y: 3 is not an Estimates'),
        ("self.operating_state = 'lost'", "Mine.operating_state: 'lost' is not an OperatingState"),
    ],
)  # fmt: skip
def test_outputs_that_do_not_fit_are_refused(make, call, told):
    program = make(mine(f' def tick(self, r):\n  {call}\n  return 0, 0'))
    with pytest.raises(ControllerError) as raised:
        run(program, 1)
    assert told in str(raised.value)
    assert '(Mine.tick at 0.000 s; gyro ' in str(raised.value)
    assert ('mine.py:4' in str(raised.value)) == ('Mine.' not in told)


@pytest.mark.parametrize('answer', ['(1, -2)', '[1, -2]', 'np.array([1, -2])', 'np.int8([1, -2])'])
def test_whole_numbers_of_any_kind_are_duties(make, answer):
    program = make(f'import numpy as np\n{mine(f" def tick(self, r): return {answer}")}')
    (outputs,) = run(program, 1)
    assert outputs.duty == (1, -2)
    assert all(type(duty) is int for duty in outputs.duty)


@pytest.mark.parametrize(
    ('class_name', 'told'),
    [
        ('ReturnsNaN', 'returned (nan, 0): nan is not a whole number in -100 … 100'),
        ('ReturnsFloats', 'returned (1.0, 2.0): 1.0 is not a whole number in -100 … 100'),
        ('ReturnsTooMuch', 'returned (300, 0): 300 is not a whole number in -100 … 100'),
        ('ReturnsOne', 'returned 3: not the duties of two motors'),
        ('ReturnsNone', 'returned None: not the duties of two motors'),
        ('ReturnsBool', 'returned (True, False): True is not a whole number in -100 … 100'),
        ('Raises', 'ZeroDivisionError: integer division or modulo by zero'),
        ('RaisesInALibrary', "ValueError: invalid literal for int() with base 10: 'two\\nlines'"),
        ('Exits', 'SystemExit: 3'),
        ('WritesToItsInputs', "AttributeError: can't set attribute"),
        ('WritesIntoItsInputs', "TypeError: 'tuple' object does not support item assignment"),
        ('Estimates', 'Estimates.x: 3 is not an Estimates'),
        (
            'DeletesItsEstimates',
            "AttributeError: 'DeletesItsEstimates' object has no attribute 'x'",
        ),
        ('RaisesAnything', 'Strange'),
        ('Interrupts', 'KeyboardInterrupt'),
        ('ReturnsLines', 'returned A B C: not the duties of two motors'),
        ('ReturnsAHugeNumber', 'returned <tuple>: '),
        ('ReturnsAHugeText', "returned 'xxxxxxx"),
    ],
)
def test_a_mistake_is_told_in_one_line_with_its_place(make, class_name, told):
    program = make(FAULTY, class_name)
    outputs = run(program, 100)
    assert {each.duty for each in outputs} == {(0, 0)}
    with pytest.raises(ControllerError) as raised:
        parts.tick(program, 400, START_MS + 400, AT_REST)
    words = str(raised.value)
    assert told in words
    assert '\n' not in words
    assert len(words) < 400
    assert words.isprintable()
    if told.startswith('returned'):
        assert words.startswith(f'mine.py:{line_in_faulty("def tick")}: ')
    elif 'Estimates' not in told:
        line = line_in_faulty(f'class {class_name}(') + 2
        assert words.startswith(f'mine.py:{line}: ')
    if class_name:
        assert words.endswith(
            f'({class_name}.tick at 0.400 s; gyro (600, 600), revolutions (0, 0), '
            'battery 8003 mV, distance 255 cm, sticks (0, 0); last duty 0, 0)'
        )


def test_a_mistake_in_the_start_is_told(make):
    with pytest.raises(ControllerError, match=r'mine.py:3: ZeroDivision.* \(Mine at the start\)'):
        make(mine(' def start(self): 1 / 0\n def tick(self, r): return 0, 0'))


def test_tasks_run_by_priority_when_they_are_due(make):
    program = make(
        mine(
            ' def start(self): self.ran = []\n'
            ' @task(20, 1)\n def low(self, r): self.ran.append((r.elapsed_ms, "low"))\n'
            ' @task(4, 2)\n def middle(self, r):\n  self.ran.append((r.elapsed_ms, "middle"))\n'
            '  return (1, 1) if r.elapsed_ms == 4 else None\n'
            ' @task(8, 3)\n def high(self, r): self.ran.append((r.elapsed_ms, "high"))'
        )
    )
    outputs = run(program, 6)
    assert program.controller.ran == [
        (0, 'high'), (0, 'middle'), (0, 'low'), (4, 'middle'), (8, 'high'), (8, 'middle'),
        (12, 'middle'), (16, 'high'), (16, 'middle'), (20, 'middle'), (20, 'low'),
    ]  # fmt: skip
    assert [each.duty for each in outputs] == [(0, 0)] + [(1, 1)] * 5  # the duty holds


def test_without_a_task_at_every_tick_the_duty_holds(make):
    program = make(mine(' @task(8, 1)\n def slow(self, r): return r.elapsed_ms, 0'))
    assert [each.duty[0] for each in run(program, 5)] == [0, 0, 8, 8, 16]


def test_the_controller_on_the_page_is_symmetric_and_still_at_rest(make):
    program = make(BALANCE, 'Balance')
    assert {each.duty for each in run(program, 500)} == {(0, 0)}
    leans = AT_REST._replace(gyro=(610, 600))
    (one,) = {parts.tick(program, 2000, START_MS + 2000, leans).duty}
    other = make(BALANCE, 'Balance')
    run(other, 500)
    swapped = parts.tick(other, 2000, START_MS + 2000, leans._replace(gyro=(600, 610))).duty
    assert one == swapped[::-1]
    assert one[0] > 0


@pytest.mark.usefixtures('slow_ticks_are_told')
def test_slow_ticks_are_measured_and_told():
    times = TickTimes()
    assert times.problem == ''
    for tick in range(100):
        times.add(4 * tick, 3_900_000)
    assert times.problem == ''
    times.add(400, 50_000_000)  # one in a hundred, as on a busy machine
    assert times.problem == ''
    times.add(404, 4_100_000)
    assert times.problem == (
        '2 of 102 ticks took longer than 4 ms of wall time, the longest 50.0 ms at 0.400 s: the '
        'controller is slow here, or this machine was busy'
    )
    times.reset()
    assert (times.ticks, times.problem) == (0, '')
    times.add(8, 101_000_000)
    assert times.problem.startswith('1 of 1 ticks took longer')


def test_the_time_of_each_tick_is_measured(make, monkeypatch):
    program = make(mine(' def tick(self, r): return 0, 0'))
    clock = iter(range(0, 10**9, 5_000_000))
    monkeypatch.setattr(time, 'perf_counter_ns', lambda: next(clock))
    run(program, 3)
    assert (program.times.ticks, program.times.slow) == (3, 3)
    assert program.times.longest_ms == 5.0


def test_the_settings_of_the_node_reach_every_controller():
    settings = values_of(CONTROLLER, mode='autonomous')
    assert Controller(settings=settings).settings.mode == 'autonomous'
    assert Controller().settings.mode == 'remote'


@pytest.mark.parametrize(
    'body',
    [
        ' @functools.lru_cache\n def tick(self, r): return 1, 2',
        ' @staticmethod\n def tick(r): return 1, 2',
        ' def tick(self, r, extra): return 1, 2\n tick = functools.partialmethod(tick, extra=0)',
        ' def start(self): self.tick = lambda r: (1, 2)\n def tick(self, r): return 0, 0',
        ' class Call:\n  def __call__(self, r): return 1, 2\n tick = Call()',
    ],
    ids=['cached', 'static', 'partial', 'instance', 'callable'],
)
def test_tick_may_be_anything_that_can_be_called(make, body):
    program = make('import functools\n' + mine(body))
    assert [each.duty for each in run(program, 2)] == [(1, 2)] * 2


def test_an_init_that_forgets_its_base_is_told(make):
    with pytest.raises(ControllerError, match=r'^mine.py: AttributeError: .* \(Mine at t'):
        make(mine(' def __init__(self, *a): pass\n def tick(self, r): return 0, 0'))


def test_published_estimates_are_plain_floats(make):
    program = make(
        'import numpy as np\n'
        + mine(
            ' def tick(self, r):\n'
            '  class Own(float): pass\n'
            '  self.x.psi, self.x.theta, self.y.psi = Own(1.5), np.float32(2.5), -0.0\n'
            '  return 0, 0'
        )
    )
    run(program, 1)
    assert [type(each) for each in (program.x.psi, program.x.theta)] == [float, float]
    assert (program.x.psi, program.x.theta) == (1.5, 2.5)
    assert np.signbit(program.y.psi)
