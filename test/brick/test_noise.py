"""Noise is a function of seed, device and sample, and of nothing else."""

import random

import numpy as np
import pytest

from ballbot_ros.brick.noise import DeviceNoise, normal, uniform

COUNT = 20_000


def rows(seed=1, device='gyro', draw=normal, count=COUNT):
    noise = DeviceNoise(seed, device, 2, draw)
    return np.array([noise.row(index) for index in range(count)])


def correlation(one, other):
    return np.abs(np.corrcoef(one, other, rowvar=False) - np.eye(4)).max()


def test_the_order_of_the_calls_changes_nothing():
    expected = rows(count=2000)
    noise = DeviceNoise(1, 'gyro', 2, normal)
    order = list(range(2000)) * 2
    random.Random(5).shuffle(order)
    for index in order:
        assert noise.row(index) == expected[index].tolist()


@pytest.mark.parametrize('index', [0, 255, 256, 257, 10**6, 2**40])
def test_a_device_that_begins_late_draws_what_it_would_have_drawn(index):
    running = DeviceNoise(7, 'sonar', 2, uniform)
    for before in range(max(0, index - 600), index):
        running.row(before)
    assert DeviceNoise(7, 'sonar', 2, uniform).row(index) == running.row(index)


def test_normal_noise_is_standard_normal():
    drawn = rows()
    np.testing.assert_allclose(drawn.mean(axis=0), 0.0, atol=0.03)
    np.testing.assert_allclose(drawn.std(axis=0), 1.0, atol=0.02)
    within = [np.mean(np.abs(drawn) < limit) for limit in (1.0, 2.0, 3.0)]
    np.testing.assert_allclose(within, [0.6827, 0.9545, 0.9973], atol=0.005)


def test_uniform_noise_fills_zero_to_one():
    drawn = rows(draw=uniform)
    assert drawn.min() >= 0.0
    assert drawn.max() < 1.0
    shares, _ = np.histogram(drawn, bins=10, range=(0.0, 1.0))
    np.testing.assert_allclose(shares / drawn.size, 0.1, atol=0.006)


@pytest.mark.parametrize(
    'other', [{'seed': 2}, {'seed': 2**63 - 1}, {'device': 'sonar'}, {'device': 'gyro drift'}]
)
def test_other_seeds_and_devices_have_noise_of_their_own(other):
    assert correlation(rows(), rows(**other)) < 0.04


def test_samples_are_uncorrelated_with_the_next_ones():
    drawn = rows()
    for lag in (1, 2, 256):
        assert correlation(drawn[:-lag], drawn[lag:]) < 0.04
