"""The driver of a device: reads the plant's true state (the truth) and publishes samples."""

from __future__ import annotations

from functools import partial

from ballbot_ros.engine.devices import P
from ballbot_ros.lockstep.lockstep import GivenAnswers
from ballbot_ros.nodes.base import NO_SAMPLE, BallbotNode
from ballbot_ros.nodes.participation import Participation
from ballbot_ros.parameters import DeviceParameters
from ballbot_ros.parameters.timing import FIRST_TICK_NS
from ballbot_ros.recording.messages.devices import DEVICE_MESSAGES, AnyDeviceMessages
from ballbot_ros.recording.messages.raw import stamp_of
from ballbot_ros.recording.messages.topics import HISTORY, Topic
from ballbot_ros.robot.brick.fault_effects import fault_row
from ballbot_ros.robot.brick.faults import faults_of


class DeviceDriver(BallbotNode[P]):
    """Answers the truth of each sampling time with one sample that has the same stamp."""

    def __init__(self, cls: type[P], parameters: P | None = None) -> None:
        super().__init__(cls, parameters)
        self._messages = messages_of(cls)
        self._device = self._messages.device
        self._period_ns = self._device.period_ns
        self._output = self.output(self._messages.sample)
        self._participation = Participation(self, lambda run: self._set_up(run.start_ns))
        self._subscribed: set[Topic] = set()
        self._set_up(FIRST_TICK_NS)

    @property
    def program(self) -> str:
        """Name of the program, such as ``GyroDriver``."""
        return ''.join(word.capitalize() for word in self.role.split('_'))

    def check(self, parameters: P) -> None:
        """Check that the device can be created with these parameters."""
        self._device.reader(parameters, fault_row(faults_of(parameters), FIRST_TICK_NS))

    def on_parameters_changed(self) -> None:
        """Let other faults act."""
        self._participation.change_faults(self._faults)

    def _set_up(self, start_ns: int) -> None:
        self._faults = fault_row(faults_of(self.parameters), start_ns)
        self._read = self._device.reader(self.parameters, self._faults)
        self._answers = GivenAnswers[object]()
        self._encode = self._messages.encoder(self.parameters)
        self._source = self._messages.source(self.parameters, start_ns)
        topic = self._source.topic
        if topic not in self._subscribed:
            self._subscribed.add(topic)
            # A controller that does not wait for this device lets the plant run ahead.
            self.subscribe(topic, partial(self._on_truth, topic), depth=HISTORY, raw=True)

    def _on_truth(self, topic: Topic, truth: bytes) -> None:
        if topic is not self._source.topic:
            return  # that of a run with another dead time
        try:
            now_ns = stamp_of(truth)
            if now_ns % self._period_ns or not self._participation.includes(now_ns):
                return
            reading = self._answers.at(
                now_ns, lambda: self._read(self._source.measured(truth, now_ns), now_ns)
            )
        except NO_SAMPLE as error:
            self.warn_malformed(topic, error)
            return
        self._output.publish(self._encode(now_ns, reading))
        self.count_answer(now_ns)

    def close(self) -> None:
        """Wait until the last sample has reached the recorder, too: others have answered it."""
        self.flush(self._messages.sample)


def messages_of(cls: type[DeviceParameters]) -> AnyDeviceMessages:
    """Return the messages of the device whose driver has parameters of this class."""
    return next(each for each in DEVICE_MESSAGES if each.device.parameters is cls)
