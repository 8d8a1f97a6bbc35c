"""A gyro driver with a low pass of its own, which takes the place of the project's gyro_driver.

The filter has a memory, so a run in which this driver is restarted has other duties.
"""

import math
import os
import signal
import threading
import uuid

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

OFFSET = 600  # reading at rest [deg/s]
WEIGHT = 0.5  # of the newest rate in the filtered one
STREAM = QoSProfile(depth=128)  # reliable and volatile, the defaults
STATE = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class GyroDriver(Node):
    """Answers each true rate with the reading of a gyro."""

    def __init__(self) -> None:
        super().__init__('gyro_driver')
        self.instance = uuid.uuid4().hex
        self.run, self.start_ns = '', math.inf
        self.participants = self.create_publisher(DiagnosticStatus, 'participants', STATE)
        self.gyro = self.create_publisher(Imu, 'gyro', STREAM)
        self.create_subscription(Header, 'plant/roll_call', self.on_roll_call, STATE)
        self.create_subscription(Imu, 'plant/imu', self.on_truth, STREAM)

    def on_roll_call(self, call: Header) -> None:
        """Join the run from the initial state if it is new. Announce this node in any case."""
        if call.frame_id != self.run:
            self.run, self.start_ns, self.answered_ns = call.frame_id, time_ns(call), 0
            self.rates = [0.0, 0.0]
        values = {
            'role': 'gyro_driver',
            'process': os.getpid(),
            'instance': self.instance,
            'run': self.run,
            'implementation': 'docs/examples/gyro_driver.py',
            'parameters sha256': '',
            'topics': 'gyro',
            'answered [ns]': self.answered_ns,
        }
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        host, name = os.uname().nodename, self.get_fully_qualified_name()
        self.participants.publish(DiagnosticStatus(name=name, hardware_id=host, values=pairs))

    def on_truth(self, truth: Imu) -> None:
        """Answer a truth of the run. A repeated truth gets the same answer."""
        now_ns = time_ns(truth.header)
        if now_ns < self.start_ns:
            return
        if now_ns != self.answered_ns:  # The filter counts a repeated truth only once.
            new = (truth.angular_velocity.x, truth.angular_velocity.y)
            self.rates = [old + WEIGHT * (new[i] - old) for i, old in enumerate(self.rates)]
            self.answered_ns = now_ns
        sample = Imu(header=truth.header)
        sample.angular_velocity.x, sample.angular_velocity.y = map(reading, self.rates)
        self.gyro.publish(sample)


def reading(rate: float) -> float:
    """Return a rate [rad/s] as whole deg/s with the offset, in rad/s again."""
    return math.radians(OFFSET + round(math.degrees(rate)))


def time_ns(header: Header) -> int:
    """Return the stamp of a header [ns]."""
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def main() -> None:
    """Drive the gyros until SIGINT or SIGTERM."""
    # By default a signal makes ROS unusable at once, even in the middle of a callback.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    executor = SingleThreadedExecutor()
    executor.add_node(GyroDriver())
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.1)
    rclpy.shutdown()


if __name__ == '__main__':
    main()
