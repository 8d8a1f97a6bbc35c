"""The base of every node: topics, diagnostics, and the main loop."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, nullcontext
from typing import Any, TypeAlias

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.experimental import EventsExecutor
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from ballbot_ros.errors import BallbotError, one_line
from ballbot_ros.nodes.end_guard import guarded_end
from ballbot_ros.nodes.endpoints import (
    IntraProcess,
    TopicPublisher,
    flush,
    intra_process,
    requested_qos,
)
from ballbot_ros.nodes.middleware import prepare_middleware
from ballbot_ros.nodes.node_parameters import P, ParameterNode
from ballbot_ros.nodes.processes import END_WITH_PARENT, end_with_parent
from ballbot_ros.process import StopRequest
from ballbot_ros.recording.messages.conversions import fill_time
from ballbot_ros.recording.messages.raw import decoder
from ballbot_ros.recording.messages.topics import DIAGNOSTICS, UNRECORDED, Topic

DIAGNOSTICS_PERIOD_S = 1.0
SIGNAL_PERIOD_S = 0.05

NO_SAMPLE = (ValueError, IndexError, OverflowError)
"""Errors raised while reading a message that no node of this package can have sent."""


class BallbotNode(ParameterNode[P]):
    """A node of the graph.

    Attributes
    ----------
    done : rclpy.Future
        Completed when the node has finished its work, so that its process may end.
    failure : str
        Why the node failed; '' if it did not.
    logs_failure : bool
        Whether the node logs why it failed; False if its command tells it.
    awaits : str
        What the node waits for at its start; '' for nothing.
    on_destroy : contextlib.ExitStack
        What to call when the node is destroyed.
    """

    def __init__(
        self, cls: type[P], parameters: P | None = None, *, use_sim_time: bool = False
    ) -> None:
        super().__init__(cls, parameters, use_sim_time=use_sim_time)
        self.done = rclpy.Future()
        self.exit_status = 0
        self.failure = ''
        self.logs_failure = True
        self.awaits = ''
        self.on_destroy = ExitStack()
        self._samples = 0
        self._reported_samples = 0
        self._last_sample_at = self._reported_at = time.monotonic()
        self._level = DiagnosticStatus.OK
        self._problem = ''
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._own_outputs: dict[Topic, TopicPublisher] = {}
        self._diagnostics = self.output(DIAGNOSTICS)
        self.create_wall_timer(DIAGNOSTICS_PERIOD_S, self.report)

    @property
    def program(self) -> str:
        """Name of the program that the node reports."""
        return type(self).__name__

    @property
    def finished(self) -> bool:
        """Whether the node has finished its work."""
        return bool(self.done.done())

    def finish(self) -> None:
        """Report that the node has finished its work."""
        if not self.finished:
            self.done.set_result(None)

    def create_wall_timer(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """Call `callback` periodically on the wall clock."""
        return self.create_timer(period_s, callback, clock=self._steady)

    def output(self, topic: Topic) -> TopicPublisher:
        """Return the publisher of `topic`."""
        output = self._own_outputs[topic] = TopicPublisher(self, topic)
        return output

    def recreate_publishers(self, exclude: Topic) -> None:
        """Drop messages of an earlier run kept for late subscribers, except on `exclude`."""
        for topic, output in self._own_outputs.items():
            if topic is not exclude and (topic.latched_depth or topic.has_history):
                output.recreate_publishers()

    def drop_latched(self, topic: Topic) -> None:
        """Drop the messages of a topic that are kept for late subscribers."""
        self._own_outputs[topic].recreate_publishers()

    def flush(self, *topics: Topic) -> None:
        """Wait until the last messages on `topics` have reached their readers, if these answer."""
        flush(each for topic in topics for each in self._own_outputs[topic].publishers)

    def subscribe(
        self, topic: Topic, callback: Callable[..., None], *, depth: int = 1, raw: bool = False
    ) -> Subscription | None:
        """Subscribe to `topic`; with `raw` the callback receives the serialised message.

        The subscription to a topic of the loop acknowledges nothing and gets no earlier messages,
        even if the topic is latched: the plant sends again what the node has missed, and the node
        must not answer older ticks. It is None if the publisher is a node of this process.
        """
        if raw:
            receive = callback
        else:
            decode = decoder(topic.type_name)

            def receive(data: bytes) -> None:
                try:
                    message = decode(data)
                except ValueError as error:
                    self.warn_malformed(topic, error)
                    return
                callback(message)

        if within := intra_process(topic):
            within.subscribe(self.resolve_topic_name(topic.name), receive)
            return None
        qos = requested_qos(topic, depth)
        if topic.period_ns or topic in UNRECORDED:
            qos.durability = DurabilityPolicy.VOLATILE
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        return self.create_subscription(topic.message_class, topic.name, receive, qos, raw=True)

    def warn_malformed(self, topic: Topic, error: Exception) -> None:
        """Warn of a malformed message, which no node of this package can have sent."""
        self.get_logger().warning(
            f'{topic.name}: message ignored: {one_line(error)}', throttle_duration_sec=1.0
        )

    def count_sample(self, now_ns: int) -> None:
        """Count a sample of the tick at `now_ns` for the diagnostics."""
        self._samples += 1
        self.now_ns = now_ns
        self._last_sample_at = time.monotonic()

    def count_answer(self, now_ns: int) -> None:
        """Count an answer to the tick at `now_ns`.

        The newest tick counts as answered, also if the plant has asked again for an earlier one,
        which the recorder lacks.
        """
        self.count_sample(max(now_ns, self.now_ns))

    def announced_values(self) -> Mapping[str, object]:
        """Return what the node announces when it joins a run, next to its parameters."""
        return {}

    def awaited(self) -> Mapping[str, int | None]:
        """Return the topics that the node waits for, as in :class:`Announcement`."""
        return {}

    def diagnose(self) -> Mapping[str, object]:
        """Return the node's own entries in its diagnostics."""
        return {}

    def warn(self, problem: str) -> None:
        """Log a warning once and show it in the diagnostics until :meth:`clear_warning`.

        It does not replace an error in the diagnostics.
        """
        if problem != self._problem:
            self.get_logger().warning(problem)
        if self._level != DiagnosticStatus.ERROR:
            self._level, self._problem = DiagnosticStatus.WARN, problem

    def report_error(self, problem: str) -> None:
        """Log an error and show it in the diagnostics at once, until :meth:`clear_error`."""
        self.get_logger().error(problem)
        self._show_error(problem)

    def _show_error(self, problem: str) -> None:
        self._level, self._problem = DiagnosticStatus.ERROR, problem
        self.report()

    def fail(self, problem: str) -> None:
        """Log an error and report it at once; the node's exit status becomes 1."""
        if self.logs_failure:
            self.get_logger().error(problem)
        self._show_error(problem)
        self.failure, self.exit_status = problem, 1

    def clear_warning(self) -> None:
        """Clear the warning."""
        if self._level == DiagnosticStatus.WARN:
            self._level, self._problem = DiagnosticStatus.OK, ''

    def clear_error(self) -> None:
        """Clear the error."""
        if self._level == DiagnosticStatus.ERROR:
            self._level, self._problem = DiagnosticStatus.OK, ''

    def report(self) -> None:
        """Publish the diagnostics."""
        now = time.monotonic()
        span = now - self._reported_at
        content = {
            'role': self.role,
            'rate [Hz]': f'{(self._samples - self._reported_samples) / span:.1f}' if span else '0',
            'age [s]': f'{now - self._last_sample_at:.3f}',
            'samples': self._samples,
            **self.diagnose(),
        }
        self._reported_samples, self._reported_at = self._samples, now
        status = DiagnosticStatus(
            level=self._level,
            name=f'{self.get_fully_qualified_name()}: loop',
            message=self._problem or 'OK',
            hardware_id='ballbot',
            values=[KeyValue(key=key, value=str(value)) for key, value in content.items()],
        )
        message = DiagnosticArray(status=[status])
        fill_time(message.header.stamp, self.now_ns)
        self._diagnostics.publish(message)

    def destroy_node(self) -> None:
        """Remove the node from the graph."""
        self.on_destroy.close()
        super().destroy_node()

    def close(self) -> None:
        """Release the node's resources; called once, after the last callback."""


AnyNode: TypeAlias = BallbotNode[Any]
"""A node of any role."""


def run_node(make: Callable[[], AnyNode]) -> int:
    """Run a node in this process until it has finished or is asked to stop; return its exit status.

    It is 0, 1 if the run failed, or 2 for a user's mistake.
    """
    if not end_with_parent():
        return 0
    node: AnyNode | None = None
    # A second signal must not interrupt the closing, so rclpy's own handlers are not installed.
    # A command kills its nodes if they hang.
    guard = nullcontext() if END_WITH_PARENT in os.environ else guarded_end()
    with guard, StopRequest() as stop:
        try:
            prepare_middleware()
            rclpy.init(signal_handler_options=rclpy.SignalHandlerOptions.NO)
            node = make()
            node.get_logger().info(
                f'started, waits for {node.awaits}' if node.awaits else 'started'
            )
            spin([node], node.done, stop)
            node.close()
            return node.exit_status
        except BallbotError as error:
            name = f'{node.get_name()}: ' if node else ''
            print(f'error: {name}{error}', file=sys.stderr)
            return 2 if node is None else 1
        except (RuntimeError, UnicodeError) as error:  # raised by rclpy for bad --ros-args
            if node is not None:
                raise
            print(f'error: {one_line(error)}', file=sys.stderr)
            return 2
        finally:
            if node is not None:
                node.destroy_node()
            rclpy.try_shutdown()


def spin(
    nodes: Sequence[AnyNode],
    done: rclpy.Future,
    stop: StopRequest | None = None,
    within: IntraProcess | None = None,
) -> None:
    """Run the callbacks of the nodes until `done`, or until a stop is requested.

    Unlike ``spin_once``, the executor stays in C++ between callbacks. Signals are noticed in one of
    them: it does not return while there is always another one. With messages `within` this process
    it alternates with their delivery.
    """
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    executor = EventsExecutor()
    for node in nodes:
        executor.add_node(node)
    end = rclpy.Future()
    done.add_done_callback(lambda _: end.set_result(None))

    def check_signal() -> None:
        if stop and stop.signal:
            end.set_result(None)

    nodes[0].create_timer(SIGNAL_PERIOD_S, check_signal, clock=steady)
    while not end.done():
        if within:
            executor.spin_once(0.0 if within.deliver() else SIGNAL_PERIOD_S)
        else:
            executor.spin_until_future_complete(end, SIGNAL_PERIOD_S)
