"""Noise is a function of seed, device and sample only."""

import random
import zlib

import numpy as np
import pytest

from ballbot_ros.engine.compilation import compiled
from ballbot_ros.engine.devices import normal_pair, uniform_pair
from ballbot_ros.robot.random_numbers import device_number, noise_key, philox4x32

COUNT = 20_000


def noise(seed=1, device='gyro', draw=normal_pair):
    """Return the function that gives the pair of a sample."""
    key, number = noise_key(seed), device_number(device)
    return lambda index: draw(key, number, index)


def pairs(seed=1, device='gyro', draw=normal_pair, count=COUNT):
    pair = noise(seed, device, draw)
    return np.array([pair(index) for index in range(count)])


def correlation(one, other):
    return np.abs(np.corrcoef(one, other, rowvar=False) - np.eye(4)).max()


def test_the_order_of_the_calls_changes_nothing():
    expected = pairs(count=2000)
    pair = noise()
    order = list(range(2000)) * 2
    random.Random(5).shuffle(order)
    for index in order:
        assert pair(index) == tuple(expected[index])


@pytest.mark.parametrize('index', [0, 255, 256, 257, 10**6, 2**32 - 1, 2**32, 2**40])
@pytest.mark.parametrize('draw', [uniform_pair, normal_pair])
def test_compiled_code_draws_the_same_without_blocks(draw, index):
    assert noise(7, 'sonar', compiled(draw))(index) == noise(7, 'sonar', draw)(index)


def test_noise_is_philox_of_seed_device_and_sample():
    seed, index = 0x1234567890ABCDEF, 0x1_0000_0103
    counter = (index & 0xFFFFFFFF, index >> 32, zlib.crc32(b'sonar'), 0)
    words = philox4x32(*map(np.uint64, (*counter, seed & 0xFFFFFFFF, seed >> 32)))
    first, second = (int(high) << 21 | int(low) >> 11 for high, low in (words[:2], words[2:]))
    assert noise(seed, 'sonar', uniform_pair)(index) == (first / 2**53, second / 2**53)


def test_normal_noise_is_standard_normal():
    drawn = pairs()
    np.testing.assert_allclose(drawn.mean(axis=0), 0.0, atol=0.03)
    np.testing.assert_allclose(drawn.std(axis=0), 1.0, atol=0.02)
    within = [np.mean(np.abs(drawn) < limit) for limit in (1.0, 2.0, 3.0)]
    np.testing.assert_allclose(within, [0.6827, 0.9545, 0.9973], atol=0.005)


def test_uniform_noise_fills_zero_to_one():
    drawn = pairs(draw=uniform_pair)
    assert drawn.min() >= 0.0
    assert drawn.max() < 1.0
    shares, _ = np.histogram(drawn, bins=10, range=(0.0, 1.0))
    np.testing.assert_allclose(shares / drawn.size, 0.1, atol=0.006)


@pytest.mark.parametrize(
    'other', [{'seed': 2}, {'seed': 2**63 - 1}, {'device': 'sonar'}, {'device': 'gyro drift'}]
)
def test_other_seeds_and_devices_have_other_noise(other):
    assert correlation(pairs(), pairs(**other)) < 0.04


def test_samples_are_uncorrelated_with_the_next_ones():
    drawn = pairs()
    for lag in (1, 2, 256):
        assert correlation(drawn[:-lag], drawn[lag:]) < 0.04
