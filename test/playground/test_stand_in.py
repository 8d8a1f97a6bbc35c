"""What stands in for numpy in the browser computes the same bits."""

import operator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from playground_python import load, without_numpy

from ballbot_ros.engine.golden import load_golden

OPERATIONS = operator.add, operator.sub, operator.mul, operator.truediv
WORD_OPERATIONS = operator.add, operator.mul, operator.and_, operator.or_, operator.xor
WORDS = st.integers(0, 2**64 - 1)

stand_in = load('stand_in/numpy/__init__.py')


def bits(number):
    return np.float32(number).view(np.uint32) if number == number else 'nan'


@pytest.mark.parametrize('scenario', load_golden().scenarios)
def test_without_numpy_a_run_has_the_golden_hash(scenario):
    found = without_numpy(f"[session.duty_sha256('{scenario}', 0), sys.modules['numpy'].__file__]")
    assert found[0] == load_golden().scenarios[scenario]
    assert 'site-packages' not in found[1]


@given(one=st.floats(width=32), two=st.floats(width=32), double=st.floats())
def test_singles_are_those_of_numpy(one, two, double):
    with np.errstate(all='ignore'):
        for operation in OPERATIONS:
            for other in (two, double):
                if other == two:
                    ours = operation(stand_in.float32(one), stand_in.float32(other))
                    theirs = operation(np.float32(one), np.float32(other))
                    assert bits(ours) == bits(theirs)
                assert bits(operation(stand_in.float32(one), other)) == bits(
                    operation(np.float32(one), other)
                )
                assert bits(operation(other, stand_in.float32(one))) == bits(
                    operation(other, np.float32(one))
                )
        for operation in (operator.neg, abs):
            assert bits(operation(stand_in.float32(one))) == bits(operation(np.float32(one)))
        assert bits(stand_in.float32(double)) == bits(np.float32(double))


@given(words=st.lists(WORDS, min_size=1, max_size=4), other=WORDS, shift=st.integers(0, 63))
def test_words_are_those_of_numpy(words, other, shift):
    table, word = stand_in.array([words]), stand_in.uint64(other)
    with np.errstate(over='ignore'):
        expected, number = np.array([words], np.uint64), np.uint64(other)
        for operation in WORD_OPERATIONS:
            assert operation(table, word).tolist() == operation(expected, number)[0].tolist()
            assert operation(word, table).tolist() == operation(number, expected)[0].tolist()
            assert operation(table, table).tolist() == operation(expected, expected)[0].tolist()
            assert operation(stand_in.uint64(words[0]), word) == operation(expected[0, 0], number)
        for operation in (operator.rshift, operator.lshift):
            found = operation(table, stand_in.uint64(shift)).tolist()
            assert found == operation(expected, np.uint64(shift))[0].tolist()
            assert operation(word, stand_in.uint64(shift)) == operation(number, np.uint64(shift))


def test_what_is_missing_says_so():
    with pytest.raises(AttributeError, match='linspace'):
        _ = stand_in.linspace
