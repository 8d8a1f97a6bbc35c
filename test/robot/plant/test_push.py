"""Pushes: momentum, superposition, signs, times."""

import math

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from parts import START_NS, make_plant, run_plant

from ballbot_ros.robot.plant.ground_truth import Push

MODELS = ['linear', 'nonlinear']
FREE = {'gravity': 0.0, 'back_emf_constant': 0.0, 'motor_friction': 0.0}
RADIUS, HEIGHT = 0.026, 0.17
MS = 1_000_000


def mass_matrix(psi=0.0):
    coupling = 0.682 * HEIGHT * RADIUS
    upright = [
        [0.0004965718185941043, 0.0029935468480725624],
        [0.0029935468480725624, 0.02630062648526077],
    ]
    return np.array(upright) + coupling * (math.cos(psi) - 1.0) * np.array([[0, 1], [1, 0]])


forces = st.floats(-2.0, 2.0)


def push(force, torque=(0.0, 0.0), start=0, end=4 * MS):
    return Push(START_NS + start, START_NS + end, force, torque)


def rates_after(*pushes, ticks=1, **changes):
    """Return theta_dot and psi_dot of plane x and of plane y."""
    plant = make_plant(**changes)
    for each in pushes:
        plant.push(each)
    truth = run_plant(plant, [(0, 0)] * ticks)[-1]
    return [
        np.array([velocity / RADIUS, rate])
        for velocity, rate in zip(truth.velocity, truth.psi_rate, strict=True)
    ]


@given(forces, forces, st.floats(-0.1, 0.1))
def test_an_impulse_changes_the_momenta_by_force_times_time(force_x, force_y, torque):
    x, y = rates_after(push((force_x, force_y), (torque, 0.0)), **FREE)
    seconds = 4e-3
    np.testing.assert_allclose(
        mass_matrix() @ x,
        [force_x * RADIUS * seconds, (force_x * HEIGHT + torque) * seconds],
        atol=1e-12,
    )
    np.testing.assert_allclose(
        mass_matrix() @ y,
        [force_y * RADIUS * seconds, force_y * HEIGHT * seconds],
        atol=1e-12,
    )


@pytest.mark.parametrize('model', MODELS)
@given(forces, forces)
def test_pushes_add_up(model, one, other):
    both = rates_after(push((one, 0.0)), push((other, 0.0)), plant_model=model)
    together = rates_after(push((one + other, 0.0)), plant_model=model)
    np.testing.assert_allclose(both, together, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('plane', [0, 1])
def test_a_push_drives_and_tips_its_own_plane_in_its_direction(model, plane):
    force = [0.0, 0.0]
    force[plane] = 0.5
    rates = rates_after(push(tuple(force)), plant_model=model)
    assert (rates[plane] > 0.0).all()
    assert (rates[1 - plane] == 0.0).all()


@pytest.mark.parametrize('model', MODELS)
def test_a_torque_tips_the_body_in_its_direction(model):
    x, y = rates_after(push((0.0, 0.0), (0.01, -0.01)), plant_model=model)
    assert x[1] > 0.0
    assert y[1] < 0.0


@given(forces, st.floats(-1.0, 1.0))
def test_a_force_acts_at_the_height_of_the_leaning_bodys_centre(force, pitch):
    x, _ = rates_after(
        push((force, 0.0)), plant_model='nonlinear', start_pitch_x=pitch, fall_angle=1.5, **FREE
    )
    seconds = 4e-3
    momenta = [force * RADIUS * seconds, force * HEIGHT * math.cos(pitch) * seconds]
    np.testing.assert_allclose(mass_matrix(pitch) @ x, momenta, rtol=0.01, atol=1e-9)


@given(st.integers(0, 16), st.integers(0, 16))
def test_a_push_acts_in_the_steps_that_begin_within_it(start_ms, length_ms):
    end = start_ms + length_ms
    x, _ = rates_after(push((0.0, 0.0), (0.001, 0.0), start_ms * MS, end * MS), ticks=8, **FREE)
    momentum = (mass_matrix() @ x)[1]
    assert momentum == pytest.approx(0.001 * length_ms * 1e-3, abs=1e-12)


def test_a_push_in_the_past_has_no_effect():
    past = push((5.0, 5.0), start=-10 * MS, end=0)
    np.testing.assert_array_equal(rates_after(past), 0.0)


def test_a_hard_push_fells_the_robot_into_a_finite_rest():
    plant = make_plant()
    plant.push(push((1e6, -1e6), (1e3, 1e3)))
    truth = run_plant(plant, [(0, 0)] * 50)[-1]
    assert plant.fallen
    assert np.isfinite(truth.position).all()
    assert truth.velocity == truth.psi_rate == (0.0, 0.0)
