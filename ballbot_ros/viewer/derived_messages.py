"""Messages for other tools that follow from those of a run: shape, walls, frames and odometry."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache, lru_cache, partial

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from ballbot_ros.files import share_directory
from ballbot_ros.parameters import (
    PLANT,
    Dimensions,
    ParameterError,
    ParameterSet,
    PlantParameters,
    VisualizerParameters,
)
from ballbot_ros.parameters.timing import TICK_NS
from ballbot_ros.recording.messages.conversions import (
    body_orientation,
    decode_ball_position,
    decode_body_pitch,
    encode_text,
    map_grid,
    pitches,
)
from ballbot_ros.recording.messages.devices import decode_encoders, decode_gyro
from ballbot_ros.recording.messages.raw import Messages, Stamps, decoder, stamp_of
from ballbot_ros.recording.messages.run_messages import MakeSend, Send
from ballbot_ros.recording.messages.run_reports import decode_announcement
from ballbot_ros.recording.messages.tool_messages import (
    TransformsLayout,
    encode_imu_data,
    encode_odom,
)
from ballbot_ros.recording.messages.topics import (
    GYRO_IMU,
    HISTORY,
    IMU_DATA,
    JOINT_STATES,
    MAP,
    MARKERS,
    ODOM,
    PARTICIPANTS,
    PLANT_IMU,
    PLANT_ODOM,
    ROBOT_DESCRIPTION,
    RUN,
    TF,
    TF_STATIC,
    Topic,
)
from ballbot_ros.recording.rosbag2 import QosProfile
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.recording.writer import RecordingWriter
from ballbot_ros.robot.arithmetic import Floats
from ballbot_ros.robot.brick.odometry import DeadReckoning, Rows
from ballbot_ros.robot.plant.model import Bodies
from ballbot_ros.robot.world.floor_map import FloorMap, floor_map_of
from ballbot_ros.viewer.markers import floor_markers
from ballbot_ros.viewer.robot import (
    BODY,
    DARK,
    DECK_ABOVE_WHEEL,
    MOVING,
    NAMES,
    PARENTS,
    Z_AXIS,
    Frames,
    Part,
    parts,
    sonar_position,
    wheel_centres,
)

_ZERO = 1e-15


@lru_cache(8)
def robot_description(dimensions: Dimensions, bodies: Bodies) -> str:
    """Return the URDF document; equal parameters give equal text."""
    deck = dimensions.wheel_radius + DECK_ABOVE_WHEEL
    height = 2.0 * dimensions.body_height - deck
    depth, width = dimensions.body_depth, dimensions.body_width
    body = Part(BODY, 'box', (depth, width, height), (0.0, 0.0, deck + height / 2.0), Z_AXIS, DARK)
    visible = list(parts(dimensions))
    # Ball and tires are the first part of their links.
    collisions = {part.link: part for part in reversed(visible) if part.link != BODY}
    if min(body.size) > 0.0:
        collisions[BODY] = body
    wheel_x, wheel_y = wheel_centres(dimensions)
    return _template().render(
        text=_text,
        colours=NAMES,
        bodies=bodies,
        # The model has no yaw inertia: use a box with the body's outline.
        yaw_inertia=bodies.body_mass * (depth**2 + width**2) / 12.0,
        # The model turns a wheel only about its axle: use a cylinder.
        across=bodies.wheel_mass * (3.0 * bodies.wheel_radius**2 + bodies.wheel_width**2) / 12.0,
        parts=visible,
        collisions=collisions,
        wheel_x=wheel_x,
        wheel_y=wheel_y,
        sonar=sonar_position(dimensions),
    )


@cache
def _template() -> Template:
    environment = Environment(
        loader=FileSystemLoader(share_directory() / 'config' / 'urdf'),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template('ballbot.urdf.jinja')


def _text(*numbers: float) -> str:
    """Format numbers for URDF, without the rounding errors of zeros."""
    return ' '.join(f'{number if abs(number) > _ZERO else 0.0:.9g}' for number in numbers)


Shape = PlantParameters | VisualizerParameters
"""Parameters with the robot's dimensions and masses."""

JUMP_NS = HISTORY * TICK_NS
"""A message that is older than the newest by more than this follows a jump in time [ns]."""

PERIOD_NS = 40_000_000
"""Period of the derived messages: a rate for tools, of which some interpolate poses."""

_TRUTH = (PLANT_ODOM, PLANT_IMU)
_SENSORS = (GYRO_IMU, JOINT_STATES)
_decode_map = decoder(MAP.type_name)
_new_marker = partial(new_message, 'visualization_msgs/msg/Marker')
_encode_markers = encoder(MARKERS.type_name)


class DerivedMessages:
    """Derives messages from those of a run, and sends them when asked.

    A tick is complete when its message of each periodic topic has come. Therefore the order of the
    topics does not matter, as long as each topic is in order.

    `make` makes the outputs. The robot has this shape until the plant announces another. `sent_ns`
    is the stamp of the newest tick that was sent [ns]; 0 at the start of a run.
    """

    INPUTS = (RUN, PARTICIPANTS, MAP, *_TRUTH, *_SENSORS)
    OUTPUTS = (ROBOT_DESCRIPTION, TF_STATIC, MARKERS, TF, ODOM, IMU_DATA)

    def __init__(self, make: MakeSend, shape: Shape) -> None:
        self._send = {topic: make(topic) for topic in self.OUTPUTS}
        self._moving = TransformsLayout({frame: PARENTS[frame] for frame in MOVING})
        self._take: Mapping[Topic, Callable[[int, bytes], None]] = {
            RUN: self._take_run,
            PARTICIPANTS: self._take_announcement,
            MAP: self._take_map,
            **{topic: partial(self._take_sample, topic) for topic in (*_TRUTH, *_SENSORS)},
        }
        self._run = b''
        self._map_ns = 0
        self._floor: FloorMap | None = None
        self.set_shape(shape)
        self._begin()

    def _begin(self) -> None:
        self.sent_ns = 0
        self._expect(*_TRUTH, *_SENSORS)

    def _expect(self, *topics: Topic) -> None:
        """Wait for these topics at each tick."""
        self._waiting: dict[Topic, dict[int, bytes]] = {topic: {} for topic in topics}

    def set_shape(self, shape: Shape) -> None:
        """Take over the robot's shape for the next run."""
        self._shape = shape
        self._frames = Frames(Dimensions.from_parameters(shape))

    def add(self, topic: Topic, stamp_ns: int, data: bytes) -> None:
        """Process a message of ``INPUTS`` with its stamp [ns]; ignore a malformed one."""
        try:
            self._take[topic](stamp_ns, data)
        except ValueError:
            return

    def _take_run(self, stamp_ns: int, data: bytes) -> None:
        if data == self._run:
            return
        start_ns = stamp_of(data)
        self._run = data
        if self._map_ns < start_ns:  # it belongs to an earlier run
            self._floor = None
        self._begin()

    def _take_announcement(self, stamp_ns: int, data: bytes) -> None:
        participant = decode_announcement(data).participant
        if participant.role == PLANT:
            self.set_shape(_plant_parameters(participant.parameters))

    def _take_map(self, stamp_ns: int, data: bytes) -> None:
        self._floor = floor_map_of(map_grid(_decode_map(data)))
        self._map_ns = stamp_of(data)
        if self.sent_ns:
            self._send_walls(stamp_ns)

    def _take_sample(self, topic: Topic, stamp_ns: int, data: bytes) -> None:
        if stamp_ns <= self.sent_ns - JUMP_NS:
            self._begin()
        if topic in self._waiting and stamp_ns > self.sent_ns:
            self._waiting[topic][stamp_ns] = data

    def send(self, stamp_ns: int = 0) -> None:
        """Send the messages of a tick: the first complete one from `stamp_ns` on, or the newest.

        At the start of a run, this includes the messages of the run. If no new tick is complete,
        nothing is sent.
        """
        first, *others = self._waiting.values()
        complete = set(first).intersection(*others)
        if stamp_ns:
            complete = {min((each for each in complete if each >= stamp_ns), default=0)} - {0}
        if complete:
            self._send_tick(max(complete))
        elif len(first) > HISTORY:
            # There are no samples of the sensors, as in a graph of a player with few topics.
            self._expect(*_TRUTH)

    def _send_tick(self, stamp_ns: int) -> None:
        is_new, self.sent_ns = not self.sent_ns, stamp_ns
        if is_new:  # the plant may announce its shape after the run
            self._odometry = DeadReckoning(self._shape.ball_radius, self._shape.wheel_radius)
        try:
            position = decode_ball_position(self._waiting[PLANT_ODOM][stamp_ns])
            pitch = decode_body_pitch(self._waiting[PLANT_IMU][stamp_ns])
            measured = self._measure(stamp_ns) if GYRO_IMU in self._waiting else None
        except ValueError:
            self.sent_ns = 0 if is_new else stamp_ns
            return
        finally:
            for waiting in self._waiting.values():
                for each_ns in [each for each in waiting if each <= stamp_ns]:
                    del waiting[each_ns]
        if is_new:
            self.describe(stamp_ns)
            self._send_walls(stamp_ns)
        self._send_motion(np.array([stamp_ns]), position, pitch, measured)

    def _measure(self, stamp_ns: int) -> int:
        """Process all samples up to a stamp; return the row of this tick among them."""
        gyro, encoders = (self._waiting[topic] for topic in _SENSORS)
        stamps = [each for each in gyro if self._odometry.now_ns < each <= stamp_ns]
        rates = [decode_gyro(gyro[each]) for each in stamps]
        none = math.nan, math.nan
        angles = [decode_encoders(encoders[each]) if each in encoders else none for each in stamps]
        self._odometry.add(np.array(stamps), np.array(rates), np.array(angles))
        return len(stamps) - 1

    def send_ticks(
        self, stamps_ns: Stamps, position: Floats, psi: Floats, gyro: Floats, encoders: Floats
    ) -> None:
        """Send the messages of every :data:`PERIOD_NS` for the next ticks of a run, in columns.

        All its ticks must come this way, with their true position and pitch and the readings of
        gyros and encoders, each of the shape (n, 2).
        """
        is_due, first_ns = stamps_ns % PERIOD_NS == 0, int(stamps_ns[0])
        if not self.sent_ns:
            is_due[0] = True
            self._odometry = DeadReckoning(self._shape.ball_radius, self._shape.wheel_radius)
            self.describe(first_ns)
            self._send_walls(first_ns)
        self.sent_ns = int(stamps_ns[-1])
        self._odometry.add(stamps_ns, gyro, encoders)
        due = np.flatnonzero(is_due)
        # The angles are those that a reader of plant/imu finds.
        pitch = pitches(*body_orientation(psi[due].T))
        self._send_motion(stamps_ns[due], position[due].T, pitch, due)

    def _send_motion(
        self, stamps_ns: Stamps, position: object, pitch: object, measured: Rows | int | None
    ) -> None:
        """Send where the robot is at ticks, and what it measures of its motion.

        Position and pitch are pairs of columns, or of numbers for one tick; `measured` are the rows
        of these ticks among those that were added to the odometry last.
        """
        state = None if measured is None else self._odometry.state(measured)
        travelled = position if state is None else state.position.value
        poses = self._frames.moving(position, pitch, travelled)
        self._send_all(TF, stamps_ns, self._moving.encode(stamps_ns, poses.values()))
        if measured is not None and state is not None:
            known = np.atleast_1d(self._odometry.is_calibrated(measured))
            self._send_all(ODOM, stamps_ns[known], encode_odom(stamps_ns, state)[known])
            self._send_all(IMU_DATA, stamps_ns[known], encode_imu_data(stamps_ns, state)[known])

    def _send_all(self, topic: Topic, stamps_ns: Stamps, messages: Messages) -> None:
        for stamp_ns, message in zip(stamps_ns.tolist(), messages, strict=True):
            self._send[topic](stamp_ns, message.tobytes())

    def describe(self, stamp_ns: int) -> None:
        """Send the robot's description and its fixed frames."""
        dimensions = Dimensions.from_parameters(self._shape)
        text = robot_description(dimensions, Bodies.from_parameters(self._shape))
        self._send[ROBOT_DESCRIPTION](stamp_ns, encode_text(text))
        fixed = self._frames.fixed
        layout = TransformsLayout({frame: PARENTS[frame] for frame in fixed})
        stamps_ns = np.array([stamp_ns])
        self._send_all(TF_STATIC, stamps_ns, layout.encode(stamps_ns, fixed.values()))

    def _send_walls(self, stamp_ns: int) -> None:
        message = new_message(MARKERS.type_name)
        message.markers = floor_markers(self._floor, _new_marker)
        self._send[MARKERS](stamp_ns, _encode_markers(message))


def _plant_parameters(values: Mapping[str, object]) -> PlantParameters:
    """Return the parameters that a plant has announced."""
    parameters = ParameterSet()
    for name, value in values.items():
        try:
            parameters.set(PLANT, name, value)
        except ParameterError:  # of a plant of another version
            continue
    return parameters.of(PlantParameters)


class DerivedChannels:
    """Writes derived messages to a recording, marked as such, while nobody publishes their topic.

    `name_of` returns the full name of a topic, `is_published` whether a node publishes that one.
    """

    def __init__(
        self,
        writer: RecordingWriter,
        shape: Shape,
        *,
        name_of: Callable[[Topic], str] = Topic.resolved,
        is_published: Callable[[str], bool] = lambda name: False,
    ) -> None:
        self._writer, self._name_of, self._is_published = writer, name_of, is_published
        self._messages = DerivedMessages(self._make_send, shape)
        self._due_ns = 0

    def add(self, topic: Topic, stamp_ns: int, data: bytes) -> None:
        """Process a message that was recorded on one of `DerivedMessages.INPUTS`."""
        messages = self._messages
        messages.add(topic, stamp_ns, data)
        if stamp_ns >= self._due_ns or not messages.sent_ns:
            messages.send(self._due_ns if messages.sent_ns else 0)
            self._due_ns = messages.sent_ns - messages.sent_ns % PERIOD_NS + PERIOD_NS

    def _make_send(self, topic: Topic) -> Send:
        name, qos = self._name_of(topic), (offered_qos(topic),)
        write = self._writer.sender(name, topic.type_name, qos=qos, derived=True)

        def send(stamp_ns: int, data: bytes) -> None:
            if not self._is_published(name):
                write(stamp_ns, data)

        return send


def offered_qos(topic: Topic) -> QosProfile:
    """Return the QoS with which a node of this package would publish the topic."""
    durability = 'transient_local' if topic.latched_depth else 'volatile'
    return QosProfile('keep_last', topic.latched_depth or HISTORY, 'reliable', durability)
