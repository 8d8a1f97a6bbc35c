"""The shipped gains of config/gains: how they were made, and what they promise."""

import math
from functools import cache
from pathlib import Path

import pytest
import yaml

import ballbot_ros as bb
from ballbot_ros.controllers.design.loop_analysis import analyse_sampled
from ballbot_ros.engine.scenario.reader import scenario_names
from ballbot_ros.parameters import ControllerParameters
from ballbot_ros.parameters.files import read_parameter_file

CONFIG = Path(__file__).parents[3] / 'config'
QUIET = CONFIG / 'gains/quiet.yaml'
DOCUMENT = CONFIG / 'gains/document.yaml'
NAMES = ('k_f', 'k_i', 'a_d', 'a_r', 'a_gd')

# The largest pitch from which the document's gains recover on `stationary`, found by bisection.
DOCUMENTS_PITCH_DEG = 7.125


def on_a_brick(gains):
    values = read_parameter_file(gains).of(ControllerParameters)
    own = {f'controller.{name}': getattr(values, name) for name in NAMES}
    return {'plant_sim.kernel': True, 'plant_sim.link': True, **own}


@cache
def duty_rms(scenario, *, is_quiet):
    result = bb.simulate(scenario, parameters=QUIET if is_quiet else DOCUMENT)
    assert result.passed, result.reason
    return result.metrics['duty_rms_percent']


def test_the_command_in_its_first_line_makes_the_file(command, tmp_path):
    first = QUIET.read_text(encoding='utf-8').splitlines()[0]
    name, subcommand, *arguments = first.removeprefix('# ').split()
    assert name == 'ballbot'
    again = tmp_path / 'again.yaml'
    status, _, stderr = command(subcommand, *arguments, '--output', again)
    assert (status, stderr) == (0, '')
    assert again.read_text(encoding='utf-8').splitlines()[0] == first
    made, shipped = (read_parameter_file(path).of(ControllerParameters) for path in (again, QUIET))
    for field in NAMES:
        assert getattr(made, field) == pytest.approx(getattr(shipped, field), rel=1e-5), field
    assert made.values().keys() == shipped.values().keys()


def test_they_change_gains_and_filters_only():
    (node,) = yaml.safe_load(QUIET.read_text(encoding='utf-8')).items()
    assert node[0] == '/**/controller'
    assert set(node[1]['ros__parameters']) == set(NAMES)


def test_the_gains_of_the_document_are_the_defaults():
    document = read_parameter_file(DOCUMENT).of(ControllerParameters)
    assert document == ControllerParameters()


def test_the_profile_of_real_devices_has_the_quiet_ones():
    profile, quiet = (
        yaml.safe_load(path.read_text(encoding='utf-8'))['/**/controller']['ros__parameters']
        for path in (CONFIG / 'profiles/hardware.yaml', QUIET)
    )
    assert {name: profile[name] for name in NAMES} == quiet


def test_the_margins_are_wide():
    loop = analyse_sampled(read_parameter_file(QUIET))
    assert loop.margins.gain_low.value <= 0.5
    assert loop.margins.gain_high.value >= 2.0
    delays = loop.margins.dead_time_ms, loop.samples.gyro_dead_time_ms
    assert min(each.value for each in (*delays, loop.samples.encoder_dead_time_ms)) >= 8.0
    assert loop.ringing is None


def test_the_duty_is_quiet():
    assert duty_rms('stationary', is_quiet=True) <= 0.55 * duty_rms('stationary', is_quiet=False)


@pytest.mark.parametrize('phase', [0, 1])
@pytest.mark.parametrize('model', ['linear', 'nonlinear'])
def test_on_a_brick_the_documents_gains_rattle_and_the_quiet_ones_do_not(model, phase):
    of_run = {
        'plant_sim.plant_model': model, 'plant_sim.link_phase': phase, 'plant_sim.duration': 10.0
    }  # fmt: skip
    document, quiet = (
        bb.simulate('stationary', parameters={**on_a_brick(gains), **of_run}).metrics
        for gains in (DOCUMENT, QUIET)
    )
    assert quiet['duty_rms_percent'] < 10.0
    assert document['duty_rms_percent'] > 40.0


@pytest.mark.parametrize('scenario', scenario_names())
def test_every_shipped_scenario_passes(scenario):
    assert duty_rms(scenario, is_quiet=True) > 0.0


def simulate_stationary(values, *, is_quiet=True):
    """Run `stationary` with these values, and the quiet gains or the document's."""
    quiet = read_parameter_file(QUIET).of(ControllerParameters).values() if is_quiet else {}
    gains = {f'controller.{name}': quiet[name] for name in NAMES if name in quiet}
    return bb.simulate('stationary', parameters={**gains, **values})


def recovers(start_deg, plane='x', **options):
    values = {
        'plant_sim.start_pitch_x': 0.0,
        f'plant_sim.start_pitch_{plane}': math.radians(start_deg),
    }
    result = simulate_stationary(values, **options)
    return result.metrics['peak_pitch_deg'] < 30.0 and result.metrics['settling_time_s'] < 4.0


@pytest.mark.parametrize('plane', 'xy')
def test_it_recovers_from_nine_tenths_of_the_pitch(plane):
    assert recovers(0.9 * DOCUMENTS_PITCH_DEG, plane)


def test_the_documents_gains_recover_from_that_pitch():
    assert recovers(DOCUMENTS_PITCH_DEG - 0.05, is_quiet=False)
    assert not recovers(DOCUMENTS_PITCH_DEG + 0.1, is_quiet=False)


@pytest.mark.parametrize('values', [
    {'plant_sim.actuator_delay': 8}, {'gyro_driver.delay': 8}, {'encoder_driver.delay': 8},
    {'controller.pwm_gain': 2.0}, {'controller.pwm_gain': 0.5},
])  # fmt: skip
def test_runs_within_the_margins_are_calm(values):
    result = simulate_stationary(values)
    assert result.passed, result.reason
    assert result.metrics['duty_rms_percent'] < 10.0
