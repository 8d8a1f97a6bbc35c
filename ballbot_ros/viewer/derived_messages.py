"""Messages for other tools that follow from those of a run: the robot's shape, walls and frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from ballbot_ros.messages.conversions import ball_position, body_pitch, encode_text, map_grid
from ballbot_ros.messages.outputs import MakeSend
from ballbot_ros.messages.participation import decode_announcement
from ballbot_ros.messages.raw import decoder, stamp_of
from ballbot_ros.messages.topics import (
    HISTORY,
    MAP,
    MARKERS,
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
_decode_map = decoder(MAP.type_name)
_decode_ball, _decode_body = (decoder(topic.type_name) for topic in _TRUTH)
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
    newest_ns : int
        Stamp of the newest complete tick [ns]; 0 before the first.
    """

    INPUTS = (RUN, PARTICIPANTS, MAP, *_TRUTH)
    OUTPUTS = (ROBOT_DESCRIPTION, MARKERS, TF_STATIC, TF)

    def __init__(self, make: MakeSend, shape: Shape) -> None:
        self._send = {topic: make(topic) for topic in self.OUTPUTS}
        self._moving = TransformsLayout({frame: PARENTS[frame] for frame in MOVING})
        self._take: Mapping[Topic, Callable[[int, bytes], None]] = {
            RUN: self._take_run,
            PARTICIPANTS: self._take_announcement,
            MAP: self._take_map,
            **{topic: partial(self._take_sample, topic) for topic in _TRUTH},
        }
        self._run = b''
        self._map_ns = 0
        self._floor: FloorMap | None = None
        self.set_shape(shape)
        self._begin()

    def _begin(self) -> None:
        self.newest_ns = self._sent_ns = 0
        self._is_new = True
        self._waiting: dict[Topic, dict[int, bytes]] = {topic: {} for topic in _TRUTH}
        self._tick: dict[Topic, bytes] = {}

    def set_shape(self, shape: Shape) -> None:
        """Take over the robot's shape for the next description."""
        self._shape = shape
        self._frames = Frames(Dimensions.from_parameters(shape))

    def add(self, topic: Topic, stamp_ns: int, data: bytes) -> None:
        """Process a message of :attr:`INPUTS` with its stamp [ns]; ignore a malformed one."""
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
        if not self._is_new:
            self._send_walls(stamp_ns)

    def _take_sample(self, topic: Topic, stamp_ns: int, data: bytes) -> None:
        if stamp_ns <= self.newest_ns:
            if stamp_ns > self.newest_ns - JUMP_NS:
                return
            self._begin()
        waiting = self._waiting[topic]
        waiting[stamp_ns] = data
        if len(waiting) > HISTORY:
            del waiting[next(iter(waiting))]
        if all(stamp_ns in each for each in self._waiting.values()):
            self._tick = {name: each[stamp_ns] for name, each in self._waiting.items()}
            self.newest_ns = stamp_ns
            self._waiting = {
                name: {stamp: data for stamp, data in each.items() if stamp > stamp_ns}
                for name, each in self._waiting.items()
            }

    def send(self) -> None:
        """Send the messages of the newest complete tick; at the start of a run, those of the run.

        It sends nothing if there is no new tick.
        """
        stamp_ns = self.newest_ns
        if stamp_ns == self._sent_ns:
            return
        try:
            ball, body = _decode_ball(self._tick[PLANT_ODOM]), _decode_body(self._tick[PLANT_IMU])
        except ValueError:
            return
        self._sent_ns = stamp_ns
        if self._is_new:
            self._is_new = False
            self.describe(stamp_ns)
            self._send_walls(stamp_ns)
        poses = self._frames.moving(ball_position(ball), body_pitch(body))
        self._send[TF](stamp_ns, self._moving.encode(stamp_ns, poses.values()))

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
