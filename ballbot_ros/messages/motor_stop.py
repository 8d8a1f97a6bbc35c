"""The motor stop: a ``motor_duty`` of zero that answers no tick.

A run that does not complete ends with a motor stop, from the plant and from the controller if they
are still alive. Its frame_id distinguishes it from the answers to ticks, whose frame_id is empty.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.messages.layout import MessageLayout
from ballbot_ros.messages.topics import MOTOR_DUTY
from ballbot_ros.recording.batch import Batch, Rows

FRAME_ID = 'stop'

_LAYOUT = MessageLayout(MOTOR_DUTY.type_name, constants={'header.frame_id': FRAME_ID})

# In CDR, the frame_id follows four bytes of encoding and a stamp of eight bytes.
_BEGIN = 12
_ENCODED = struct.pack(f'<I{len(FRAME_ID) + 1}s', len(FRAME_ID) + 1, FRAME_ID.encode())


def encode_stop(stamp_ns: int) -> bytes:
    """Return a motor stop: from `stamp_ns` on the motors are off."""
    return _LAYOUT.encode(stamp_ns)


def is_stop(data: bytes) -> bool:
    """Return whether a serialised ``motor_duty`` is a motor stop."""
    return data[_BEGIN : _BEGIN + len(_ENCODED)] == _ENCODED


def are_stops(batch: Batch, rows: Rows) -> NDArray[np.bool_]:
    """Return which of some recorded ``motor_duty`` are motor stops."""
    return batch.match_bytes(rows, _BEGIN, _ENCODED)
