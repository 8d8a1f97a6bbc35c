"""Every content can be made for every topic."""

import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import deserialize_message, serialize_message

from campaign.sender import MAKERS
from campaign.strangers import LOOP_TOPICS, OPEN_TOPICS, Content

KINDS = {topic.type_name: topic.message_class for topic in (*OPEN_TOPICS, *LOOP_TOPICS)}


@pytest.mark.parametrize('kind', KINDS.values(), ids=KINDS)
def test_every_content_can_be_sent(kind):
    assert set(MAKERS) == set(Content)
    for make in MAKERS.values():
        message = make(kind)
        if isinstance(message, bytes):
            assert message
        else:
            assert isinstance(deserialize_message(serialize_message(message), kind), kind)
