"""Shows the graph in a browser, and takes its controls: no participant of the lockstep."""

from __future__ import annotations

import math
import queue
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from ballbot_ros.messages.conversions import (
    ball_position,
    body_pitch,
    fill_joy,
    fill_push,
    stamp_ns,
    tone_of,
)
from ballbot_ros.messages.raw import decoder
from ballbot_ros.messages.topics import (
    BATTERY_STATE,
    LCD,
    MAP,
    MOTOR_DUTY,
    OPERATING_STATE,
    PLANT_IMU,
    PLANT_ODOM,
    PUSH,
    RUN,
    SONAR_RANGE,
    SOUND,
    VIEWER_JOY,
    Topic,
)
from ballbot_ros.nodes.base import BallbotNode, requested_qos, run_node
from ballbot_ros.parameters import PLANT, VIEWER, select
from ballbot_ros.plant.truth import Pair
from ballbot_ros.simulation.timing import SECOND_NS
from ballbot_ros.viewer.address import require_viser, warning_of
from ballbot_ros.viewer.floor import floor_of_grid
from ballbot_ros.viewer.robot import Dimensions
from ballbot_ros.viewer.snapshot import History, Snapshot
from ballbot_ros.world.floor_map import FloorMap
from ballbot_ros.world.library import load_map

_SHOWN = (
    PLANT_IMU, PLANT_ODOM, MOTOR_DUTY, SONAR_RANGE, BATTERY_STATE, OPERATING_STATE, LCD, SOUND,
    MAP, RUN,
)  # fmt: skip
_STICK_PERIOD_S = 0.05
_FACTOR_SPAN_S = 1.0
_LATE_TONE_NS = SECOND_NS // 2


class Viewer(BallbotNode):
    """Serves the page; reads the newest of each topic, at most 60 times a second."""

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        super().__init__(VIEWER, values)
        require_viser()
        # Only here: what viser brings with it takes a second to import.
        from ballbot_ros.viewer.live_controls import LiveControls
        from ballbot_ros.viewer.page import UPDATE_S, Page
        from ballbot_ros.viewer.panel import PERIOD, Panel

        host, port = self.values['host'], self.values['port']
        name = self.values['map']
        self._floor = load_map(name) if name else None
        self._page = Page(select(Dimensions, self.values), 'NXT Ballbot', host, port)
        self._panel = Panel(self._page.server.gui)
        self._panel_period = PERIOD
        self._robot = self._page.scene.add_robot('robot')
        self._requests = Requests(self)
        self._controls = LiveControls(self._page.server.gui, self._requests)
        self._newest = Newest(self)
        self._history = History()
        self._ticks: list[tuple[float, float]] = []
        self._updates = 0
        self._is_driving = False
        self._joy = self.advertise(VIEWER_JOY, depth=1)
        self._joy_message = VIEWER_JOY.message_class()
        self.every(UPDATE_S, self._update)
        self.every(_STICK_PERIOD_S, self._drive)
        if warning := warning_of(host):
            self.get_logger().warning(warning)
        print(f'viewer  {self._page.address}', flush=True)

    def _update(self) -> None:
        self._requests.make()
        changed = self._newest.take()
        now = self._snapshot()
        if now is None:
            return
        if RUN in changed or MAP in changed:
            self._begin(now)
        if PLANT_ODOM in changed:
            self.sampled(stamp_ns(self._newest[PLANT_ODOM]))
            self._history.add(now)
        if SOUND in changed:
            self._sound()
        self._updates += 1
        if not self._page.is_watched:
            return
        self._robot.show(now)
        self._page.look(now)
        if self._updates % self._panel_period == 0:
            self._panel.show(now, self._history.trace(), self._factor(now.time))

    def _snapshot(self) -> Snapshot | None:
        newest = self._newest
        body, ball = newest[PLANT_IMU], newest[PLANT_ODOM]
        if body is None or ball is None:
            return None
        duty, sonar, battery = newest[MOTOR_DUTY], newest[SONAR_RANGE], newest[BATTERY_STATE]
        state, lcd = newest[OPERATING_STATE], newest[LCD]
        return Snapshot(
            time=stamp_ns(ball) / SECOND_NS,
            position=ball_position(ball),
            psi=body_pitch(body),
            duty=(duty.vector.x, duty.vector.y) if duty else (math.nan, math.nan),
            sonar=sonar.range if sonar else math.nan,
            battery=battery.voltage if battery else math.nan,
            state=state.data if state else '',
            lcd=lcd.data if lcd else '',
        )

    def _begin(self, now: Snapshot) -> None:
        """Show the floor of a run that begins, and forget the run before it."""
        self._history.clear()
        self._robot.trace([])
        self._page.show_floor(self._map(), (now.position[0], -now.position[1]))

    def _map(self) -> FloorMap | None:
        """Return the map of the parameter, which has the lines, or the walls that are published."""
        message = self._newest[MAP]
        if self._floor is not None or message is None:
            return self._floor
        return floor_of_grid(message)

    def _sound(self) -> None:
        """Play a tone that is new, not one that a latched topic has kept."""
        message = self._newest[SOUND]
        if self.now_ns - stamp_ns(message) < _LATE_TONE_NS:
            self._panel.play(tone_of(message))

    def _factor(self, sim_time: float) -> float:
        """Return the speed over the last second, in times real time."""
        now = time.monotonic()
        self._ticks.append((now, sim_time))
        while now - self._ticks[0][0] > _FACTOR_SPAN_S:
            self._ticks.pop(0)
        wall, sim = self._ticks[0]
        return (sim_time - sim) / (now - wall) if now > wall else 0.0

    def _drive(self) -> None:
        """Publish the on-screen sticks while they are held, and once that they are let go."""
        sticks = self._controls.drive(time.monotonic())
        if sticks is not None or self._is_driving:
            fill_joy(self._joy_message, self.now_ns, sticks or (0.0, 0.0))
            self._joy.publish(self._joy_message)
        self._is_driving = sticks is not None

    def close(self) -> None:
        """Close the page."""
        self._newest.close()
        self._page.stop()


class Newest:
    """The newest message of each topic, decoded only when it is looked for.

    The messages are taken past the executor, as the recorder does it: a callback for each of
    them, of which most are never shown, would cost many times as much.
    """

    def __init__(self, node: BallbotNode) -> None:
        self._inbox = Node(
            f'_{VIEWER}_inbox',
            namespace=node.get_namespace(),
            use_global_arguments=False,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._subscriptions = {
            topic: self._inbox.create_subscription(
                topic.message_class,
                topic.name,
                lambda data: None,
                requested_qos(topic, 1),
                raw=True,
            )
            for topic in _SHOWN
        }
        self._decoders = {topic: decoder(topic.type_name) for topic in _SHOWN}
        self._messages: dict[Topic, Any] = {}

    def take(self) -> set[Topic]:
        """Take what has come; return the topics that have a new message."""
        changed = set()
        for topic, subscription in self._subscriptions.items():
            newest = None
            with subscription.handle:
                kind = subscription.msg_type
                while (taken := subscription.handle.take_message(kind, True)) is not None:
                    newest = taken[0]
            if newest is not None:
                self._messages[topic] = self._decoders[topic](newest)
                changed.add(topic)
        return changed

    def __getitem__(self, topic: Topic) -> Any:
        return self._messages.get(topic)

    def close(self) -> None:
        """Take leave of the topics."""
        self._inbox.destroy_node()


class Requests:
    """What the page asks of the plant, through its services and topics.

    The page calls from its own threads; the node's makes the requests.
    """

    def __init__(self, node: BallbotNode) -> None:
        self._node = node
        self._waiting: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._clients = {
            name: node.create_client(kind, f'{PLANT}/{name}')
            for name, kind in (
                ('pause', SetBool),
                ('step', Trigger),
                ('reset', Trigger),
                ('set_parameters', SetParameters),
            )
        }
        self._push = node.advertise(PUSH, depth=1)
        self._push_message = PUSH.message_class()

    def make(self) -> None:
        """Make the requests that wait."""
        while not self._waiting.empty():
            self._waiting.get()()

    def _call(self, name: str, request: Any) -> None:
        client = self._clients[name]
        if client.service_is_ready():
            client.call_async(request)
        else:
            self._node.get_logger().warning(f'{PLANT}/{name}: no such service at present')

    def pause(self, pause: bool) -> None:
        """Hold the plant, or let it go on."""
        self._waiting.put(lambda: self._call('pause', SetBool.Request(data=pause)))

    def step(self) -> None:
        """Let a paused plant go on by one tick."""
        self._waiting.put(lambda: self._call('step', Trigger.Request()))

    def reset(self) -> None:
        """Begin a new run."""
        self._waiting.put(lambda: self._call('reset', Trigger.Request()))

    def pace(self, factor: float) -> None:
        """Set the real-time factor; 0 is as fast as it can."""
        value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=factor)
        parameter = Parameter(name='real_time_factor', value=value)
        request = SetParameters.Request(parameters=[parameter])
        self._waiting.put(lambda: self._call('set_parameters', request))

    def push(self, force: Pair) -> None:
        """Push the body [N], in plane signs."""

        def publish() -> None:
            fill_push(self._push_message, self._node.now_ns, force)
            self._push.publish(self._push_message)

        self._waiting.put(publish)


def main() -> None:
    """Run the node."""
    sys.exit(run_node(Viewer))


if __name__ == '__main__':
    main()
