"""The Bluetooth packets, byte by byte."""

from dataclasses import asdict, replace

import pytest
from hypothesis import strategies as st
from laws import given

from ballbot_ros.robot.brick.bluetooth import LogPacket, PacketError

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
