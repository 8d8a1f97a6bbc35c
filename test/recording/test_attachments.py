"""Media types of attached files."""

from ballbot_ros.recording.rosbag2 import MAPS, SCENARIO, media_type


def test_the_media_type_follows_from_the_ending():
    for name, expected in (
        (SCENARIO, 'application/yaml'),
        *zip(MAPS, ('image/png', 'image/bmp'), strict=True),
        ('MAP.PNG', 'image/png'),
        ('notes.txt', 'application/octet-stream'),
        ('notes', 'application/octet-stream'),
    ):
        assert media_type(name) == expected, name
