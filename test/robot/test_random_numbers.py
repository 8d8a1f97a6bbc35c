"""Philox4x32-10 against its published vectors, and the numbers derived from it."""

import math
import statistics

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from scipy import special, stats

from ballbot_ros.robot.random_numbers import bits_53, normal, philox4x32, uniform

BITS = st.integers(0, 2**53 - 1)
COUNT = 200_000

# Random123's known answers (kat_vectors): counter, key, words.
PUBLISHED = [
    (
        '00000000 00000000 00000000 00000000 00000000 00000000',
        '6627e8d5 e169c58d bc57ac4c 9b00dbd8',
    ),
    (
        'ffffffff ffffffff ffffffff ffffffff ffffffff ffffffff',
        '408f276d 41c83b0e a20bc7c6 6d5451fd',
    ),
    (
        '243f6a88 85a308d3 13198a2e 03707344 a4093822 299f31d0',
        'd16cfe09 94fdcceb 5001e420 24126ea1',
    ),
]


def words_of(text):
    return [np.uint64(int(word, 16)) for word in text.split()]


@pytest.fixture(scope='module')
def drawn():
    """The 53 bits of many counters."""
    counters = np.arange(COUNT, dtype=np.uint64)
    zero = np.uint64(0)
    words = philox4x32(counters, zero, zero, zero, np.uint64(1), zero)
    return bits_53(words.w0, words.w1).tolist()


@pytest.mark.parametrize(('given_words', 'made'), PUBLISHED)
def test_the_published_vectors(given_words, made):
    assert list(philox4x32(*words_of(given_words))) == words_of(made)


def test_arrays_and_numbers_give_the_same():
    inputs = [words_of(text) for text, _ in PUBLISHED]
    together = philox4x32(*(np.array(column) for column in zip(*inputs, strict=True)))
    assert np.transpose(together).tolist() == [words_of(made) for _, made in PUBLISHED]


@given(st.lists(st.integers(0, 2**32 - 1), min_size=2, max_size=2))
def test_53_bits_are_the_first_word_and_most_of_the_second(words):
    high, low = words
    assert bits_53(np.uint64(high), np.uint64(low)) == (high * 2**32 + low) // 2**11


def test_the_bits_of_numpy_numbers_make_the_same_numbers():
    high, low = np.uint64(0xFFFFFFFF), np.uint64(5)
    bits = bits_53(high, low)
    assert (normal(bits), uniform(bits)) == (normal(int(bits)), uniform(int(bits)))


@given(BITS)
def test_a_uniform_number_keeps_every_bit(bits):
    number = uniform(bits)
    assert 0.0 <= number < 1.0
    assert number * 2**53 == bits


@given(BITS)
def test_complementary_bits_give_opposite_numbers(bits):
    assert normal(2**53 - 1 - bits) == -normal(bits)


@given(BITS, BITS)
def test_more_bits_never_give_a_smaller_number(one, other):
    low, high = sorted((one, other))
    assert normal(low) <= normal(high)


@given(BITS)
def test_a_normal_number_is_the_quantile(bits):
    share = (bits + 0.5) / 2**53
    # Near 1 the probability itself has lost the digits that the quantile needs there.
    exact = special.ndtri(share) if share < 0.5 else -special.ndtri((2**53 - bits - 0.5) / 2**53)
    assert normal(bits) == pytest.approx(exact, rel=1e-14, abs=1e-15)


def test_the_tails_are_the_quantile_too():
    tail = [2**exponent - 1 for exponent in range(53)]
    exact = [statistics.NormalDist().inv_cdf((bits + 0.5) / 2**53) for bits in tail]
    assert [normal(bits) for bits in tail] == pytest.approx(exact, rel=1e-13)


def test_the_farthest_tail_is_beyond_eight_sigma():
    assert normal(0) == pytest.approx(-8.2924, abs=1e-3)
    assert math.isfinite(normal(2**53 - 1))


def test_consecutive_numbers_have_the_right_distribution(drawn):
    uniforms = [uniform(bits) for bits in drawn]
    normals = [normal(bits) for bits in drawn]
    assert stats.kstest(uniforms, 'uniform').pvalue > 0.001
    assert stats.kstest(normals, 'norm').pvalue > 0.001
    assert stats.skew(normals) == pytest.approx(0.0, abs=0.02)
    assert stats.kurtosis(normals) == pytest.approx(0.0, abs=0.04)
    assert abs(np.corrcoef(normals[:-1], normals[1:])[0, 1]) < 0.008
