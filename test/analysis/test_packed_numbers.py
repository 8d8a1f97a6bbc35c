"""Columns of numbers packed for a page."""

import gzip

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given
from packed_columns import unpacked

from ballbot_ros.analysis.interactive import STEPS, PackedNumbers

NUMBERS = st.one_of(st.floats(-1e6, 1e6), st.just(np.nan), st.just(np.inf))


@given(st.lists(st.lists(NUMBERS, max_size=30), max_size=4))
def test_every_column_comes_back_to_half_a_step_and_what_is_no_number_as_nan(lists):
    packed = PackedNumbers()
    columns = [np.array(values, float) for values in lists]
    placed = [packed.add(column) for column in columns]
    for column, place in zip(columns, placed, strict=True):
        back = unpacked(packed, place)
        known = np.isfinite(column)
        assert np.isnan(back[~known]).all()
        step = np.ptp(column[known]) / STEPS if known.any() else 0.0
        assert np.allclose(back[known], column[known], rtol=1e-9, atol=0.501 * step)


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=30))
def test_the_extremes_come_back(values):
    packed = PackedNumbers()
    back = unpacked(packed, packed.add(np.array(values)))
    assert (back.min(), back.max()) == pytest.approx((min(values), max(values)), rel=1e-9)


@given(st.lists(st.integers(0, 2**30 - 1), max_size=30))
def test_whole_numbers_come_back_exactly(values):
    packed = PackedNumbers()
    placed = packed.add_whole(np.array(values, np.int64))
    high, low = (unpacked(packed, each) for each in placed)
    assert (32768 * np.rint(high) + np.rint(low)).tolist() == values


def test_equal_columns_are_kept_once():
    packed = PackedNumbers()
    time = np.arange(100) * 0.004
    assert packed.add(time) == packed.add(time.copy())
    assert len(gzip.decompress(packed.compressed())) == 200
