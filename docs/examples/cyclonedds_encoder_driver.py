"""An encoder driver without ROS: Cyclone DDS joins a graph of ROS nodes on the same machine.

Install it with `pip install cyclonedds`. A ROS topic is a DDS topic whose name begins with `rt/`,
and a ROS type a DDS type with `dds_` and underscores in its name.
"""

import math
import os
import signal
import threading
import uuid
from dataclasses import dataclass, field

from cyclonedds.core import DDSStatus, Policy, Qos, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

# As for ROS nodes with ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST: no multicast, and the ports of the
# first 32 participants.
LOCALHOST = """<General>
    <Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
    <AllowMulticast>false</AllowMulticast>
</General>
<Discovery>
    <ParticipantIndex>auto</ParticipantIndex>
    <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
    <Peers><Peer address="127.0.0.1"/></Peers>
</Discovery>"""
RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))
STREAM = Qos(RELIABLE, Policy.Durability.Volatile, Policy.History.KeepLast(128))
NEWEST = Qos(RELIABLE, Policy.Durability.Volatile, Policy.History.KeepLast(1))
STATE = Qos(RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))


@dataclass
class Time(IdlStruct, typename='builtin_interfaces.msg.dds_.Time_'):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, typename='std_msgs.msg.dds_.Header_'):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ''


@dataclass
class JointState(IdlStruct, typename='sensor_msgs.msg.dds_.JointState_'):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64] = field(default_factory=list)
    effort: sequence[float64] = field(default_factory=list)


@dataclass
class KeyValue(IdlStruct, typename='diagnostic_msgs.msg.dds_.KeyValue_'):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename='diagnostic_msgs.msg.dds_.DiagnosticStatus_'):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


class EncoderDriver:
    """Answers each true angle of the motor shafts with whole degrees."""

    def __init__(self) -> None:
        self.dds = DomainParticipant(int(os.environ.get('ROS_DOMAIN_ID') or 0))
        self.instance = uuid.uuid4().hex
        self.run, self.start_ns, self.answered_ns = '', math.inf, 0
        self.announcements = DataWriter(
            self.dds, self.topic('participants', DiagnosticStatus), STATE
        )
        self.joint_states = DataWriter(self.dds, self.topic('joint_states', JointState), STREAM)
        self.roll_calls = DataReader(self.dds, self.topic('plant/roll_call', Header), STATE)
        self.truths = DataReader(self.dds, self.topic('plant/joint_states', JointState), NEWEST)
        self.waitset = WaitSet(self.dds)
        for reader in (self.roll_calls, self.truths):
            reader.set_status_mask(DDSStatus.DataAvailable)
            self.waitset.attach(reader)

    def topic(self, name: str, kind: type) -> Topic:
        """Return the DDS topic of a ROS topic."""
        return Topic(self.dds, f'rt/{name}', kind)

    def spin_once(self) -> None:
        """Wait a moment for messages, and handle them."""
        self.waitset.wait(duration(milliseconds=100))
        for call in valid_messages(self.roll_calls):
            self.on_roll_call(call)
        for truth in valid_messages(self.truths):
            self.on_truth(truth)

    def on_roll_call(self, call: Header) -> None:
        """Join the run if it is new; announce this driver in any case."""
        if call.frame_id != self.run:
            self.run, self.start_ns, self.answered_ns = call.frame_id, time_ns(call), 0
        values = {
            'role': 'encoder_driver',
            'process': os.getpid(),
            'instance': self.instance,
            'run': self.run,
            'implementation': 'my encoder 1.0',
            'parameters sha256': '',
            # Identifies this driver's publishers, which belong to no ROS node.
            'guid prefix': self.dds.guid.bytes[:12].hex(),
            'topics': 'joint_states',
            'answered [ns]': self.answered_ns,
        }
        pairs = [KeyValue(key, str(value)) for key, value in values.items()]
        host = os.uname().nodename
        self.announcements.write(DiagnosticStatus(0, '/encoder_driver', '', host, pairs))

    def on_truth(self, truth: JointState) -> None:
        """Answer a truth of the run; one that comes again gets the same answer."""
        if time_ns(truth.header) < self.start_ns:
            return
        self.answered_ns = max(self.answered_ns, time_ns(truth.header))
        readings = [whole_degrees(angle) for angle in truth.position]
        self.joint_states.write(JointState(truth.header, truth.name, readings))


def valid_messages(reader: DataReader) -> list:
    """Take the messages of a reader, without the notices that a publisher has left."""
    return [message for message in reader.take(8) if message.sample_info.valid_data]


def whole_degrees(angle: float) -> float:
    """Return the angle [rad] as whole degrees, in rad again."""
    return math.radians(math.floor(math.degrees(angle) + 0.5))


def time_ns(header: Header) -> int:
    """Return the stamp of a header [ns]."""
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def main() -> None:
    """Drive the encoders until SIGINT or SIGTERM."""
    os.environ.setdefault('CYCLONEDDS_URI', LOCALHOST)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    driver = EncoderDriver()
    while not ended.is_set():
        driver.spin_once()


if __name__ == '__main__':
    main()
