"""Gains that change while the graph runs: recorded at their tick, and replayed identically."""

import contextlib
import signal
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from ros_client import Client
from std_srvs.srv import SetBool, Trigger
from stubs import bare

from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.controllers.codegen.implementation import Implementation
from ballbot_ros.engine.brick_tasks import BrickTasks
from ballbot_ros.errors import ControllerError
from ballbot_ros.lockstep.lockstep import DueTick
from ballbot_ros.lockstep.run_actions import ParameterChange
from ballbot_ros.nodes.controller import ControllerNode
from ballbot_ros.nodes.node_parameters import NEXT_RUN
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, parameters_of
from ballbot_ros.parameters.changes import PendingChanges
from ballbot_ros.parameters.timing import FIRST_TICK_NS, TICK_NS
from ballbot_ros.recording.messages.conversions import stamp_ns
from ballbot_ros.recording.messages.topics import (
    MOTOR_DUTY,
    OPERATING_STATE,
    PARAMETER_EVENTS,
    PLANT_IMU,
)

BALANCING_NS = FIRST_TICK_NS + 1_200_000_000

OWN = """

from dataclasses import dataclass
from ballbot_ros.controllers import Controller, TakesEffect, quantity

@dataclass(frozen=True)
class Gains:
    gain: float = quantity(1.0, '1', (0.0, 9.0), 'a gain', takes_effect=TakesEffect.IMMEDIATELY)

class Own(Controller[Gains]):
    tunable_settings = ('psi_diff_thr',)

    def tick(self, readings):
        if self.parameters.gain == 9.0:
            raise RuntimeError('nine')
        duty = round(self.parameters.gain * readings.gyro[0] / 100) % 50
        return duty, -duty
"""


@pytest.mark.graph
@pytest.mark.parametrize(
    ('controller', 'processes', 'name', 'value'),
    [
        ('python', 'separate', 'k_f', (-0.02, -1.5, -0.03, -0.22)),
        ('own.py:Own', 'one', 'user.gain', 2.0),
    ],
)
def test_gains_changed_on_the_way_replay_identically(
    start_run, domain, command, tmp_path, monkeypatch, controller, processes, name, value
):
    monkeypatch.chdir(tmp_path)
    Path('own.py').write_text(OWN)
    run = start_run(
        'stationary', '--controller', controller, '--processes', processes, '--json', '--output',
        'run', '--set=plant_sim.duration=600', '--set=plant_sim.start_pitch_x=0.02',
        '--real-time-factor', 1,
    )  # fmt: skip
    with contextlib.closing(Client(domain)) as client:
        client.watch(PARAMETER_EVENTS, depth=10)
        client.watch(PLANT_IMU)
        client.watch(MOTOR_DUTY)
        client.spin_until(lambda: {PLANT_IMU.name, MOTOR_DUTY.name} <= set(client.newest))
        client.spin_until(lambda: client.now_ns() > BALANCING_NS)
        pause = SetBool.Request(data=True)
        assert client.call(SetBool, 'plant_sim/pause', pause).success
        # The controller may still owe the duty of the newest tick, for which it would take over the
        # first change without the second.
        client.await_standstill(2)
        client.spin_until(lambda: stamp_ns(client.newest[MOTOR_DUTY.name]) == client.now_ns())
        changed_ns = client.now_ns()
        changes = {name: value, 'psi_diff_thr': 14.0}
        for each, new in changes.items():
            answer = client.set_value('controller', each, new)
            assert answer.successful, answer.reason
            assert answer.reason == ''
        assert client.set_value('controller', 'a_d', 0.75).reason == NEXT_RUN
        assert client.call(Trigger, 'plant_sim/step', Trigger.Request()).success
        client.spin_until(lambda: PARAMETER_EVENTS.name in client.seen)
        pause.data = False
        assert client.call(SetBool, 'plant_sim/pause', pause).success
        client.spin_until(lambda: client.now_ns() > changed_ns + 200_000_000)
        run.process.send_signal(signal.SIGINT)
    assert run.finish() == 128 + signal.SIGINT, run.stderr
    recorded = read_run(run.result['recording'])
    time = (changed_ns + TICK_NS - FIRST_TICK_NS) / 1e9
    changed = [ParameterChange(time, CONTROLLER, *each) for each in changes.items()]
    assert sorted(recorded.parameter_changes) == sorted(changed)
    told = sorted(map(ParameterChange.from_json, run.result['parameter_changes']))
    assert told == sorted(changed)
    assert f'controller.{name} was set to ' in run.result['reason']
    trust = ['--trust-attached-code'] if controller.startswith('own.py') else []
    status, output, errors = command('replay', run.result['recording'], *trust)
    assert status == 0, output + errors
    assert [line.split(',')[0] for line in output.splitlines()[1:]] == [
        'controller: identical', 'robot: identical',
    ]  # fmt: skip


@pytest.mark.graph
def test_an_error_while_a_controller_takes_them_over_ends_the_run(
    start_run, domain, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    text = OWN.replace('def tick', """def retune(self, parameters, settings):
        raise RuntimeError('never')

    def tick""")  # fmt: skip
    Path('own.py').write_text(text)
    run = start_run(
        'stationary', '--controller', 'own.py:Own', '--processes', 'one', '--json', '--no-record',
        '--set=plant_sim.on_timeout=end', '--set=plant_sim.duration=600', '--real-time-factor', 1,
    )  # fmt: skip
    with contextlib.closing(Client(domain)) as client:
        client.watch(OPERATING_STATE)
        client.spin_until(lambda: client.newest.get(OPERATING_STATE.name))
        assert client.set_value('controller', 'user.gain', 2.0).successful
    assert run.finish() == 1
    line = text.splitlines().index("        raise RuntimeError('never')") + 1
    assert f'own.py:{line}: RuntimeError: never (Own.retune at' in run.result['reason']


def controller(**others):
    """A stub of the node, of whose program the changes are recorded."""
    done = []
    program = SimpleNamespace(
        retune=lambda parameters: done.append(('retune', parameters.k_i)),
        run=lambda tasks, now_ms, inputs: done.append(('run', now_ms)),
    )
    before = ControllerParameters()
    node = SimpleNamespace(
        done=done,
        parameters=before,
        _program=program,
        _tasks=BrickTasks(before),
        _program_parameters=before,
        _changes=PendingChanges(()),
        _is_running=True,
        _gate=SimpleNamespace(newest=lambda name: None),
        _messages=SimpleNamespace(
            retuned=lambda now_ns, values: done.append(('told', now_ns, values)),
            tick=lambda now_ns, outputs, program: done.append(('answered', now_ns)),
        ),
        count_sample=lambda now_ns: None,
        _abort=lambda problem: done.append(('aborted', problem)),
        **others,
    )
    node._retune = lambda now_ns: ControllerNode._retune(node, now_ns)
    return node


TICK = DueTick(1_004_000_000, ('task_ts1',), ())
LATER = DueTick(1_008_000_000, ('task_ts1',), ())


def test_a_change_is_taken_over_and_told_before_the_next_tick(monkeypatch):
    monkeypatch.setattr('ballbot_ros.nodes.controller.device_inputs', lambda newest: 'inputs')
    node = controller()
    node.parameters = ControllerParameters(k_i=-0.01, dst_thr=20)
    ControllerNode._run(node, TICK)
    ControllerNode._run(node, LATER)
    assert node.done == [
        ('told', 1_004_000_000, {'k_i': -0.01, 'dst_thr': 20}),
        ('retune', -0.01),
        ('run', 1004),
        ('answered', 1_004_000_000),
        ('run', 1008),
        ('answered', 1_008_000_000),
    ]


def test_a_change_that_was_taken_back_is_none(monkeypatch):
    monkeypatch.setattr('ballbot_ros.nodes.controller.device_inputs', lambda newest: 'inputs')
    node = controller()
    node.parameters = ControllerParameters()
    ControllerNode._run(node, TICK)
    assert node.done == [('run', 1004), ('answered', 1_004_000_000)]


def test_a_program_that_can_not_take_it_over_ends_the_run():
    def fail(parameters):
        raise ControllerError('own.py:3: no')

    node = controller()
    node._program.retune = fail
    node.parameters = ControllerParameters(k_i=-0.01)
    ControllerNode._run(node, TICK)
    assert node.done == [
        ('told', 1_004_000_000, {'k_i': -0.01}),
        ('aborted', 'own.py:3: no'),
    ]


@pytest.mark.parametrize(('name', 'is_tunable'), [('python', True), ('c', False), ('arm', False)])
def test_the_gains_of_c_wait_for_the_next_run(name, is_tunable):
    implementation = Implementation(ControllerParameters(implementation=name), (), lambda: None)
    node = bare(ControllerNode, _implementation=implementation)
    rows = parameters_of(CONTROLLER)
    assert node.is_live(rows['k_i']) == is_tunable
    assert not node.is_live(rows['a_d'])
    assert bool(implementation.tunable) == is_tunable
