"""An encoder driver without ROS: Cyclone DDS joins a graph of ROS nodes on the same machine.

Install it with `pip install cyclonedds`. A ROS topic is a DDS topic whose name begins with `rt/`,
and a ROS type a DDS type with `dds_` and underscores in its name.
"""

import math
import os
import signal
import uuid
from dataclasses import dataclass, field

from cyclonedds.core import Listener, Policy, Qos
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

    def __init__(self, participant: DomainParticipant) -> None:
        self.guid_prefix = participant.guid.bytes[:12].hex()
        self.instance = uuid.uuid4().hex
        self.run, self.start_ns, self.answered_ns = '', math.inf, 0

        def topic(name: str, kind: type) -> Topic:
            return Topic(participant, f'rt/{name}', kind)

        def read(name: str, kind: type, qos: Qos, on_message) -> DataReader:
            def on_data(reader: DataReader) -> None:
                for message in reader.take():
                    if isinstance(message, kind):  # not the notice that a publisher has left
                        on_message(message)

            listener = Listener(on_data_available=on_data)
            return DataReader(participant, topic(name, kind), qos, listener)

        self.participants = DataWriter(participant, topic('participants', DiagnosticStatus), STATE)
        self.joint_states = DataWriter(participant, topic('joint_states', JointState), STREAM)
        self.readers = [
            read('plant/roll_call', Header, STATE, self.on_roll_call),
            read('plant/joint_states', JointState, NEWEST, self.on_truth),
        ]

    def on_roll_call(self, call: Header) -> None:
        """Join the run if it is new, and announce this driver in any case."""
        if call.frame_id != self.run:
            self.run, self.start_ns, self.answered_ns = call.frame_id, time_ns(call), 0
        values = {
            'role': 'encoder_driver',
            'process': os.getpid(),
            'instance': self.instance,
            'run': self.run,
            'implementation': 'docs/examples/cyclonedds_encoder_driver.py',
            'parameters sha256': '',
            'guid prefix': self.guid_prefix,  # in place of the name, which only ROS nodes have
            'topics': 'joint_states',
            'answered [ns]': self.answered_ns,
        }
        pairs = [KeyValue(key, str(value)) for key, value in values.items()]
        host = os.uname().nodename
        self.participants.write(DiagnosticStatus(0, '/encoder_driver', '', host, pairs))

    def on_truth(self, truth: JointState) -> None:
        """Answer a truth of the run. A repeated truth gets the same answer."""
        if time_ns(truth.header) < self.start_ns:
            return
        self.answered_ns = time_ns(truth.header)
        readings = [whole_degrees(angle) for angle in truth.position]
        self.joint_states.write(JointState(truth.header, truth.name, readings))


def whole_degrees(angle: float) -> float:
    """Return the angle [rad] as whole degrees, in rad again."""
    return math.radians(math.floor(math.degrees(angle) + 0.5))


def time_ns(header: Header) -> int:
    """Return the stamp of a header [ns]."""
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def main() -> None:
    """Drive the encoders until SIGINT or SIGTERM."""
    # The threads of Cyclone DDS inherit the mask, so the signals wait for this one.
    ends = {signal.SIGINT, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, ends)
    os.environ.setdefault('CYCLONEDDS_URI', LOCALHOST)
    participant = DomainParticipant(int(os.environ.get('ROS_DOMAIN_ID') or 0))
    driver = EncoderDriver(participant)
    signal.sigwait(ends)
    del driver


if __name__ == '__main__':
    main()
