"""The functions can be compiled without changes, with the same bits."""

import random

import numpy as np
import pytest

from ballbot_ros.engine.compilation import compiled
from ballbot_ros.robot.arithmetic import natural_log, sine_cosine
from ballbot_ros.robot.plant.integration import zero_order_hold
from ballbot_ros.robot.random_numbers import bits_53, normal, philox4x32, uniform

COUNT = 20_000


def draws(draw):
    generator = random.Random(1)
    return [draw(generator) for _ in range(COUNT)]


def bytes_of(values):
    return np.array(values, dtype=np.float64).tobytes()


@pytest.mark.parametrize(
    ('function', 'numbers'),
    [
        (sine_cosine, draws(lambda draw: draw.uniform(-2.0, 2.0))),
        (sine_cosine, draws(lambda draw: draw.gauss(0.0, 1.0) * 10.0 ** draw.randint(-9, 9))),
        (natural_log, draws(lambda draw: 10.0 ** draw.uniform(-300, 300))),
        (uniform, draws(lambda draw: draw.getrandbits(53))),
        (normal, draws(lambda draw: draw.getrandbits(53))),
        (normal, draws(lambda draw: draw.getrandbits(draw.randint(1, 53)))),
    ],
)
def test_numbers(function, numbers):
    fast = compiled(function)
    assert bytes_of([fast(x) for x in numbers]) == bytes_of([function(x) for x in numbers])


def test_philox():
    fast, fast_bits = compiled(philox4x32), compiled(bits_53)
    words = np.random.default_rng(1).integers(0, 2**32, (6, 1000), dtype=np.uint64)
    made = philox4x32(*words)
    alone = [fast(*column) for column in words.T]
    assert np.transpose(alone).tolist() == np.array(made).tolist()
    assert [fast_bits(*each[:2]) for each in alone] == bits_53(made.w0, made.w1).tolist()


def test_discretisation():
    fast = compiled(zero_order_hold)
    draw = np.random.default_rng(1)
    for scale in (0.1, 1.0, 100.0, 1e4):
        a, b = draw.normal(size=(4, 4)) * scale, draw.normal(size=(4, 3))
        for one, other in zip(fast(a, b, 0.01), zero_order_hold(a, b, 0.01), strict=True):
            assert one.tobytes() == other.tobytes()
