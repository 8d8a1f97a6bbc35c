"""Nodes find each other soon, also those that start at different times."""

import os
import socket
import time
from itertools import pairwise

import pytest
from graph import bound_s

from ballbot_ros.errors import BallbotError
from ballbot_ros.nodes.middleware import DOMAIN, PROFILES, prepare_middleware, ros_domain
from ballbot_ros.parameters import GYRO

INITIAL_ANNOUNCEMENTS = 6
LAST_PEER = 31


@pytest.mark.graph
def test_a_node_goes_on_to_tell_of_itself_four_times_a_second(domain, start_node, monkeypatch):
    monkeypatch.delenv(PROFILES)
    # Where a participant with that number would listen.
    port = 7400 + 250 * domain + 10 + 2 * LAST_PEER
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(('127.0.0.1', port))
        peer.settimeout(bound_s(20.0))
        start_node(GYRO)
        heard = []
        for _ in range(INITIAL_ANNOUNCEMENTS + 5):
            peer.recv(65536)
            heard.append(time.monotonic())
    gaps = [later - earlier for earlier, later in pairwise(heard[INITIAL_ANNOUNCEMENTS:])]
    assert max(gaps) < bound_s(0.5)


def test_profiles_of_the_user_stay(monkeypatch):
    monkeypatch.setenv(PROFILES, 'mine.xml')
    prepare_middleware()
    assert os.environ[PROFILES] == 'mine.xml'


@pytest.mark.parametrize('text', ['abc', '-1', '1e2', '233'])
def test_what_is_no_domain_is_told_before_ros_begins(text, monkeypatch):
    monkeypatch.setenv(DOMAIN, text)
    with pytest.raises(BallbotError, match=rf'^{DOMAIN}={text}: set a number within 0 … 232$'):
        prepare_middleware()


@pytest.mark.parametrize(('text', 'domain'), [('', 0), ('7', 7), ('232', 232)])
def test_the_domain_is_that_of_the_environment(text, domain, monkeypatch):
    monkeypatch.setenv(DOMAIN, text)
    assert ros_domain() == domain
