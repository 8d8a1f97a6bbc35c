"""Shows the graph in a browser, with controls; takes no part in the lockstep."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import fields
from itertools import islice

from rclpy.qos import QoSProfile

from ballbot_ros.engine.scenario.reader import scenario_names
from ballbot_ros.errors import WorldError
from ballbot_ros.nodes.base import BallbotNode
from ballbot_ros.nodes.endpoints import drain, raw_subscription
from ballbot_ros.nodes.latest_messages import LatestMessages, snapshot_of
from ballbot_ros.nodes.supervisor import StartRequest
from ballbot_ros.nodes.viewer_requests import TuningRequests, ViewerRequests
from ballbot_ros.parameters import Dimensions, PlantParameters, ViewerParameters
from ballbot_ros.parameters.timing import SECOND_NS
from ballbot_ros.recording.messages import topics
from ballbot_ros.recording.messages.conversions import encode_joy, map_grid, sound_tone, stamp_ns
from ballbot_ros.recording.messages.jobs import jobs_in
from ballbot_ros.recording.messages.run_reports import PlantReport, decode_plant_report
from ballbot_ros.recording.messages.topics import Topic
from ballbot_ros.recording.schemas import OccupancyGridMessage
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.robot.world.floor_map import FloorMap, floor_map_of, load_map
from ballbot_ros.viewer.address import address_line, network_warning, require_viser
from ballbot_ros.viewer.live_controls import PageSticks
from ballbot_ros.viewer.overlay import Hold
from ballbot_ros.viewer.plots import offered_kinds, plot_data
from ballbot_ros.viewer.run_activity import REPORT, RealTimeFactor, RunActivity, report_of
from ballbot_ros.viewer.snapshot import LIVE_SIGNALS, History, Snapshot

_DEPTH = 50

_SHOWN = (
    topics.PLANT_IMU, topics.PLANT_ODOM, topics.MOTOR_DUTY, topics.CONTROLLER_STATE,
    topics.GAMEPAD_JOY, topics.SONAR_RANGE, topics.BATTERY_STATE, topics.OPERATING_STATE,
    topics.LCD, topics.SOUND, topics.MAP, topics.ACCEPTED_PUSH,
    topics.RUN, topics.SESSION, topics.BRICK_TASKS,
)  # fmt: skip
_ASKED = (
    'scenario',
    'map',
    'start_position_x',
    'start_position_y',
    *(field.name for field in fields(Dimensions)),
)
"""Parameters of the plant that determine what to show."""

_STICK_PERIOD_S = 0.05
_LATE_TONE_NS = SECOND_NS // 2


class Viewer(BallbotNode[ViewerParameters]):
    """Serves the page; reads the newest message of each topic, at most 60 times a second."""

    def __init__(self, parameters: ViewerParameters | None = None) -> None:
        super().__init__(ViewerParameters, parameters)
        require_viser()
        # Imported only here: viser takes a second.
        from ballbot_ros.viewer.live_controls import (
            FaultChooser,
            ScenarioChooser,
            add_push_buttons,
            drag_push,
        )
        from ballbot_ros.viewer.page import UPDATE_S, Page
        from ballbot_ros.viewer.plots import Plots
        from ballbot_ros.viewer.processor_panel import ProcessorPanel
        from ballbot_ros.viewer.scene import PERIOD, ScenePanel
        from ballbot_ros.viewer.shapes import ForceArrow
        from ballbot_ros.viewer.tuning_sliders import TuningSliders

        host, port = self.parameters.host, self.parameters.port
        self._floor = self._load_floor()
        self._page = Page(Dimensions.from_parameters(self.parameters), 'NXT Ballbot', host, port)
        self._panel = ScenePanel(self._page.server.gui)
        self._processor = ProcessorPanel(self._page.server.gui)
        self._panel_period = PERIOD
        self._plots = Plots(self._page.server.gui, offered_kinds(LIVE_SIGNALS))
        self._start_position: Pair | None = None  # of the run; None if unknown
        self._requests = ViewerRequests(self, self._page.notify)
        self._start = StartRequest(self)
        self._page.server.serve_document(REPORT, self._report_page)
        arrow = ForceArrow(self._page.server.scene, 'drag', with_size=True)
        self._drag = drag_push(arrow, self._requests.push)
        self._show_robot(self._page.dimensions)
        self._sticks = PageSticks()
        self._scenarios = ScenarioChooser(
            self._page.server.gui, self._requests.start, scenario_names()
        )
        add_push_buttons(self._page.server.gui, self._requests.push)
        sliders = TuningSliders(self._page.server.gui)
        self._tuning = TuningRequests(self, self._page.notify, sliders)
        FaultChooser(self._page.server.gui, self._tuning.add_fault)
        self._newest = LatestMessages(self, _SHOWN)
        qos = QoSProfile(depth=_DEPTH)
        self._plant_status = raw_subscription(self._newest.inbox, topics.DIAGNOSTICS, qos)
        self._plant_report = PlantReport()
        self._run = ''
        self._history = History()
        self._real_time_factor = RealTimeFactor()
        self._updates = 0
        self._is_empty = True
        self._is_driving = False
        self._joy = self.output(topics.VIEWER_JOY)
        self.create_wall_timer(UPDATE_S, self._update)
        self.create_wall_timer(_STICK_PERIOD_S, self._drive)
        if warning := network_warning(host):
            self.get_logger().warning(warning)
        print(address_line(self._page.address, port), flush=True)

    def _update(self) -> None:
        self._requests.send_queued()
        self._tuning.send_queued()
        snapshot, changed = self._newest.take()
        activity = self._activity(snapshot)
        self._page.overlay.show(activity.overlay)
        if activity.session:  # as the time line
            self._page.overlay.move_playhead(activity.time)
        for request in self._page.overlay.take():
            if isinstance(request, Hold):
                self._sticks.hold(request)
            else:
                self._requests.carry_out(request, activity)
        if activity.awaits_start and self._page.overlay.is_drawn:
            self._start.request()
        if snapshot is None:
            self._clear()
            return
        self._is_empty = False
        if activity.has_lost_plant:
            snapshot = snapshot._replace(state='run ended')
        self._show(snapshot, changed)
        self._show_processor(is_paused=activity.is_paused)

    def _plant_reports(self) -> Iterator[PlantReport]:
        """Yield the plant's reports that have arrived on a topic that all nodes share, in order."""
        # Read no more messages than can be waiting: other nodes may publish faster than this.
        for data, _ in islice(drain(self._plant_status), _DEPTH):
            if (report := decode_plant_report(data)) is not None:
                yield report

    def _activity(self, robot: Snapshot | None) -> RunActivity:
        """Return what is known about the run that is shown."""
        for report in self._plant_reports():
            self._plant_report = report
        run = self._newest.run.name
        if run != self._run:
            self._run = run
            self._requests.forget_plant()
        return RunActivity(
            session=self._newest.session,
            has_pose=robot is not None,
            report=self._plant_report if self._plant_report.run == run else None,
            has_lost_plant=self._requests.lost_plant,
            is_out_of_control=robot is not None and robot.is_out_of_control,
            time=robot.time if robot else 0.0,
        )

    def _clear(self) -> None:
        """Show nothing of the run before."""
        if self._is_empty:
            return
        self._is_empty = True
        self._history.clear()
        self._real_time_factor = RealTimeFactor()
        self._robot.hide()
        self._panel.clear()
        self._start_position = None
        self._show_plots()

    def _report_page(self) -> bytes:
        """Return the report of the run that has ended; runs in a thread of the page."""
        session = self._newest.session
        return report_of(session.recording if session else '')

    def _show(self, snapshot: Snapshot, changed: Collection[Topic]) -> None:
        if topics.RUN in changed or topics.MAP in changed:
            self._begin(snapshot, self._newest[topics.MAP])
        if topics.PLANT_ODOM in changed:
            self.count_sample(stamp_ns(self._newest[topics.PLANT_ODOM]))
            self._history.add(snapshot)
        if topics.SOUND in changed:
            self._sound()
        self._updates += 1
        if not self._page.has_clients:
            return
        self._robot.show(snapshot)
        self._page.update_cameras(snapshot)
        if self._updates % self._panel_period == 0:
            self._robot.show_trail(self._history.trail())
            factor = self._real_time_factor.update(time.monotonic(), snapshot.time)
            self._panel.show(snapshot, factor)
            self._show_plots()
            self._scenarios.offer(offer=self._requests.can_start)

    def _show_processor(self, *, is_paused: bool) -> None:
        """Show the last jobs that are known of a paused run, those before a multiple of 100 ms."""
        newest = self._newest[topics.BRICK_TASKS] if is_paused else None
        jobs = None
        if newest is not None and len(newest.data):
            with suppress(ValueError):  # of a foreign controller
                jobs = jobs_in(newest)
        end_us = 0 if jobs is None else int(jobs.end[-1])
        self._processor.show(jobs, end_us, end_us * 1e-6)

    def _show_plots(self) -> None:
        time, columns = self._history.columns(
            self._page.dimensions.ball_radius, self._start_position
        )
        # The curves of a plot stay the same: viser's page reports an error if a plot is replaced
        # while it is updated.
        self._plots.refresh(lambda kind: plot_data(kind, time, columns, keeps_unknown=True))

    def _begin(self, snapshot: Snapshot, published: OccupancyGridMessage | None) -> None:
        """Show the floor of a new run, and discard the previous run.

        `published` is the map published with the run, if any. It lacks the lines on the floor; the
        plant's parameters name the map that has them.
        """
        self._history.clear()
        self._start_position = None
        before = Dimensions.from_parameters(self.parameters)
        self.apply_parameters()
        dimensions = Dimensions.from_parameters(self.parameters)
        if dimensions != before:
            self._show_robot(dimensions)
        floor = self._floor = self._load_floor()
        if floor is None and published is not None:
            floor = floor_map_of(map_grid(published))
        self._page.show_floor(floor, _start(snapshot))
        self._requests.plant_parameters(_ASKED, self._take_parameters)

    def _show_robot(self, dimensions: Dimensions) -> None:
        self._robot = self._page.show_robot(dimensions)
        self._robot.on_drag(self._drag)

    def check(self, parameters: ViewerParameters) -> None:
        """Check that the map exists."""
        if parameters.map:
            load_map(parameters.map)

    def _load_floor(self) -> FloorMap | None:
        name = self.parameters.map
        return load_map(name) if name else None

    def _take_parameters(self, parameters: PlantParameters) -> None:
        """Show the robot and the map that the plant simulates."""
        self._scenarios.show(parameters.scenario)
        self._start_position = parameters.start_position_x, parameters.start_position_y
        dimensions = Dimensions.from_parameters(parameters)
        if dimensions != self._page.dimensions:
            self._show_robot(dimensions)
        snapshot = snapshot_of(self._newest)
        if snapshot is None:
            return
        try:
            floor = load_map(parameters.map) if parameters.map else None
        except WorldError:  # the file is on another machine
            return
        self._page.show_floor(floor, _start(snapshot))

    def _sound(self) -> None:
        """Play a tone of the current run if it is not too old."""
        message = self._newest[topics.SOUND]
        if self.now_ns - stamp_ns(message) < _LATE_TONE_NS:
            self._panel.play(sound_tone(message))

    def _drive(self) -> None:
        """Publish the pages' sticks while they are held, and once after their release."""
        sticks = self._sticks.value(time.monotonic())
        if sticks is not None or self._is_driving:
            self._joy.publish(encode_joy(self.now_ns, sticks or (0.0, 0.0)))
        self._is_driving = sticks is not None

    def close(self) -> None:
        """Close the page."""
        self._newest.close()
        self._page.stop()


def _start(snapshot: Snapshot) -> tuple[float, float]:
    """Return the ball's x and y in ``map`` [m]; plane y has the opposite sign."""
    return snapshot.position[0], -snapshot.position[1]
