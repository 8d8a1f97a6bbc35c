"""Finding the robot in a recording, whatever namespace its nodes ran in."""

from __future__ import annotations

from collections.abc import Iterable

from ballbot_ros.messages.topics import Topic
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader


def robot_namespace(reader: RecordingReader, marks: Iterable[Topic]) -> str | None:
    """Return the namespace in which a recording has one of the topics `marks`.

    Returns
    -------
    str or None
        Such as ``/robot``, or '' where there is no namespace; None if it has none of the topics.

    Raises
    ------
    RecordingError
        If it has them in several namespaces.
    """
    endings = [f'/{mark.name}' for mark in marks]
    spaces = {
        name.removesuffix(ending)
        for name in reader.topics()
        for ending in endings
        if name.endswith(ending)
    }
    if len(spaces) > 1:
        names = ', '.join(sorted(space or '/' for space in spaces))
        raise RecordingError(f'{reader.path}: several robots: {names}; take one of them out')
    return next(iter(spaces), None)
