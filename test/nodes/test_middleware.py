"""Nodes find each other soon, also those that start at different times."""

import os
import socket
import time
from itertools import pairwise

import pytest
from graph import bound_s

from ballbot_ros.nodes.middleware import PROFILES, prepare_middleware
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
