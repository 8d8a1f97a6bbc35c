"""The table of the graph's topics: name, type, period and publisher."""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

from ballbot_ros.lockstep.run_participants import RunTopics
from ballbot_ros.parameters import (
    CONTROLLER,
    DRIVERS,
    NODES,
    PLANT,
    RECORDER,
    SUPERVISOR,
    VISUALIZER,
    DriverParameters,
    EncoderParameters,
    GamepadParameters,
    GyroParameters,
    SonarParameters,
)
from ballbot_ros.parameters.timing import BATTERY_PERIOD_NS, TICK_NS
from ballbot_ros.recording.messages.raw import has_stamp, same_content

HISTORY = 128
"""Depth of a publisher's history: the plant is at most
:data:`~ballbot_ros.parameters.timing.MAX_LEAD_TICKS` ahead of the recorder."""


class Topic(NamedTuple):
    """A topic of the graph.

    Attributes
    ----------
    name : str
        Relative, except for ``/clock`` and ``/diagnostics``.
    type_name : str
        ``package/msg/Type``.
    publisher : str or None
        The only node that publishes it; None if several may.
    period_ns : int
        In lockstep, period of its messages [ns]; 0 for a topic of events.
    latched_depth : int
        Number of messages that a publisher keeps for late subscribers: usually 1 for a state, which
        holds until the next message, and 0 for a stream or for events.
    has_history : bool
        Whether the messages are also published on :attr:`history`, from which the recorder reads
        them: the recorder needs more than the newest state, and events are never sent again.
    """

    name: str
    type_name: str
    publisher: str | None
    period_ns: int = 0
    latched_depth: int = 0
    has_history: bool = False

    @property
    def history(self) -> Topic:
        """The hidden topic that keeps the newest :data:`HISTORY` messages for late subscribers."""
        return self._replace(name=f'{self.name}/_history', latched_depth=HISTORY, has_history=False)

    @property
    def message_class(self) -> Any:
        """The rclpy message class."""
        return message_class(self.type_name)

    def resolved(self, namespace: str = '') -> str:
        """Return the name in the graph and in recordings; `namespace` is '' or like ``/robot``."""
        return self.name if self.name.startswith('/') else f'{namespace}/{self.name}'


def _samples_of(driver: type[DriverParameters], name: str, type_name: str) -> Topic:
    """Return the topic of a driver's samples."""
    return Topic(name, type_name, driver.node, driver.period_ns)


def _state(name: str, type_name: str, publisher: str, period_ns: int = 0) -> Topic:
    """Return the topic of a state that is recorded with its changes."""
    return Topic(name, type_name, publisher, period_ns, latched_depth=1, has_history=True)


CLOCK = Topic('/clock', 'rosgraph_msgs/msg/Clock', PLANT, TICK_NS)
RUN = _state('plant/run', 'std_msgs/msg/Header', PLANT)
ROLL_CALL = _state('plant/roll_call', 'std_msgs/msg/Header', PLANT)
RUN_STATUS = _state('plant/run_status', 'diagnostic_msgs/msg/DiagnosticStatus', PLANT)
PARTICIPANTS = Topic(
    'participants', 'diagnostic_msgs/msg/DiagnosticStatus', None, latched_depth=HISTORY
)
PLANT_JOINT_STATES = Topic('plant/joint_states', 'sensor_msgs/msg/JointState', PLANT, TICK_NS)
PLANT_IMU = Topic('plant/imu', 'sensor_msgs/msg/Imu', PLANT, TICK_NS)
PLANT_ODOM = Topic('plant/odom', 'nav_msgs/msg/Odometry', PLANT, TICK_NS)
PLANT_STEPS = Topic('plant/steps', 'sensor_msgs/msg/PointCloud2', PLANT)
PLANT_SLOW_ODOM = PLANT_ODOM._replace(name='plant/odom/_slow', period_ns=0)
UNRECORDED = (PLANT_STEPS, PLANT_SLOW_ODOM)
"""What only the drivers read: the physics steps, through which a replay moves the plant again, and
every fifth odometry, for those that have a sample only every 20 ms."""

BATTERY_STATE = _state('battery_state', 'sensor_msgs/msg/BatteryState', PLANT, BATTERY_PERIOD_NS)
WALL_HIT = _state('wall_hit', 'std_msgs/msg/Bool', PLANT)
MAP = Topic('map', 'nav_msgs/msg/OccupancyGrid', PLANT, latched_depth=1)
PUSH = Topic('plant/push', 'geometry_msgs/msg/WrenchStamped', None)
ACCEPTED_PUSH = Topic(
    'plant/accepted_push', 'geometry_msgs/msg/WrenchStamped', PLANT, has_history=True
)
GYRO_IMU = _samples_of(GyroParameters, 'gyro', 'sensor_msgs/msg/Imu')
JOINT_STATES = _samples_of(EncoderParameters, 'joint_states', 'sensor_msgs/msg/JointState')
SONAR_RANGE = _samples_of(SonarParameters, 'sonar', 'sensor_msgs/msg/Range')
GAMEPAD_JOY = _samples_of(GamepadParameters, 'gamepad', 'sensor_msgs/msg/Joy')
SCENARIO = 'scenario'
"""The source of the sticks that acts while no live input is in command."""

JOY = Topic('joy', 'sensor_msgs/msg/Joy', None)
VIEWER_JOY = Topic('viewer/joy', 'sensor_msgs/msg/Joy', None)
CMD_VEL = Topic('cmd_vel', 'geometry_msgs/msg/Twist', None)
CMD_VEL_STAMPED = Topic('cmd_vel', 'geometry_msgs/msg/TwistStamped', None)
MOTOR_DUTY = Topic('motor_duty', 'geometry_msgs/msg/Vector3Stamped', CONTROLLER, TICK_NS)
CONTROLLER_STATE = Topic('controller/state', 'sensor_msgs/msg/JointState', CONTROLLER, TICK_NS)
OPERATING_STATE = _state('operating_state', 'std_msgs/msg/String', CONTROLLER)
PARAMETER_EVENTS = Topic(
    'controller/parameter_events', 'rcl_interfaces/msg/ParameterEvent', CONTROLLER, has_history=True
)
BLUETOOTH_TX = Topic('bluetooth/tx', 'std_msgs/msg/UInt8MultiArray', CONTROLLER, has_history=True)
SOUND = Topic('sound', 'geometry_msgs/msg/Vector3Stamped', CONTROLLER, has_history=True)
LCD = _state('lcd', 'std_msgs/msg/String', CONTROLLER)
BRICK_TASKS = Topic('brick/tasks', 'std_msgs/msg/Int64MultiArray', CONTROLLER, has_history=True)
RECORDER_ACK = Topic('recorder/ack', 'std_msgs/msg/Header', RECORDER)
DIAGNOSTICS = Topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', None)
ROBOT_DESCRIPTION = Topic('robot_description', 'std_msgs/msg/String', VISUALIZER, latched_depth=1)
MARKERS = Topic('markers', 'visualization_msgs/msg/MarkerArray', VISUALIZER, latched_depth=1)
ODOM = Topic('odom', 'nav_msgs/msg/Odometry', VISUALIZER)
IMU_DATA = Topic('imu/data', 'sensor_msgs/msg/Imu', VISUALIZER)
SESSION = Topic('supervisor/session', 'std_msgs/msg/String', SUPERVISOR, latched_depth=1)
TF = Topic('/tf', 'tf2_msgs/msg/TFMessage', None)
TF_STATIC = Topic('/tf_static', 'tf2_msgs/msg/TFMessage', None, latched_depth=1)

TOPICS = (
    RUN, ROLL_CALL, RUN_STATUS, MAP,
    CLOCK, BATTERY_STATE, PLANT_IMU, PLANT_JOINT_STATES, PLANT_ODOM, *UNRECORDED, WALL_HIT,
    PUSH, ACCEPTED_PUSH,
    GYRO_IMU, JOINT_STATES, SONAR_RANGE, GAMEPAD_JOY,
    OPERATING_STATE, BLUETOOTH_TX, SOUND, LCD, BRICK_TASKS, MOTOR_DUTY, CONTROLLER_STATE,
    PARAMETER_EVENTS,
    RECORDER_ACK, PARTICIPANTS, DIAGNOSTICS,
)  # fmt: skip
"""The topics that the graph itself publishes, in the order of a tick. The recorder
discovers the inputs for driving, since their publishers choose the quality of service, and for
``cmd_vel`` even the type."""

CONTROLLER_TOPICS = (
    PARAMETER_EVENTS, MOTOR_DUTY, CONTROLLER_STATE, OPERATING_STATE, BLUETOOTH_TX, SOUND, LCD,
    BRICK_TASKS,
)  # fmt: skip
REPLAYED_TOPICS = (
    MAP, ACCEPTED_PUSH, CLOCK, PLANT_IMU, PLANT_JOINT_STATES, PLANT_ODOM, BATTERY_STATE, WALL_HIT,
    *(topic for topic in TOPICS if topic.publisher in DRIVERS), *CONTROLLER_TOPICS,
)  # fmt: skip
"""What a replay compares, in the order in which a tick causes the messages."""

_OF_THE_LOOP = (RUN, ROLL_CALL, RUN_STATUS, *UNRECORDED, RECORDER_ACK)
_PUBLISHERS = {
    topic: (topic.publisher,)
    for topic in TOPICS
    if topic.publisher and (topic.period_ns or topic in _OF_THE_LOOP)
} | {PARTICIPANTS: NODES, MOTOR_DUTY: (CONTROLLER, PLANT)}
LOCKSTEP_PUBLISHERS = _PUBLISHERS | {
    topic.history: roles for topic, roles in _PUBLISHERS.items() if topic.has_history
}
"""Topics reserved for the participants of a run, and the roles that publish on each."""


def periodic_topics(role: str) -> tuple[Topic, ...]:
    """Return the topics on which a role publishes a message at each multiple of their period."""
    return tuple(topic for topic in TOPICS if topic.publisher == role and topic.period_ns)


def message_class(type_name: str) -> Any:
    """Return the rclpy class of ``package/msg/Type``.

    It raises ImportError or AttributeError if that package or type is not installed.
    """
    package, _, name = type_name.split('/')
    return getattr(import_module(f'{package}.msg'), name)


def find_message_class(type_name: str) -> Any | None:
    """Return the rclpy class of a type, or None if it is not installed or not a message's name."""
    try:
        return message_class(type_name)
    # Without a package, the import is a relative one, which raises TypeError.
    except (ImportError, AttributeError, ValueError, TypeError):
        return None


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
