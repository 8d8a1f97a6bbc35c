"""The graph's topics in the form that the master of a run needs."""

from ballbot_ros.messages.raw import has_stamp, same_content
from ballbot_ros.messages.topics import (
    CLOCK,
    LOCKSTEP_PUBLISHERS,
    MOTOR_DUTY,
    PARTICIPANTS,
    PUSH,
    RECORDER_ACK,
)
from ballbot_ros.simulation.run_participants import RunTopics

RUN_TOPICS = RunTopics(
    clock=CLOCK.name,
    duty=MOTOR_DUTY.name,
    push=PUSH.name,
    ack=RECORDER_ACK.name,
    participants=PARTICIPANTS.name,
    owners={topic.name: roles for topic, roles in LOCKSTEP_PUBLISHERS.items()},
    stamped=frozenset(topic.name for topic in LOCKSTEP_PUBLISHERS if has_stamp(topic.type_name)),
    periodic=frozenset(topic.name for topic in LOCKSTEP_PUBLISHERS if topic.period_ns),
    is_same_duty=same_content(MOTOR_DUTY.type_name),
)
