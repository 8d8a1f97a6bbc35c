"""The motor stop: a ``motor_duty`` of zero that answers no tick.

A run that does not complete ends with a motor stop, from the plant and from the controller if they
are still alive. Its frame_id distinguishes it from the answers to ticks, whose frame_id is empty.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.messages.conversions import fill_header
from ballbot_ros.messages.message_types import Vector3Stamped
from ballbot_ros.messages.outputs import Output
from ballbot_ros.recording.batch import Batch, Rows
from ballbot_ros.timing import TICK_NS

FRAME_ID = 'stop'

# In CDR, the frame_id follows four bytes of encoding and a stamp of eight bytes.
_BEGIN = 12
_ENCODED = struct.pack(f'<I{len(FRAME_ID) + 1}s', len(FRAME_ID) + 1, FRAME_ID.encode())


def fill_stop(message: Vector3Stamped, stamp_ns: int) -> None:
    """Write ``motor_duty``: from `stamp_ns` on the motors are off."""
    fill_header(message.header, stamp_ns, FRAME_ID)
    message.vector.x = message.vector.y = 0.0


def send_stop(output: Output, last_ns: int) -> None:
    """Publish that the motors are off from the tick after the last one."""
    stamp_ns = last_ns + TICK_NS
    fill_stop(output.message, stamp_ns)
    output.send(stamp_ns)


def is_stop(data: bytes) -> bool:
    """Return whether a serialised ``motor_duty`` is a motor stop."""
    return data[_BEGIN : _BEGIN + len(_ENCODED)] == _ENCODED


def are_stops(batch: Batch, rows: Rows) -> NDArray[np.bool_]:
    """Return which of some recorded ``motor_duty`` are motor stops."""
    return batch.match_bytes(rows, _BEGIN, _ENCODED)
