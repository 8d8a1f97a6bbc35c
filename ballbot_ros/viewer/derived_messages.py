"""Messages for other tools that follow from those of a run: shape, walls, frames and odometry."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from ballbot_ros.brick.odometry import WINDOW_NS, Odometry, OdometryState
from ballbot_ros.messages.conversions import (
    decode_ball_position,
    decode_body_pitch,
    encode_text,
    map_grid,
)
from ballbot_ros.messages.devices import decode_encoders, decode_gyro
from ballbot_ros.messages.odometry import encode_imu_data, encode_odom
from ballbot_ros.messages.outputs import MakeSend
from ballbot_ros.messages.participation import decode_announcement
from ballbot_ros.messages.raw import decoder, stamp_of
from ballbot_ros.messages.topics import (
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
from ballbot_ros.messages.transforms import TransformsLayout
from ballbot_ros.parameters import (
    PLANT,
    Dimensions,
    ParameterError,
    ParameterSet,
    PlantParameters,
    VisualizerParameters,
)
from ballbot_ros.plant.model import Bodies
from ballbot_ros.recording.encoding import encoder, new_message
from ballbot_ros.timing import TICK_NS
from ballbot_ros.viewer.markers import floor_markers
from ballbot_ros.viewer.transforms import MOVING, PARENTS, Frames
from ballbot_ros.viewer.urdf import robot_description
from ballbot_ros.world.exports import floor_map_of
from ballbot_ros.world.floor_map import FloorMap

Shape = PlantParameters | VisualizerParameters
"""Parameters with the robot's dimensions and masses."""

JUMP_NS = HISTORY * TICK_NS
"""A message that is older than the newest by more than this follows a jump in time [ns]."""

_TRUTH = (PLANT_ODOM, PLANT_IMU)
_SENSORS = (GYRO_IMU, JOINT_STATES)
_decode_map = decoder(MAP.type_name)
_new_marker = partial(new_message, 'visualization_msgs/msg/Marker')
_encode_markers = encoder(MARKERS.type_name)


class DerivedMessages:
    """Derives messages from those of a run, and sends them when asked.

    A tick is complete when its message of each periodic topic has come. Therefore the order of the
    topics does not matter, as long as each topic is in order.

    Parameters
    ----------
    make : MakeSend
        Makes the outputs.
    shape : PlantParameters or VisualizerParameters
        The shape of the robot until the plant announces another.

    Attributes
    ----------
    sent_ns : int
        Stamp of the newest tick that was sent [ns]; 0 at the start of a run.
    """

    INPUTS = (RUN, PARTICIPANTS, MAP, *_TRUTH, *_SENSORS)
    OUTPUTS = (ROBOT_DESCRIPTION, MARKERS, TF_STATIC, TF, ODOM, IMU_DATA)

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
            self._odometry = Odometry(self._shape.ball_radius, self._shape.wheel_radius)
        try:
            position = decode_ball_position(self._waiting[PLANT_ODOM][stamp_ns])
            pitch = decode_body_pitch(self._waiting[PLANT_IMU][stamp_ns])
            state = self._measure(stamp_ns) if GYRO_IMU in self._waiting else None
        except ValueError:
            self.sent_ns = 0 if is_new else stamp_ns
            return
        finally:
            self._forget(stamp_ns)
        if is_new:
            self.describe(stamp_ns)
            self._send_walls(stamp_ns)
        travelled = state.position.value if state else position
        poses = self._frames.moving(position, pitch, travelled)
        self._send[TF](stamp_ns, self._moving.encode(stamp_ns, poses.values()))
        if state and self._odometry.is_calibrated:
            self._send[ODOM](stamp_ns, encode_odom(stamp_ns, state))
            self._send[IMU_DATA](stamp_ns, encode_imu_data(stamp_ns, state))

    def _measure(self, stamp_ns: int) -> OdometryState:
        """Return what the robot measures of its motion, from all samples up to a stamp."""
        gyro, encoders = (self._waiting[topic] for topic in _SENSORS)
        for each_ns, data in gyro.items():
            if self._odometry.now_ns < each_ns <= stamp_ns:
                self._odometry.add(each_ns, decode_gyro(data))
        now = decode_encoders(encoders[stamp_ns])
        then = encoders.get(self._odometry.then_ns)
        return self._odometry.state(decode_encoders(then) if then else now, now)

    def _forget(self, stamp_ns: int) -> None:
        """Forget the messages up to a stamp, except those that later velocities need."""
        for topic, waiting in self._waiting.items():
            last_ns = stamp_ns - WINDOW_NS if topic is JOINT_STATES else stamp_ns
            for each_ns in [each for each in waiting if each <= last_ns]:
                del waiting[each_ns]

    def describe(self, stamp_ns: int) -> None:
        """Send the robot's description and its fixed frames."""
        dimensions = Dimensions.from_parameters(self._shape)
        text = robot_description(dimensions, Bodies.from_parameters(self._shape))
        self._send[ROBOT_DESCRIPTION](stamp_ns, encode_text(text))
        fixed = self._frames.fixed
        layout = TransformsLayout({frame: PARENTS[frame] for frame in fixed})
        self._send[TF_STATIC](stamp_ns, layout.encode(stamp_ns, fixed.values()))

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
