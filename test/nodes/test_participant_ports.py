"""The participants of a domain, by their ports."""

import pytest
from graph import occupied

from ballbot_ros.nodes import middleware as presence
from ballbot_ros.nodes.middleware import living_participants


@pytest.fixture
def first(domain):
    """Return a domain's first port; RTPS adds 10 and 11 + 2 * its number for each participant."""
    return 7400 + 250 * domain


def test_a_participant_lives_as_long_as_it_holds_both_its_ports(domain, first):
    assert living_participants(domain) == []
    with occupied(first + 12), occupied(first + 13), occupied(first + 17), occupied(first + 18):
        assert living_participants(domain) == [1]
        with occupied(first + 16):
            assert living_participants(domain) == [1, 3]
    assert living_participants(domain) == []


def test_a_socket_that_a_reading_of_the_system_s_table_misses_counts(domain, first, monkeypatch):
    """The table comes in parts: a socket that closes meanwhile hides another one."""
    read, hidden = presence._read_sockets, iter([first + 10, first + 11, first + 12])

    def incomplete(table, size):
        missing = f':{next(hidden):04X} '
        return [line for line in read(table, size) if missing not in line]

    with occupied(first + 10), occupied(first + 11):
        monkeypatch.setattr(presence, '_read_sockets', incomplete)
        assert living_participants(domain) == [0]
