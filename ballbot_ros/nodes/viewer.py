"""Shows the graph in a browser, and takes its controls: no participant of the lockstep."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from rclpy.node import Node

from ballbot_ros.messages.conversions import (
    ball_position,
    body_pitch,
    fill_joy,
    stamp_ns,
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
    RUN,
    SONAR_RANGE,
    SOUND,
    VIEWER_JOY,
    Topic,
)
from ballbot_ros.nodes.base import BallbotNode, requested_qos, run_node
from ballbot_ros.nodes.viewer_requests import ViewerRequests
from ballbot_ros.parameters import VIEWER, select
from ballbot_ros.scenario.library import scenario_names
from ballbot_ros.simulation.timing import SECOND_NS
from ballbot_ros.viewer.address import require_viser, warning_of
from ballbot_ros.viewer.floor import floor_of_grid
from ballbot_ros.viewer.robot import Dimensions
from ballbot_ros.viewer.snapshot import History, Snapshot
from ballbot_ros.viewer.sound import tone_html
from ballbot_ros.world.errors import WorldError
from ballbot_ros.world.library import load_map

_SHOWN = (
    PLANT_IMU, PLANT_ODOM, MOTOR_DUTY, SONAR_RANGE, BATTERY_STATE, OPERATING_STATE, LCD, SOUND,
    MAP, RUN,
)  # fmt: skip
_ASKED = ('scenario', 'map', *(field.name for field in fields(Dimensions)))
"""Parameters of the plant that tell what is to be seen."""

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
        self._robot = self._page.show_robot(self._page.dimensions)
        self._requests = ViewerRequests(self, self._page.notify)
        self._controls = LiveControls(self._page.server.gui, self._requests, scenario_names())
        self._newest = Newest(self)
        self._history = History()
        self._ticks: list[tuple[float, float]] = []
        self._updates = self._tones = 0
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
            self._controls.offer_scenarios(offer=self._requests.can_start)

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
            state=self._state(state.data if state else ''),
            lcd=lcd.data if lcd else '',
        )

    def _state(self, operating_state: str) -> str:
        """Return the operating state, or that there is no plant any more."""
        return 'run ended' if self._requests.lost_plant else operating_state

    def _begin(self, now: Snapshot) -> None:
        """Show the floor of a run that begins, and forget the run before it."""
        self._history.clear()
        self._robot.trace([])
        self._show_floor(now)
        self._requests.plant_parameters(_ASKED, self._take_parameters)

    def _take_parameters(self, values: Mapping[str, Any]) -> None:
        """Show what the plant says that it simulates."""
        try:
            self._floor = load_map(values['map']) if values['map'] else None
        except WorldError:  # it is on another machine
            self._floor = None
        self._controls.show_scenario(values['scenario'])
        dimensions = select(Dimensions, values)
        if dimensions != self._page.dimensions:
            self._robot = self._page.show_robot(dimensions)
        if now := self._snapshot():
            self._show_floor(now)

    def _show_floor(self, now: Snapshot) -> None:
        """Show the map, which has the lines, or else the walls that are published."""
        message = self._newest[MAP]
        floor = self._floor
        if floor is None and message is not None:
            floor = floor_of_grid(message)
        self._page.show_floor(floor, (now.position[0], -now.position[1]))

    def _sound(self) -> None:
        """Play a tone that is new, not one that a latched topic has kept."""
        message = self._newest[SOUND]
        if self.now_ns - stamp_ns(message) < _LATE_TONE_NS:
            self._tones += 1
            tone = message.vector
            self._panel.play(tone_html(tone.x, tone.y, tone.z, self._tones))

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


def main() -> None:
    """Run the node."""
    sys.exit(run_node(Viewer))


if __name__ == '__main__':
    main()
