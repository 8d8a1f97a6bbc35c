"""A gyro driver without the package ballbot_ros: a gyro that resolves only 2 deg/s."""

import math
import os
import uuid
from contextlib import suppress

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

AT_REST, RESOLUTION = 600, 2  # [deg/s]
STREAM = QoSProfile(depth=128)  # reliable and volatile, the defaults
STATE = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class GyroDriver(Node):
    """Answers each true rate of the body with one reading of the same stamp."""

    def __init__(self) -> None:
        super().__init__('gyro_driver')
        self.instance, self.run, self.start_ns = uuid.uuid4().hex, '', math.inf
        self.participants = self.create_publisher(DiagnosticStatus, 'participants', STATE)
        self.gyro = self.create_publisher(Imu, 'gyro', STREAM)
        self.create_subscription(Header, 'plant/roll_call', self.on_roll_call, STATE)
        self.create_subscription(Imu, 'plant/imu', self.on_truth, STREAM)

    def on_roll_call(self, call: Header) -> None:
        """Join the run if it is new; announce this node in any case."""
        if call.frame_id != self.run:
            self.run, self.start_ns, self.answered_ns = call.frame_id, time_ns(call), 0
        values = {
            'role': 'gyro_driver', 'process': os.getpid(), 'instance': self.instance,
            'run': self.run, 'implementation': 'my gyro 1.0', 'parameters sha256': '',
            'topics': 'gyro', 'answered [ns]': self.answered_ns,
        }  # fmt: skip
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        host, name = os.uname().nodename, self.get_fully_qualified_name()
        self.participants.publish(DiagnosticStatus(name=name, hardware_id=host, values=pairs))

    def on_truth(self, truth: Imu) -> None:
        """Answer a truth of the run; one that comes again gets the same answer."""
        if time_ns(truth.header) >= self.start_ns:
            sample = Imu(header=truth.header)
            sample.angular_velocity.x = reading(truth.angular_velocity.x)
            sample.angular_velocity.y = reading(truth.angular_velocity.y)
            self.gyro.publish(sample)
            self.answered_ns = max(self.answered_ns, time_ns(truth.header))


def reading(rate: float) -> float:
    """Return what the gyro reads [rad/s] at a true rate [rad/s]."""
    return math.radians(AT_REST + RESOLUTION * round(math.degrees(rate) / RESOLUTION))


def time_ns(header: Header) -> int:
    """Return the stamp of a header [ns]."""
    return header.stamp.sec * 10**9 + header.stamp.nanosec


if __name__ == '__main__':
    # rclpy's own handlers would end ROS in the middle of a callback; Python's act between two.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor()
    executor.add_node(GyroDriver())
    with suppress(KeyboardInterrupt):
        while True:
            executor.spin_once(timeout_sec=0.1)
