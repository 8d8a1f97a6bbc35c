"""Packed numbers as the page reads them."""

import gzip

import numpy as np

from ballbot_ros.analysis.interactive import STEPS


def unpacked(numbers, column):
    offset, length, low, high = column
    data = np.frombuffer(gzip.decompress(numbers.compressed()), np.uint8)
    data = data[offset : offset + 2 * length]
    steps = np.cumsum(data[:length] + 256 * data[length:].astype(np.int64)) & 0xFFFF
    values = low + (high - low) * steps / STEPS
    return np.where(steps == STEPS + 1, np.nan, values)
