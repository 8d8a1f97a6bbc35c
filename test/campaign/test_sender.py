"""Every kind of content can be created for every topic."""

import itertools

import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import deserialize_message

from campaign.sender import MAKERS
from campaign.strangers import LOOP_TOPICS, OPEN_TOPICS, Content

KINDS = {topic.message_class for topic in (*OPEN_TOPICS, *LOOP_TOPICS)}
BROKEN = {Content.HALF, Content.NOISE}


def test_every_content_can_be_made_of_every_type():
    assert set(MAKERS) == set(Content)
    for kind, (content, make) in itertools.product(KINDS, MAKERS.items()):
        data = make(kind)
        assert data, (kind, content)
        if content not in BROKEN:
            assert isinstance(deserialize_message(data, kind), kind), (kind, content)
