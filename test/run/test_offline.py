"""Runs in this process: by compiled code if that pays, with the same result."""

import dataclasses
import signal
from collections import Counter
from itertools import count

import numpy as np
import pytest

pytest.importorskip('numba')

from ballbot_ros.analysis.run_data import read_run
from ballbot_ros.controllers.codegen.implementation import implementation_for
from ballbot_ros.controllers.document.program import ControlProgram
from ballbot_ros.engine import compiled_loop
from ballbot_ros.engine.compilation import has_kept_code
from ballbot_ros.engine.trajectory import Engine
from ballbot_ros.lockstep.run_actions import Outcome
from ballbot_ros.parameters import ControllerParameters, ParameterSet
from ballbot_ros.parameters.parameter_set import ALL_NODES
from ballbot_ros.run import offline
from ballbot_ros.run.observer import LogObserver
from ballbot_ros.run.offline import run_offline
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec


@pytest.fixture
def always(monkeypatch):
    """Use compiled code for runs of any length."""
    monkeypatch.setattr(compiled_loop, 'MIN_TICKS', 0)
    monkeypatch.setattr(compiled_loop, 'has_kept_code', lambda name: True)


def spec_of(name, *words, **options):
    return RunSpec.of_scenario(
        name, RunOptions(processes=Processes.NONE, assignments=words, **options)
    )


def run(spec, recording=None):
    return run_offline(spec, recording, LogObserver())


def assert_same(one, other):
    for field in dataclasses.fields(one):
        mine, its = (getattr(each, field.name) for each in (one, other))
        if field.name == 'trajectory':
            for key, column in vars(mine).items():
                assert column.tobytes() == vars(its)[key].tobytes(), key
                assert column.dtype == vars(its)[key].dtype
        elif field.name not in ('real_time_factor', 'engine'):
            assert mine == its, field.name


TIMED = ('plant_sim.kernel=true', 'plant_sim.link=true', 'controller.bus_cycles=0')
RUNS = (
    ('stationary', 'plant_sim.start_pitch_x=0.3'),
    ('stationary', 'plant_sim.duration=0.004'),
    ('push', 'plant_sim.seed=3', 'gyro_driver.delay=3'),
    ('hardware_autonomous', 'plant_sim.duration=8'),
    ('remote_wall', 'plant_sim.on_wall_hit=stop', 'controller.dst_thr=1'),
    ('push', 'controller.implementation=pid', 'plant_sim.duration=6'),
    ('hardware_autonomous', 'controller.implementation=drift_filter', 'plant_sim.duration=8'),
    ('push', *TIMED, 'controller.control_instructions=76000', 'controller.kernel_defect=true'),
    ('push', *TIMED, 'controller.implementation=pid', 'plant_sim.duration=3.03'),
    (
        'stationary',
        'controller.implementation=commissioning',
        'controller.user.rest_time=0.1',
        'controller.user.pause_time=0.1',
        'controller.user.port_time=0.1',
        'plant_sim.duration=2',
    ),
)


@pytest.mark.parametrize('words', RUNS)
def test_compiled_and_interpreted_runs_have_the_same_result(words, always, monkeypatch):
    monkeypatch.setattr(offline, '_TICKS_AT_ONCE', 600)
    spec = spec_of(*words)
    fast = run(spec)
    assert fast.engine is Engine.COMPILED
    monkeypatch.setattr(offline, 'pays', lambda ticks, program: False)
    slow = run(spec)
    assert slow.engine is Engine.INTERPRETED
    assert_same(fast, slow)


@pytest.mark.parametrize('words', RUNS)
def test_their_recordings_have_the_same_bytes(words, always, tmp_path, monkeypatch):
    monkeypatch.setattr(offline, '_RECORDED_TICKS_AT_ONCE', 300)
    spec, path = spec_of(*words), tmp_path / 'run.mcap'
    fast = run(spec, path)
    compiled = path.read_bytes()
    path.unlink()
    monkeypatch.setattr(offline, 'pays', lambda ticks, program: False)
    assert_same(fast, run(spec, path))
    assert path.read_bytes() == compiled


@pytest.mark.parametrize('words', [*RUNS, ('hardware_standing', 'plant_sim.duration=3')])
def test_the_data_of_a_compiled_run_are_those_in_its_recording(
    words, always, tmp_path, monkeypatch
):
    monkeypatch.setattr(offline, '_RECORDED_TICKS_AT_ONCE', 700)
    path = tmp_path / 'run.mcap'
    result = run_offline(spec_of(*words), path, LogObserver(), collects_data=True)
    data, found = (plain(each) for each in (result.data, read_run(path)))
    assert data.pop('attached.scenario.name') == words[0]
    assert found.pop('attached.scenario.name') == 'scenario', 'the file has another name'
    assert data == found


def plain(content, name=''):
    """Return everything in nested data by name, with arrays as their types and bytes."""
    if isinstance(content, ParameterSet):
        return {f'{name}.{node}': content.of_node(node) for node in ALL_NODES}
    if isinstance(content, np.ndarray):
        return {name: (content.dtype, content.shape, content.tobytes())}
    if dataclasses.is_dataclass(content):
        parts = ((each.name, getattr(content, each.name)) for each in dataclasses.fields(content))
    elif isinstance(content, dict):
        parts = content.items()
    elif isinstance(content, list | tuple):
        parts = enumerate(content)
    else:
        return {name: content}
    found = {f'{name}.{key}'.strip('.'): value for key, value in parts}
    return {
        key: value
        for each, part in found.items()
        for key, value in (plain(part, each) or {each: part}).items()
    }


@pytest.mark.parametrize('first_fault', [0, 2])
def test_the_interpreter_repeats_what_a_law_fails_in(always, tmp_path, monkeypatch, first_fault):
    monkeypatch.setattr(offline, '_TICKS_AT_ONCE', 150)
    monkeypatch.setattr(offline, '_RECORDED_TICKS_AT_ONCE', 150)
    spec = spec_of('push', 'plant_sim.duration=4', controller='pid')
    path, parts, make = tmp_path / 'run.mcap', iter(()), compiled_loop.CompiledLoop._advance

    def advance(loop, ticks, traced):
        if next(parts) == first_fault:
            raise ValueError('no duty')
        return make(loop, ticks, traced)

    monkeypatch.setattr(compiled_loop.CompiledLoop, '_advance', advance)
    found = []
    for recording in (None, path):
        parts = count()
        found.append(run(spec, recording))
        assert found[-1].engine is Engine.INTERPRETED
    data = path.read_bytes()
    path.unlink()
    monkeypatch.setattr(offline, 'pays', lambda ticks, program: False)
    for each in found:
        assert_same(each, run(spec))
    run(spec, path)
    assert path.read_bytes() == data


def test_paced_and_users_runs_are_interpreted(always, tmp_path):
    words = ('stationary', 'plant_sim.duration=0.1')
    assert run(spec_of(*words, real_time_factor=20.0)).engine is Engine.INTERPRETED
    file = tmp_path / 'mine.py'
    file.write_text('from ballbot_ros.controllers.pid import PID\nclass Mine(PID): pass\n')
    own = spec_of(*words, controller=f'{file}:Mine')
    assert run(own).engine is Engine.INTERPRETED


def test_few_ticks_do_not_load_compiled_code(monkeypatch):
    monkeypatch.setattr(compiled_loop, 'is_loaded', lambda function: False)
    monkeypatch.setattr(compiled_loop, 'has_kept_code', lambda name: True)
    monkeypatch.setattr(compiled_loop, '_asked', Counter())
    monkeypatch.setattr(compiled_loop, '_missing', {})
    most = compiled_loop.MIN_TICKS
    parameters = spec_of('stationary', controller='pid').parameters.of(ControllerParameters)
    law = implementation_for(parameters).make()
    documents = ControlProgram(ControllerParameters())
    for program in (documents, law):
        assert not compiled_loop.pays(most - 1, program)
        assert compiled_loop.pays(1, program)
    monkeypatch.setattr(compiled_loop, 'has_kept_code', lambda name: False)
    for program in (documents, law):
        assert not compiled_loop.pays(most, program)
    monkeypatch.setattr(compiled_loop, 'is_loaded', lambda function: True)
    assert compiled_loop.pays(1, documents)


def test_runs_that_would_have_been_worth_it_let_the_code_be_compiled(monkeypatch):
    started = []
    with monkeypatch.context() as patch:
        patch.setattr(compiled_loop, 'compile_in_background', lambda *what: started.append(what))
        patch.setattr(compiled_loop, '_asked', Counter())
        patch.setattr(compiled_loop, '_missing', {})
        patch.setattr(compiled_loop, 'is_loaded', lambda function: False)
        patch.setattr(compiled_loop, 'has_kept_code', lambda name: False)
        patch.setattr(compiled_loop, 'MIN_TICKS', 50)
        words = ('stationary', 'plant_sim.duration=0.1')
        for controller in (None, 'pid'):
            assert run(spec_of(*words, controller=controller)).engine is Engine.INTERPRETED
        assert not started
        run(spec_of(*words))
        run(spec_of(*words, controller='pid'))
    codes = {kept: compiles for kept, *compiles in started}
    names = ('python', 'ballbot_ros.controllers.pid:PID')
    assert [*codes.values()] == [[compiled_loop.compile_runs, name] for name in names]
    for kept, (compiles, name) in codes.items():
        compiles(name)
        assert has_kept_code(kept)


def test_a_signal_ends_a_long_compiled_run(always):
    class Interrupting(LogObserver):
        def update(self, elapsed_s):
            if elapsed_s > 1000.0:
                signal.raise_signal(signal.SIGTERM)

    result = run_offline(spec_of('stationary', 'plant_sim.duration=1e6'), None, Interrupting())
    assert result.outcome is Outcome.STOPPED
    assert result.failure_status == 128 + signal.SIGTERM
    assert 1000.0 < result.ticks * 4e-3 < 1200.0
