"""Every kind of content can be created for every topic."""

import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import deserialize_message

from campaign.sender import MAKERS
from campaign.strangers import LOOP_TOPICS, OPEN_TOPICS, Content

KINDS = {topic.type_name: topic.message_class for topic in (*OPEN_TOPICS, *LOOP_TOPICS)}
BROKEN = {Content.HALF, Content.NOISE}


@pytest.mark.parametrize('kind', KINDS.values(), ids=KINDS)
def test_every_content_can_be_made_of_every_type(kind):
    assert set(MAKERS) == set(Content)
    for content, make in MAKERS.items():
        data = make(kind)
        assert data
        if content not in BROKEN:
            assert isinstance(deserialize_message(data, kind), kind)
