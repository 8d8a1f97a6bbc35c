"""The participants that processes of this machine see before discovery."""

import contextlib
import itertools
import os
import socket
import subprocess
import sys

from graph import wait_for

from ballbot_ros.lockstep.participants import LocalNode
from ballbot_ros.nodes.middleware import Presence, present_nodes

OTHER_PROCESS = """
import sys
from ballbot_ros.nodes.middleware import Presence
presence = Presence(int(sys.argv[1]), '/', 'gyro_driver', 'cd')
print(flush=True)
sys.stdin.read()
"""
HERE = LocalNode('gyro_driver', os.getpid())


def presence_of(domain, namespace, instance):
    return Presence(domain, namespace, HERE.role, instance)


def test_a_participant_is_present_in_its_domain_and_namespace_until_it_is_closed(domain):
    places = list(itertools.product((domain, domain + 1000), ('/', '/a')))
    members = [presence_of(*place, f'{index:032x}') for index, place in enumerate(places)]
    second = presence_of(domain, '/', 'f' * 32)
    assert present_nodes(domain, '/') == {'0' * 32: HERE, 'f' * 32: HERE}
    for index, place in enumerate(places):
        assert f'{index:032x}' in present_nodes(*place)
        assert len(present_nodes(*place)) == 1 + (index == 0)
    second.close()
    for member in members:
        member.close()
    assert [present_nodes(*place) for place in places] == [{}] * 4


def test_a_killed_process_is_not_present(domain):
    with subprocess.Popen(
        [sys.executable, '-c', OTHER_PROCESS, str(domain)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    ) as process:  # fmt: skip
        process.stdout.readline()
        assert present_nodes(domain, '/') == {'cd': LocalNode('gyro_driver', process.pid)}
        process.kill()
    wait_for(lambda: not present_nodes(domain, '/'), what='the end of its presence')


def test_a_long_namespace_is_possible(domain):
    namespace = '/robot' * 40
    presence = presence_of(domain, namespace, '0' * 32)
    assert present_nodes(domain, namespace) == {'0' * 32: HERE}
    assert present_nodes(domain, namespace[:-1]) == {}
    presence.close()


def test_a_foreign_socket_may_have_any_name(domain):
    with contextlib.closing(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)) as foreign:
        foreign.bind(f'\0{domain}'.encode() + b'\xff')
        assert present_nodes(domain, '/') == {}
