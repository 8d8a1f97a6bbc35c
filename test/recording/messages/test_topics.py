"""The types of the topics."""

import pytest

from ballbot_ros.recording.messages.topics import TOPICS, find_message_class

pytest.importorskip('rclpy')


def test_the_class_of_each_type_of_the_graph_is_found():
    for topic in TOPICS:
        assert find_message_class(topic.type_name) is topic.message_class, topic.name


def test_a_type_that_is_not_installed_or_not_a_message_has_no_class():
    """Any program may publish a topic of any type, and a recording may name one."""
    for name in (
        'nowhere/msg/Text', 'std_msgs/msg/Nothing', 'String', 'std_msgs/String', '', '//',
        '/msg/String', 'a/b/c/d',
    ):  # fmt: skip
        assert find_message_class(name) is None, name
