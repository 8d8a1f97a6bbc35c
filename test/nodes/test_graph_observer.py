"""What a node sees of the graph."""

import pytest
from graph import occupied

from ballbot_ros.nodes.graph_observer import GraphObserver
from ballbot_ros.nodes.middleware import DISCOVERY_RANGE, STATIC_PEERS
from ballbot_ros.parameters import GYRO

pytestmark = pytest.mark.graph


def test_discovery_is_complete_once_every_participant_of_this_machine_is_known(
    domain, client, start_node
):
    observer = GraphObserver(client.node, ())
    assert observer.is_complete()
    port = 7400 + 250 * domain + 10 + 2 * 20
    with occupied(port), occupied(port + 1):  # a participant that announces nothing
        assert not observer.is_complete()
    start_node(GYRO)
    client.spin_until(lambda: '/gyro_driver' in observer_names(client) and observer.is_complete())


def observer_names(client):
    return [f'{space}{name}' for name, space in client.node.get_node_names_and_namespaces()]


def test_it_cannot_be_known_to_be_complete_beyond_this_machine(client, monkeypatch):
    observer = GraphObserver(client.node, ())
    monkeypatch.setenv(STATIC_PEERS, '192.0.2.1')
    assert not observer.is_complete()
    monkeypatch.delenv(STATIC_PEERS)
    assert observer.is_complete()
    for value in ('SUBNET', 'SYSTEM_DEFAULT'):
        monkeypatch.setenv(DISCOVERY_RANGE, value)
        assert not observer.is_complete()
    monkeypatch.delenv(DISCOVERY_RANGE)
    assert not observer.is_complete()
