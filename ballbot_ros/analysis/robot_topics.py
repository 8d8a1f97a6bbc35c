"""The robot's topics in a recording, in any namespace."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ballbot_ros.errors import RecordingError
from ballbot_ros.recording.messages.topics import MOTOR_DUTY, TOPICS, UNRECORDED, Topic
from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.schemas import typestore

IDENTIFYING_TOPICS = (
    MOTOR_DUTY,
    *(
        topic
        for topic in TOPICS
        if topic.name.startswith(('plant/', 'controller/')) and topic not in UNRECORDED
    ),
)
"""Topics that identify the robot's namespace, since no other robot has them."""


@dataclass(frozen=True)
class RobotTopics:
    """The robot's topics in a recording, by full name; its namespace is such as ``/robot``, or ''.

    `wrong_types` are the recorded types of topics that should have another type.
    """

    namespace: str
    by_name: Mapping[str, Topic]
    wrong_types: Mapping[str, str]

    @property
    def well_typed(self) -> dict[str, Topic]:
        """The topics with the correct type, by name."""
        return {n: topic for n, topic in self.by_name.items() if n not in self.wrong_types}

    def mismatch(self, name: str) -> str:
        """Return a text about the wrong type of a topic."""
        return f'{name} is {self.wrong_types[name]}, not {self.by_name[name].type_name}'


def robot_topics(reader: RecordingReader) -> RobotTopics:
    """Find the robot's topics in a recording, in any namespace.

    Raises
    ------
    RecordingError
        If the recording has the topics of no ballbot, or of several.
    """
    # Search for duties first: topics named plant/… may come from other programs.
    namespace = robot_namespace(reader, [MOTOR_DUTY])
    if namespace is None:
        namespace = robot_namespace(reader, IDENTIFYING_TOPICS)
    if namespace is None:
        damage = f'{reader.damage}, and the rest is ' if reader.damage else ''
        raise RecordingError(
            f'{reader.path}: {damage}not a recording of a ballbot: it has none of the topics '
            f'{", ".join(mark.resolved() for mark in IDENTIFYING_TOPICS)}'
        )
    ours = {topic.resolved(namespace): topic for topic in TOPICS}
    types = {name: each.type_name for name, each in reader.topics().items() if name in ours}
    unreadable = reader.unreadable()
    for name in types:
        if name in unreadable or reader.typestore(name) is not typestore():
            types[name] += ' in another definition or encoding'
    return RobotTopics(
        namespace,
        {name: ours[name] for name in types},
        {name: found for name, found in types.items() if found != ours[name].type_name},
    )


def robot_namespace(reader: RecordingReader, marks: Iterable[Topic]) -> str | None:
    """Return the namespace of the topics `marks` in a recording; None if it has none of them.

    The namespace is such as ``/robot``, or '' for none.

    Raises
    ------
    RecordingError
        If several namespaces have such topics.
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
        raise RecordingError(
            f'{reader.path}: recording of several robots, in the namespaces {names}; '
            'only one is supported'
        )
    return next(iter(spaces), None)
