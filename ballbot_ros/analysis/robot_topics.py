"""The topics of the robot in a recording, whatever its namespace."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ballbot_ros.messages.topics import MOTOR_DUTY, TOPICS, Topic
from ballbot_ros.recording.errors import RecordingError
from ballbot_ros.recording.reader import RecordingReader

ROBOT_MARKS = (
    MOTOR_DUTY,
    *(topic for topic in TOPICS if topic.name.startswith(('plant/', 'controller/'))),
)
"""The topics by which a robot's namespace is found: only this robot has such names."""


@dataclass(frozen=True)
class RobotTopics:
    """The robot's topics in a recording.

    Attributes
    ----------
    namespace : str
        Such as ``/robot``; '' where there is no namespace.
    by_name : mapping of str to Topic
        Those that the file has, by the names that they have there.
    mistyped : mapping of str to str
        Which of them are of another type than the robot's, and of which.
    """

    namespace: str
    by_name: Mapping[str, Topic]
    mistyped: Mapping[str, str]

    @property
    def usable(self) -> dict[str, Topic]:
        """Those of the robot's types, by name."""
        return {n: topic for n, topic in self.by_name.items() if n not in self.mistyped}

    def mismatch(self, name: str) -> str:
        """Say what is wrong with the type of one that is mistyped."""
        return f'{name} is {self.mistyped[name]}, not {self.by_name[name].type_name}'


def robot_topics(reader: RecordingReader) -> RobotTopics:
    """Find the robot's topics in a recording, whatever namespace its nodes ran in.

    Raises
    ------
    RecordingError
        If it is no recording of this robot, or one of several robots.
    """
    # Where there are duties, what else is called plant/… may be a stranger's.
    namespace = robot_namespace(reader, [MOTOR_DUTY])
    if namespace is None:
        namespace = robot_namespace(reader, ROBOT_MARKS)
    if namespace is None:
        raise RecordingError(
            f'{reader.path}: no recording of a ballbot: it has none of '
            f'{", ".join(mark.resolved() for mark in ROBOT_MARKS)}'
        )
    ours = {topic.resolved(namespace): topic for topic in TOPICS}
    types = {name: each.type_name for name, each in reader.topics().items() if name in ours}
    return RobotTopics(
        namespace,
        {name: ours[name] for name in types},
        {name: found for name, found in types.items() if found != ours[name].type_name},
    )


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
