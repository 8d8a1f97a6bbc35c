"""A test node next to the graph; needs rclpy."""

import time

import rclpy
from graph import LAST_RESORT_S
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from ballbot_ros.nodes.endpoints import reliable_qos, requested_qos
from ballbot_ros.recording.messages.conversions import fill_header, stamp_ns
from ballbot_ros.recording.messages.topics import DIAGNOSTICS, PLANT_IMU


def header(stamp_ns, frame_id=''):
    filled = Header()
    fill_header(filled, stamp_ns, frame_id)
    return filled


class Client:
    """A test node next to the graph."""

    def __init__(self, domain):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('test_client', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.newest = {}
        self.seen = {}
        self._clients = {}

    def close(self):
        self.node.destroy_node()
        self.context.try_shutdown()

    def watch(self, topic, depth=1, *, kept=False):
        """Store the messages of a topic; with `kept`, also those that its publishers keep."""

        def keep(message):
            self.newest[topic.name] = message
            self.seen.setdefault(topic.name, []).append(message)

        qos = reliable_qos(depth, latched=True) if kept else requested_qos(topic, depth)
        self.node.create_subscription(topic.message_class, topic.name, keep, qos)

    def publish(self, topic, make, period_s=0.05):
        """Publish the result of `make` repeatedly while the client is spun."""
        publisher = self.node.create_publisher(
            topic.message_class, topic.name, reliable_qos(1, latched=True)
        )
        self.node.create_timer(period_s, lambda: publisher.publish(make()))

    def spin_until(self, condition, what='it'):
        deadline = time.monotonic() + LAST_RESORT_S
        while not condition():
            assert time.monotonic() < deadline, f'{what} did not happen'
            self.executor.spin_once(timeout_sec=0.1)

    def spin_for(self, seconds):
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            self.executor.spin_once(timeout_sec=left)

    def call(self, kind, name, request):
        # Keep each client: a service may drop its answer to one that it has not discovered yet.
        client = self._clients.get((kind, name))
        if client is None:
            client = self._clients[kind, name] = self.node.create_client(kind, name)
        assert client.wait_for_service(LAST_RESORT_S)
        future = client.call_async(request)
        self.spin_until(future.done)
        return future.result()

    def set_value(self, node, name, value):
        """Set a parameter as `ros2 param set` does; return the answer."""
        parameter = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        return self.call(SetParameters, f'{node}/set_parameters', request).results[0]

    def await_diagnosis(self, role, key, is_meant=lambda value: True):
        """Wait for a report of a node with an accepted value of `key`; return the value."""

        def values():
            statuses = (report.status[0] for report in self.seen[DIAGNOSTICS.name])
            contents = ({each.key: each.value for each in status.values} for status in statuses)
            return [each[key] for each in contents if each['role'] == role and is_meant(each[key])]

        self.seen[DIAGNOSTICS.name] = []
        self.spin_until(values, what=f'{key} of {role}')
        return values()[0]

    def await_standstill(self, times=3):
        """Wait until the newest tick has arrived several times, since a halted plant repeats it."""

        def stands_still():
            stamps = [stamp_ns(message) for message in self.seen[PLANT_IMU.name][-times:]]
            return len(stamps) == times and len(set(stamps)) == 1

        self.seen[PLANT_IMU.name] = []
        self.spin_until(stands_still, what='the standstill')

    def now_ns(self):
        return stamp_ns(self.newest[PLANT_IMU.name])
