"""The driver of a device: reads the plant's true state (the truth) and publishes samples."""

from __future__ import annotations

import sys
from functools import partial

from ballbot_ros.messages.devices import DEVICE_MESSAGES, AnyDeviceMessages
from ballbot_ros.messages.raw import stamp_of
from ballbot_ros.messages.topics import HISTORY
from ballbot_ros.nodes.base import NO_SAMPLE, BallbotNode, run_node
from ballbot_ros.nodes.participation import Participation
from ballbot_ros.parameters import DeviceParameters
from ballbot_ros.simulation.devices import P
from ballbot_ros.simulation.lockstep import Run


class DeviceDriver(BallbotNode[P]):
    """Answers the truth of each sampling time with one sample that has the same stamp."""

    def __init__(self, cls: type[P], parameters: P | None = None) -> None:
        super().__init__(cls, parameters)
        self._messages = messages_of(cls)
        self._device = self._messages.device
        self._period_ns = self._device.period_ns
        self._read = self._device.make(self.parameters)
        self._output = self.output(self._messages.sample)
        self._encode = self._messages.encoder(self.parameters)
        self._participation = Participation(self, self._on_run)
        # A controller that does not wait for this device lets the plant run ahead.
        self.subscribe(self._messages.truth, self._on_truth, depth=HISTORY, raw=True)

    @property
    def program(self) -> str:
        """Name of the program, such as ``GyroDriver``."""
        return ''.join(word.capitalize() for word in self.role.split('_'))

    def check(self, parameters: P) -> None:
        """Check that the device can be created with these parameters."""
        self._device.make(parameters)

    def _on_run(self, run: Run) -> None:
        self._read = self._device.make(self.parameters)
        self._encode = self._messages.encoder(self.parameters)

    def _on_truth(self, truth: bytes) -> None:
        try:
            now_ns = stamp_of(truth)
            if now_ns % self._period_ns or not self._participation.includes(now_ns):
                return
            reading = self._read(self._messages.measured(truth), now_ns)
        except NO_SAMPLE as error:
            self.warn_malformed(self._messages.truth, error)
            return
        self._output.publish(self._encode(now_ns, reading))
        self.count_sample(now_ns)


def messages_of(cls: type[DeviceParameters]) -> AnyDeviceMessages:
    """Return the messages of the device whose driver has parameters of this class."""
    return next(each for each in DEVICE_MESSAGES if each.device.parameters is cls)


def main(cls: type[DeviceParameters]) -> None:
    """Run the driver of the device that the class of its parameters identifies."""
    sys.exit(run_node(partial(DeviceDriver, cls)))
