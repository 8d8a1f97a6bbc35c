"""Encoded texts, the simplest messages to write."""

from ballbot_ros.recording.schemas import encoder, new_message

STRING = 'std_msgs/msg/String'


def string(text):
    """Return a std_msgs/String as CDR."""
    message = new_message(STRING)
    message.data = text
    return encoder(STRING)(message)
