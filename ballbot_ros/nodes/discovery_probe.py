"""Sends a message from one participant to another; `ballbot doctor` runs it as a process."""

from __future__ import annotations

import signal
import sys
import time
import uuid

from ballbot_ros.errors import one_line
from ballbot_ros.nodes.middleware import stay_local, use_profiles
from ballbot_ros.nodes.processes import end_with_parent

DISCOVERY_S = 5.0
LIMIT_S = 20
"""Seconds after which the system ends the process, whatever the middleware does."""


def main() -> int:
    """Print how long a message took, or why none arrived; return 0 if it arrived, else 1."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if not end_with_parent():
        return 1
    try:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from std_msgs.msg import String
    except ImportError as error:
        print(error)
        return 1
    stay_local()
    use_profiles()
    signal.alarm(LIMIT_S)
    token = uuid.uuid4().hex
    heard: list[float] = []
    contexts = [rclpy.Context(), rclpy.Context()]
    try:
        for context in contexts:
            rclpy.init(context=context)
        talker, listener = (
            rclpy.create_node(f'doctor_{token}_{index}', context=context)
            for index, context in enumerate(contexts)
        )
        topic = f'doctor_{token}'
        publisher = talker.create_publisher(String, topic, 1)
        listener.create_subscription(String, topic, lambda m: heard.append(time.monotonic()), 1)
        executor = SingleThreadedExecutor(context=contexts[1])
        executor.add_node(listener)
        begun = time.monotonic()
        while not heard and time.monotonic() - begun < DISCOVERY_S:
            publisher.publish(String())
            executor.spin_once(timeout_sec=0.05)
        executor.shutdown()
    except RuntimeError as error:
        print(one_line(error))
        return 1
    finally:
        for context in contexts:
            context.try_shutdown()
    if not heard:
        print(
            f'no message within {DISCOVERY_S:g} s: allow UDP multicast on the loopback interface '
            '(firewall, container network)'
        )
        return 1
    print(f'message received from another participant after {heard[0] - begun:.2f} s')
    return 0


if __name__ == '__main__':
    sys.exit(main())
