"""The participants that processes of this machine see before discovery."""

import itertools
import subprocess
import sys

from graph import wait_for

from ballbot_ros.nodes.presence import Presence, present_instances

OTHER_PROCESS = """
import sys
from ballbot_ros.nodes.presence import Presence
presence = Presence(int(sys.argv[1]), '/', 'cd')
print(flush=True)
sys.stdin.read()
"""


def test_a_participant_is_present_in_its_domain_and_namespace_until_it_is_closed(domain):
    places = list(itertools.product((domain, domain + 1000), ('/', '/a')))
    members = [Presence(*place, f'{index:032x}') for index, place in enumerate(places)]
    second = Presence(domain, '/', 'f' * 32)
    assert present_instances(domain, '/') == {'0' * 32, 'f' * 32}
    for index, place in enumerate(places):
        assert f'{index:032x}' in present_instances(*place)
        assert len(present_instances(*place)) == 1 + (index == 0)
    second.close()
    for member in members:
        member.close()
    assert [present_instances(*place) for place in places] == [set()] * 4


def test_a_killed_process_is_not_present(domain):
    with subprocess.Popen(
        [sys.executable, '-c', OTHER_PROCESS, str(domain)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    ) as process:  # fmt: skip
        process.stdout.readline()
        assert present_instances(domain, '/') == {'cd'}
        process.kill()
    wait_for(lambda: not present_instances(domain, '/'), what='the end of its presence')


def test_a_long_namespace_is_possible(domain):
    namespace = '/robot' * 40
    presence = Presence(domain, namespace, '0' * 32)
    assert present_instances(domain, namespace) == {'0' * 32}
    assert present_instances(domain, namespace[:-1]) == set()
    presence.close()
