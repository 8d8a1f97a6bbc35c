"""Keeping a new participant off the ports of dead ones."""

import fcntl
import signal
from pathlib import Path

import pytest
from graph import occupied, wait_for

from ballbot_ros.nodes.participant_ports import (
    MAX_AVOIDED_PARTICIPANTS,
    avoid_stale_ports,
    living_participants,
    stale_participants,
)


@pytest.fixture
def first(domain):
    """Return a domain's first port; RTPS adds 10 and 11 + 2 * its number for each participant."""
    return 7400 + 250 * domain


def make_port(folder, port, lock='_el'):
    (folder / f'fastrtps_port{port}').write_bytes(b'a port')
    if lock:
        (folder / f'fastrtps_port{port}{lock}').touch()


def can_bind(port):
    try:
        with occupied(port):
            return True
    except OSError:
        return False


def test_a_participant_lives_as_long_as_it_holds_both_its_ports(domain, first):
    assert living_participants(domain) == []
    with occupied(first + 12), occupied(first + 13), occupied(first + 17), occupied(first + 18):
        assert living_participants(domain) == [1]
        with occupied(first + 16):
            assert living_participants(domain) == [1, 3]
    assert living_participants(domain) == []


def test_a_port_that_nobody_has_locked_is_stale(domain, first, tmp_path):
    make_port(tmp_path, first + 11)
    make_port(tmp_path, first + 15, '_sl')
    make_port(tmp_path, first + 19, lock='')
    make_port(tmp_path, first + 17)
    with (tmp_path / f'fastrtps_port{first + 17}_el').open() as living:
        fcntl.flock(living, fcntl.LOCK_EX)
        assert stale_participants(domain, tmp_path) == [0, 2, 4]
    assert stale_participants(domain, tmp_path) == [0, 2, 3, 4]


def test_ports_that_are_not_a_participants_are_ignored(domain, first, tmp_path):
    make_port(tmp_path, first + 12)
    make_port(tmp_path, first + 11 + 250)
    make_port(tmp_path, 7003)
    (tmp_path / f'fastrtps_port{first + 13}_el').touch()
    (tmp_path / 'fastrtps_0123456789abcdef').touch()
    (tmp_path / 'fastrtps_0123456789abcdef_el').touch()
    assert stale_participants(domain, tmp_path) == []
    assert stale_participants(domain, tmp_path / 'missing') == []


def test_the_numbers_of_dead_participants_are_occupied_within_the_block(domain, first, tmp_path):
    make_port(tmp_path, first + 13)
    with avoid_stale_ports(domain, tmp_path):
        assert not can_bind(first + 12)
        assert can_bind(first + 10)
        assert can_bind(first + 14)
    assert can_bind(first + 12)


def test_two_processes_that_start_together_share_the_occupied_numbers(domain, first, tmp_path):
    make_port(tmp_path, first + 13)
    with avoid_stale_ports(domain, tmp_path):
        with avoid_stale_ports(domain, tmp_path):
            pass
        assert not can_bind(first + 12)
    # A port in use need not be occupied.
    with occupied(first + 12), avoid_stale_ports(domain, tmp_path):
        pass


def test_enough_numbers_remain_free(domain, first, tmp_path):
    for number in range(MAX_AVOIDED_PARTICIPANTS + 1):
        make_port(tmp_path, first + 11 + 2 * number)
    with avoid_stale_ports(domain, tmp_path):
        assert not can_bind(first + 10 + 2 * (MAX_AVOIDED_PARTICIPANTS - 1))
        assert can_bind(first + 10 + 2 * MAX_AVOIDED_PARTICIPANTS)


def participant_number(node, domain):
    """The number of a node's participant as text, by the threads that read its ports."""
    first = 7400 + 250 * domain + 10
    found = set()
    for thread in Path(f'/proc/{node.process.pid}/task').iterdir():
        name = (thread / 'comm').read_text().strip()
        if name.startswith('dds.udp.'):
            port = int(name.removeprefix('dds.udp.'))
            if first <= port < first + 240:
                found.add((port - first) // 2)
    return str(min(found)) if found else ''


@pytest.mark.graph
def test_a_restarted_node_takes_another_number_than_the_killed_one(domain, first, start_node):
    pytest.importorskip('rclpy')
    nodes = [start_node(name) for name in ('gyro_driver', 'encoder_driver')]
    numbers = [
        wait_for(lambda node=node: participant_number(node, domain), what='its participant')
        for node in nodes
    ]
    port = f'fastrtps_port{first + 11 + 2 * int(numbers[0])}'
    maps = Path(f'/proc/{nodes[1].process.pid}/maps')
    wait_for(lambda: port in maps.read_text(), what='that somebody writes to its port')
    # Otherwise it might notice in time that the port has no reader any more.
    nodes[1].process.send_signal(signal.SIGSTOP)
    nodes[0].kill()
    again = start_node('gyro_driver')
    number = wait_for(lambda: participant_number(again, domain), what='its participant')
    assert number not in numbers
