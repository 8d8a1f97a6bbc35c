"""The package as a library: ``import ballbot_ros as bb``."""

import json
import math
import os
import pickle
import signal
import subprocess
import sys
import tempfile
from dataclasses import replace

import control
import numpy as np
import pandas
import pytest
from instance_controllers import Constant, Failing, FailingAtOnce, Gains

import ballbot_ros as bb
from ballbot_ros.analysis.metrics import ExpectationVerdict, Verdict
from ballbot_ros.controllers.design.linear_model import design_servo
from ballbot_ros.controllers.design.loop_analysis import analyse_ideal
from ballbot_ros.controllers.lqg import LQG
from ballbot_ros.engine.golden import load_golden
from ballbot_ros.engine.scenario.metrics import OF_TASKS
from ballbot_ros.errors import BallbotError, RecordingError
from ballbot_ros.parameters import ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.robot.plant.model import PhysicalParameters, state_space
from ballbot_ros.run import library
from ballbot_ros.run.execution import execute
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

SHORT = {'plant_sim.duration': 1.2}


@pytest.fixture(scope='module')
def stationary():
    return bb.simulate('stationary')


@pytest.fixture(scope='module')
def hardware():
    return bb.simulate('autonomous', profile='hardware', seed=3)


def test_a_run_is_that_of_the_command(stationary, tmp_path):
    options = RunOptions(processes=Processes.NONE, output=tmp_path)
    result = execute(RunSpec.of_scenario('stationary', options))
    assert stationary.duty_sha256 == result.duty_sha256 == load_golden().scenarios['stationary']
    assert (stationary.verdict, stationary.reason) == (Verdict.PASSED, '')
    assert stationary.passed
    assert repr(stationary) == '<Run stationary, passed>'
    for name, value in result.metrics.items():
        assert stationary.metrics[name] == pytest.approx(value, rel=1e-9, nan_ok=True), name
    assert [each.verdict for each in stationary.expectations] == [ExpectationVerdict.MET] * 4
    saved = stationary.save(tmp_path / 'saved.mcap')
    # Only the set pace differs: the command's run is as fast as possible because it says so.
    assert messages(saved) == messages(result.recording)


def messages(path):
    """Return all messages of a recording but the announced parameters, and what is attached."""
    with RecordingReader(path) as reader:
        assert reader.complete
        content = [
            (raw.topic, raw.stamp_ns, raw.data)
            for batch in reader.batches()
            for raw in map(batch.message, range(len(batch)))
            if raw.topic != '/participants'
        ]
        return content, {name: file.data for name, file in reader.attachments().items()}


def test_a_saved_run_opens_as_the_same_run(hardware, tmp_path):
    path = tmp_path / 'x.mcap'
    path.write_text('former')
    assert hardware.save(os.fspath(path)) == path
    again = bb.open(path)
    assert again.metrics == pytest.approx(hardware.metrics, nan_ok=True)
    assert again.duty_sha256 == hardware.duty_sha256
    assert again.name == 'x'
    pandas.testing.assert_frame_equal(again.frame(), hardware.frame())
    assert [each.name for each in tmp_path.iterdir()] == ['x.mcap']
    assert again.save(path) == path  # onto itself
    assert bb.open(path, 1).passed == hardware.passed
    with pytest.raises(RecordingError, match=r'run 2 not found; the file has run 1'):
        bb.open(path, 2)
    path.unlink()
    with pytest.raises(BallbotError, match=rf'^{path}: No such file'):
        again.save(tmp_path / 'other.mcap')


def test_a_run_is_copied_with_its_recording(stationary, tmp_path):
    again = pickle.loads(pickle.dumps(stationary))
    assert (
        again.save(tmp_path / 'a.mcap').read_bytes()
        == stationary.save(tmp_path / 'b.mcap').read_bytes()
    )
    assert again.duty_sha256 == stationary.duty_sha256


def test_a_run_can_not_be_changed(stationary):
    stationary.metrics['energy_j'] = 0.0
    assert stationary.metrics['energy_j'] > 0.0
    with pytest.raises(ValueError, match='read-only'):
        stationary.trajectory.duty[0] = 99


def test_no_temporary_file_remains(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    run = bb.simulate(controller=Constant, parameters=SHORT)
    assert list(tmp_path.iterdir()) == []
    assert len(run.frame()) == 300


def test_the_same_arguments_give_the_same_run():
    def duties(**arguments):
        return bb.simulate('hardware_standing', parameters=SHORT, **arguments).duty_sha256

    assert duties(seed=3) == duties(seed=np.int64(3)) != duties(seed=4)


def test_parameters_override_the_scenario(tmp_path):
    file = tmp_path / 'own.yaml'
    file.write_text('plant_sim:\n  ros__parameters: {duration: 1.2, start_pitch_x: 0.01}\n')
    by_file = bb.simulate(parameters=file)
    values = {'plant_sim.duration': np.float32(1.25), 'plant_sim.start_pitch_x': 0.01}
    by_value = bb.simulate(parameters=values)
    assert len(by_file.trajectory.time) == 300
    assert len(by_value.trajectory.time) == 312
    assert by_file.trajectory.psi[0, 0] == by_value.trajectory.psi[0, 0] == pytest.approx(0.01)


def test_a_controller_is_given_by_name_class_or_instance():
    by_name = bb.simulate(controller='lqg', parameters=SHORT)
    by_class = bb.simulate(controller=LQG, parameters=SHORT)
    assert by_name.duty_sha256 == by_class.duty_sha256
    assert by_class.duty_sha256 == bb.simulate(controller=LQG(), parameters=SHORT).duty_sha256
    assert by_name.duty_sha256 != bb.simulate(parameters=SHORT).duty_sha256


def test_an_instance_brings_its_parameters_and_its_design_model():
    def last_duty(controller, **parameters):
        run = bb.simulate(controller=controller, parameters={**SHORT, **parameters})
        return run.trajectory.duty[-1, 0]

    assert last_duty(Constant) == 0
    assert last_duty(Constant(Gains(duty=7.0))) == 7
    assert last_duty(Constant(Gains(duty=7.0)), **{'controller.user.duty': 9}) == 9
    heavy = PhysicalParameters.from_parameters(PlantParameters(body_mass=0.9))
    models = [LQG(), LQG(model=heavy)]
    first, second = (bb.simulate(controller=each, parameters=SHORT) for each in models)
    assert first.duty_sha256 != second.duty_sha256
    with pytest.raises(BallbotError, match=r'controller\.user\.duty: 300\.0 is not within -100'):
        bb.simulate(controller=Constant(Gains(duty=300.0)))


def test_parameters_take_precedence_over_an_instance_and_arguments_over_both(tmp_path):
    def last_duty(controller, parameters):
        return bb.simulate(controller=controller, parameters=parameters).trajectory.duty[-1, 0]

    file = tmp_path / 'own.yaml'
    text = 'plant_sim: {ros__parameters: {duration: 1.2}}\n'
    file.write_text(text + 'controller: {ros__parameters: {user: {duty: 9.0}}}\n')
    assert last_duty(Constant(Gains(duty=7.0)), file) == 9
    assert last_duty(Constant, {**SHORT, 'controller.implementation': 'lqg'}) == 0
    seeded = {**SHORT, 'gyro_driver.seed': 4}
    runs = [
        bb.simulate('hardware_standing', seed=seed, parameters=parameters).duty_sha256
        for seed, parameters in ((2, seeded), (2, SHORT), (None, seeded), (4, SHORT))
    ]
    assert runs[0] == runs[1] != runs[2] == runs[3]


def test_a_run_that_fails_is_returned_up_to_there(caplog, tmp_path):
    run = bb.simulate(controller=Failing())
    told = 'ZeroDivisionError: integer division or modulo by zero (Failing.tick at 0.400 s; '
    assert (run.verdict, run.passed) == (Verdict.FAILED, False)
    assert run.reason.startswith('controller: ')
    assert told in run.reason
    assert caplog.messages == [run.reason]
    assert len(run.trajectory.time) == 100
    assert told in run._repr_html_()
    assert bb.open(run.save(tmp_path / 'failed.mcap')).reason == run.reason
    with pytest.raises(BallbotError, match='RuntimeError: no'):
        bb.simulate(controller=FailingAtOnce)


@pytest.mark.parametrize(
    ('arguments', 'told'),
    [
        ({'scenario': 'nope'}, "unknown scenario 'nope'"),
        ({'profile': 'x'}, "unknown profile 'x'; known: ideal, hardware"),
        ({'seed': -1}, r'gyro_driver\.seed: -1 is not within 0'),
        ({'controller': 'nope'}, "no controller 'nope'"),
        ({'controller': 3}, 'controller: 3 is not a name, a subclass of ballbot_ros.controllers.C'),
        (
            {'controller': Constant(settings=ControllerParameters(k_thetadot=3.0))},
            'the settings of Constant are those of the scenario',
        ),
        ({'parameters': {'plant_sim.lockstep': False}}, 'lockstep: false requires nodes'),
        ({'parameters': {'duration': 1}}, "'duration' is not of the form node.param"),
        ({'parameters': {'plant_sim.nope': 1}}, "plant_sim has no parameter 'nope'"),
        ({'parameters': '/nope.yaml'}, '/nope.yaml: No such file'),
    ],
)
def test_a_mistake_is_told_on_one_line(arguments, told):
    with pytest.raises(BallbotError, match=told) as refusal:
        bb.simulate(**arguments)
    assert '\n' not in str(refusal.value)


def test_an_interruption_ends_the_program_as_usual(monkeypatch):
    class Interrupting(library.LogObserver):
        def update(self, elapsed_s):
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(library, 'LogObserver', Interrupting)
    with pytest.raises(KeyboardInterrupt):
        bb.simulate()


def test_a_run_is_saved_only_where_it_can_be(stationary, tmp_path):
    with pytest.raises(BallbotError, match=r'x\.csv: the name of a recording ends in \.mcap'):
        stationary.save(tmp_path / 'x.csv')
    for target, told in (
        (tmp_path / 'nope' / 'x.mcap', r'x\.mcap: No such file or directory'),
        (tmp_path / f'{"y" * 300}.mcap', 'File name too long'),
        (tmp_path / 'a\0.mcap', 'null'),
    ):
        with pytest.raises(BallbotError, match=told):
            stationary.save(target)
    with pytest.raises(RecordingError, match='No such file'):
        bb.open(tmp_path / 'x.mcap')


def test_a_frame_has_every_signal_with_its_unit(hardware):
    frame = hardware.frame()
    trajectory = hardware.trajectory
    assert frame.index.name == 'time_s'
    assert frame.index[1] == 0.004
    assert len(frame) == len(trajectory.time)
    for number, plane in enumerate('xy'):
        np.testing.assert_array_equal(frame[f'position_{plane}_m'], trajectory.position[:, number])
        np.testing.assert_allclose(
            frame[f'pitch_{plane}_deg'], np.degrees(trajectory.psi)[:, number]
        )
        np.testing.assert_array_equal(frame[f'duty_{plane}_percent'], trajectory.duty[:, number])
        # The brick's devices count in whole degrees.
        for name in (f'gyro_{plane}_deg_per_s', f'encoder_{plane}_deg'):
            np.testing.assert_array_equal(frame[name], np.rint(frame[name]))
        assert frame[f'gyro_{plane}_deg_per_s'].between(500, 700).all()
        assert math.isnan(frame[f'estimated_pitch_{plane}_deg'].iloc[0])
        assert not math.isnan(frame[f'estimated_pitch_{plane}_deg'].iloc[-1])
    # Means over 0.1 s, because the rate rings from tick to tick.
    rate = pandas.Series(np.gradient(frame['pitch_x_deg'], 0.004), frame.index).rolling(25).mean()
    assert rate.corr(frame['pitch_rate_x_deg_per_s'].rolling(25).mean()) > 0.99
    assert frame['distance_m'].min() < 1.0
    assert np.isinf(frame['distance_m']).any()
    assert frame['battery_v'].between(6, 9).all()
    assert frame['operating_state'].iloc[0] == 'calibration'
    assert set(frame['operating_state']) >= {'calibration', 'balance', 'forward', 'rightward'}
    assert {str(kind) for kind in frame.drop(columns='operating_state').dtypes} == {'float64'}


def test_a_signal_of_20_ms_keeps_its_newest_value(hardware):
    distance = hardware.frame()['distance_m']
    changes = np.flatnonzero(distance.to_numpy()[1:] != distance.to_numpy()[:-1]) + 1
    assert len(changes) > 10
    assert not distance.isna().any()
    assert set(changes % 5) == {0}


def test_a_frame_without_pandas_says_how_to_get_it(stationary, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pandas', None)
    with pytest.raises(BallbotError, match=r'pandas.*: install it with `pip install'):
        stationary.frame()


def test_a_notebook_shows_table_and_figure(hardware):
    page = hardware._repr_html_()
    for text in ('<code>wall_clearance_m</code>', '<code>energy_j</code>', '✓', 'data:image/png;'):
        assert text in page
    for absent in ('nan', 'None'):
        assert absent not in page.partition('<img')[0]
    figure = hardware.plot()
    assert figure._repr_png_().startswith(b'\x89PNG')
    assert figure.get_suptitle().startswith('autonomous: ')
    controlled = bb.simulate(controller=Constant, parameters=SHORT).plot()
    assert controlled.get_suptitle().startswith('stationary, Constant: ')


def test_the_linear_model_is_that_of_the_plant():
    physical = PhysicalParameters.from_parameters(PlantParameters())
    a, b = state_space(physical)
    model = bb.linear_model()
    np.testing.assert_array_equal(model.A, a)
    np.testing.assert_array_equal(model.B, b[:, :1])
    assert (model.input_labels, model.output_labels) == (
        ['v'], ['theta', 'psi', 'theta_dot', 'psi_dot'],
    )  # fmt: skip
    assert model.state_labels == model.output_labels
    heavier = bb.linear_model({'plant_sim.body_mass': 1.0})
    assert not np.array_equal(heavier.A, a)


def test_the_loop_closes_to_the_poles_of_the_design():
    design = design_servo(PhysicalParameters.from_parameters(PlantParameters()))
    *k_f, k_i = design.gain
    closed = control.feedback(bb.loop({'controller.k_f': k_f, 'controller.k_i': k_i}))
    np.testing.assert_allclose(
        np.sort_complex(closed.poles()), np.sort_complex(design.poles), rtol=1e-6
    )
    low, *_ = control.stability_margins(bb.loop())
    ideal = analyse_ideal(ParameterSet())
    assert low == pytest.approx(ideal.margins.gain_low.value, rel=1e-3)
    doubled = bb.loop({'controller.pwm_gain': 2.0})
    np.testing.assert_allclose(doubled.C, 2.0 * bb.loop().C)
    with pytest.raises(BallbotError, match='k_f'):
        bb.loop({'controller.k_f': [1.0]})
    with pytest.raises(BallbotError, match=r'^controller\.k_thetadot has no effect here'):
        bb.loop({'controller.k_thetadot': 300})
    with pytest.raises(BallbotError, match=r'^controller\.k_i has no effect here'):
        bb.linear_model({'controller.k_i': 300})


def test_expectations_bound_the_times_of_the_tasks(tmp_path):
    path, timed = tmp_path / 'timed.yaml', {'plant_sim.kernel': True, 'plant_sim.link': True}
    path.write_text(
        'purpose: keeps its times\nduration: 2.0\nexpectations:\n  response_time_ms: {max: 0.4}\n'
        '  lost_jobs: {max: 0}\n  utilisation: {min: 0.2, max: 0.3}\n'
    )
    run = bb.simulate(path, parameters=timed)
    assert run.passed
    options = RunOptions(processes=Processes.NONE, record=False, values=timed)
    result = execute(RunSpec.of_scenario(str(path), options))
    assert result.passed
    assert [result.metrics[name] for name in OF_TASKS] == [run.metrics[name] for name in OF_TASKS]
    late = bb.simulate(path, parameters={**timed, 'controller.cycles_per_instruction': 4.0})
    assert late.verdict is Verdict.NOT_MET
    assert 'response_time_ms 0.6' in late.reason
    without = execute(RunSpec.of_scenario(str(path), replace(options, values={})))
    assert without.verdict is Verdict.NOT_MET
    assert without.reason.startswith('response_time_ms without a value instead of ≤ 0.4, lost_jobs')
    unknown = bb.simulate(path)
    assert unknown.verdict is Verdict.NOT_JUDGED
    assert 'lost_jobs, utilisation cannot be computed from this recording' in unknown.reason
    # Recordings lack the jobs after the last message.
    longer = bb.simulate(path, parameters={**timed, 'plant_sim.duration': 2.05})
    assert len(longer.trajectory.timing) == 500
    assert longer.passed


def test_the_sampled_loop_is_that_of_the_analysis():
    loop = bb.sampled_loop()
    assert loop.dt == 0.004
    closed = control.feedback(loop).poles()
    assert min(closed, key=lambda pole: pole.real) == pytest.approx(-0.9374, abs=1e-4)
    assert abs(closed).max() < 1.0
    delayed = {'plant_sim.actuator_delay': 3, 'gyro_driver.delay': 1, 'encoder_driver.delay': 2}
    assert abs(control.feedback(bb.sampled_loop(delayed)).poles()).max() > 1.0
    with pytest.raises(BallbotError, match=r'^gyro_driver\.noise has no effect here'):
        bb.sampled_loop({'gyro_driver.noise': 0.7})
    with pytest.raises(BallbotError, match=r'^gyro_driver\.delay: 101 is not within 0 … 100 ms'):
        bb.sampled_loop({'gyro_driver.delay': 101})
    with pytest.raises(BallbotError, match=r'^parameters: 5 is neither a mapping nor a path$'):
        bb.sampled_loop(5)


def test_the_package_imports_nothing_before_its_first_use():
    code = (
        'import json, sys, ballbot_ros as bb\n'
        'before = [each for each in ("numpy", "ballbot_ros.run") if each in sys.modules]\n'
        'bb.simulate\n'
        'after = [each for each in ("rclpy", "control", "matplotlib") if each in sys.modules]\n'
        'print(json.dumps([before, after, dir(bb)]))'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, check=True)
    before, after, names = json.loads(done.stdout)
    assert (before, after) == ([], [])
    assert names == [
        'BallbotError', 'Run', '__version__', 'branch', 'linear_model', 'loop', 'open',
        'sampled_loop', 'simulate', 'study',
    ]  # fmt: skip
    assert 'open' not in bb.__all__  # which `from ballbot_ros import *` would replace
    with pytest.raises(AttributeError, match="module 'ballbot_ros' has no attribute 'nope'"):
        bb.nope  # noqa: B018
