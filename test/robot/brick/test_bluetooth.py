"""The Bluetooth packets, byte by byte."""

import random
from dataclasses import asdict, replace
from itertools import cycle
from statistics import median_low

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.robot.brick.bluetooth import (
    FRAME_SIZE,
    LENGTH,
    LogPacket,
    LogStream,
    PacketError,
    stick_frame,
    sticks_in,
)
from ballbot_ros.robot.brick.sensors import NO_DATA_CM, NO_ECHO_CM

# The data logger's record: offset, size, signed.
LAYOUT = {
    'time_ms': (0, 4, False),
    'data1': (4, 1, True),
    'data2': (5, 1, True),
    'battery_mv': (6, 2, False),
    'rev_a': (8, 4, True),
    'rev_b': (12, 4, True),
    'rev_c': (16, 4, True),
    'adc1': (20, 2, True),
    'adc2': (22, 2, True),
    'adc3': (24, 2, True),
    'adc4': (26, 2, True),
    'sonar_cm': (28, 4, True),
}
NOTHING = dict.fromkeys(LAYOUT, 0)


def bounds(size, signed):
    bits = 8 * size
    return (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)


log_packets = st.builds(
    LogPacket,
    **{name: st.integers(*bounds(size, signed)) for name, (_, size, signed) in LAYOUT.items()},
)


def test_a_log_packet_in_bytes():
    packet = LogPacket(
        time_ms=0x04030201,
        data1=-2,
        data2=6,
        battery_mv=8005,
        rev_a=0,
        rev_b=-1,
        rev_c=360,
        adc1=4096,
        adc2=-4096,
        adc3=0,
        adc4=1,
        sonar_cm=-1,
    )
    assert packet.encode().hex(' ') == (
        '01 02 03 04 fe 06 45 1f 00 00 00 00 ff ff ff ff '
        '68 01 00 00 00 10 00 f0 00 00 01 00 ff ff ff ff'
    )


@given(log_packets)
def test_log_packets_come_back(packet):
    assert LogPacket.decode(packet.encode()) == packet


@given(log_packets)
def test_every_field_is_at_its_offset(packet):
    data = packet.encode()
    read = {
        name: int.from_bytes(data[offset : offset + size], 'little', signed=signed)
        for name, (offset, size, signed) in LAYOUT.items()
    }
    assert read == asdict(packet)


@given(st.binary(min_size=32, max_size=32))
def test_any_32_bytes_are_a_log_packet_without_a_spare_bit(data):
    assert LogPacket.decode(data).encode() == data


@pytest.mark.parametrize('name', LAYOUT)
def test_a_value_beyond_its_field_is_refused_in_one_line(name):
    _, size, signed = LAYOUT[name]
    low, high = bounds(size, signed)
    for value in (low, high):
        replace(LogPacket(**NOTHING), **{name: value}).encode()
    for value in (low - 1, high + 1, 0.5, None):
        with pytest.raises(PacketError, match=r'^[^\n]+$'):
            replace(LogPacket(**NOTHING), **{name: value}).encode()


@pytest.mark.parametrize('size', [0, 31, 33, 34])
def test_another_number_of_bytes_is_refused(size):
    with pytest.raises(PacketError, match=f'32 bytes, not {size}'):
        LogPacket.decode(bytes(size))


def test_sticks_in_bytes():
    """Bytes 0 and 1 of 32, after the length (facts, section 4)."""
    frame = stick_frame((-100, 100))
    assert frame == b'\x20\x00\x9c\x64' + bytes(30)
    assert sticks_in(frame[2:]) == (-100, 100)


def packets_of(steps, start_ms=1000):
    """Return packets, one per step [ms], of a robot that rolls."""
    found, time_ms = [], start_ms
    for number, step_ms in enumerate(steps):
        time_ms += step_ms
        sonar = (NO_ECHO_CM, 32, NO_DATA_CM, 30)[number % 4]
        found.append(
            LogPacket(
                time_ms % 2**32, 0, 0, 8000 - number % 50, 0, time_ms // 40, -time_ms // 60,
                number * 37 % 4000 - 2000, number * 91 % 3000 - 1500, 0, 0, sonar,
            )
        )  # fmt: skip
    return found


def frame(packet):
    return LENGTH + packet.encode()


def received(stream, data, sizes=(50,)):
    """Feed bytes in pieces of these sizes, again and again, and end; return the packets."""
    found, at, pieces = [], 0, cycle(sizes)
    while at < len(data):
        size = next(pieces)
        found += stream.feed(data[at : at + size])
        at += size
    return found + stream.end()


@given(
    st.lists(st.integers(4, 2000), min_size=1, max_size=30),
    st.lists(st.integers(1, 100), min_size=1, max_size=8),
    st.integers(0, 2**32 - 1),
)
def test_packets_arrive_in_pieces_of_any_size(steps, sizes, start_ms):
    packets, stream = packets_of(steps, start_ms), LogStream()
    assert received(stream, b''.join(map(frame, packets)), sizes) == packets
    assert (stream.packets, stream.skipped_bytes) == (len(packets), 0)
    assert stream.period_ms == (median_low(steps[1:][-9:]) if steps[1:] else 0)


def damage(draw, data):
    """Return a packet with a lost, wrong or additional byte, or cut off, or gone."""
    kind, at = draw.choice(('lost', 'wrong', 'more', 'cut', 'gone')), draw.randrange(FRAME_SIZE)
    if kind == 'lost':
        return data[:at] + data[at + 1 :]
    if kind == 'wrong':
        return data[:at] + bytes([data[at] ^ 1 << draw.randrange(8)]) + data[at + 1 :]
    if kind == 'more':
        return data[: at + 1] + draw.randbytes(draw.randrange(1, 40)) + data[at + 1 :]
    return data[:at] if kind == 'cut' else b''


@pytest.mark.parametrize('seed', range(50))
def test_a_corrupted_stream_loses_nothing_that_arrived_intact(seed):
    draw = random.Random(seed)
    packets, intact = packets_of([100] * 200, draw.randrange(2**32)), []
    data = draw.randbytes(draw.randrange(100))
    for packet in packets:
        if draw.random() < 0.15:
            data += damage(draw, frame(packet))
        else:
            data += frame(packet)
            intact.append(packet)
    stream = LogStream()
    found = received(stream, data, [draw.randrange(1, 90) for _ in range(7)])
    assert [packet for packet in found if packet in intact] == intact
    assert stream.packets == len(found)
    assert stream.packets * FRAME_SIZE + stream.skipped_bytes == len(data)


def test_a_lost_byte_costs_one_packet_and_is_counted():
    packets, stream = packets_of([100] * 9), LogStream()
    frames = [*map(frame, packets)]
    frames[4] = frames[4][:10] + frames[4][11:]
    assert received(stream, b''.join(frames)) == packets[:4] + packets[5:]
    assert (stream.skipped_bytes, stream.lost_packets) == (FRAME_SIZE - 1, 1)


def test_a_wrong_clock_and_another_period_are_no_losses():
    packets, stream = packets_of([20] * 30 + [100] * 30), LogStream()
    packets[20] = replace(packets[20], time_ms=packets[20].time_ms + 16)
    assert received(stream, b''.join(map(frame, packets))) == packets
    assert stream.lost_packets <= 20  # until most of the last steps are the new ones
    packets, stream = packets_of([100] * 60), LogStream()
    packets[20] = replace(packets[20], time_ms=packets[20].time_ms + 64)
    assert received(stream, b''.join(map(frame, packets))) == packets
    assert (stream.lost_packets, stream.period_ms) == (0, 100)


def test_a_packet_cut_off_does_not_take_the_next_one_with_it():
    """Its end would be the beginning of the next one, which looks possible where both are zero."""
    packets = packets_of([100] * 6)
    for size in range(FRAME_SIZE):
        frames = [*map(frame, packets)]
        frames[3] = frames[3][:size]
        assert received(LogStream(), b''.join(frames)) == packets[:3] + packets[4:]


def test_a_clock_that_starts_again_is_believed_once_two_packets_agree():
    before, after, stream = packets_of([100] * 5, 60_000), packets_of([100] * 3, 2000), LogStream()
    assert stream.feed(b''.join(map(frame, before))) == before
    assert stream.feed(frame(after[0])) == []
    assert stream.feed(frame(after[2])) == [after[0], after[2]]


def test_a_flood_without_packets_is_forgotten():
    noise = random.Random(1).randbytes(2**20)
    stream = LogStream()
    assert received(stream, noise, (4096,)) == []
    assert (stream.packets, stream.skipped_bytes) == (0, len(noise))
    assert stream.feed(frame(packets_of([100])[0])) == packets_of([100])
