"""The participants of a domain, by their ports."""

import pytest
from graph import occupied

from ballbot_ros.nodes.presence import living_participants


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
