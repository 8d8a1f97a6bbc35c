"""A gyro driver that breaks its contract in the ways named by its first argument."""

import sys

from ballbot_ros.nodes import participation
from ballbot_ros.nodes.base import run_node
from ballbot_ros.nodes.device_driver import DeviceDriver
from ballbot_ros.parameters import GyroParameters
from ballbot_ros.recording.messages.raw import stamp_of

FAULTS = sys.argv.pop(1).split(',')


class WrongDriver(DeviceDriver):
    """The project's driver with faults."""

    def __init__(self):
        super().__init__(GyroParameters)

    def _set_up(self, start_ns):
        super()._set_up(start_ns)
        self._answered = set()

    def _on_truth(self, topic, truth):
        stamp = stamp_of(truth)
        if 'mute' in FAULTS and stamp in self._answered:
            return
        self._answered.add(stamp)
        super()._on_truth(topic, truth)


if 'twin' in FAULTS:
    participation.uuid4 = lambda: type('Same', (), {'hex': 'twin'})
sys.exit(run_node(WrongDriver))
