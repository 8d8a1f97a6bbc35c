"""The page: web server, scene, and a camera for each browser."""

from __future__ import annotations

import logging
import threading
from typing import Any

import numpy as np
import viser

from ballbot_ros.parameters import Dimensions
from ballbot_ros.robot.world.floor_map import FloorMap
from ballbot_ros.viewer.address import NEXT_FREE, USUAL_PORT, AccessPolicy, check_address
from ballbot_ros.viewer.guarded_server import GuardedServer
from ballbot_ros.viewer.markers import Area
from ballbot_ros.viewer.scene import DrawnRobot, Scene
from ballbot_ros.viewer.snapshot import Snapshot
from ballbot_ros.viewer.views import TITLES, TRACKING, VIEWS, VISTA, camera

UPDATE_S = 1.0 / 60.0
"""Interval of updates for all browsers; slower browsers skip some."""

PANEL_WIDTH = 340
_ORBIT = 'orbit'
_NOTICE_S = 5.0

_ONLY_WATCHES = """<div id="welcome" class="only-watches">This page can only watch. To steer, open
the address that the viewer has printed, with its token.</div>"""


class Page:
    """The page, which looks the same in all browsers except for their cameras.

    viser keeps only the newest value of everything and sends it from its own thread as fast as each
    browser accepts it. A slow or stalled browser receives less and delays nobody.

    It raises ViewerError if it can't be served at the address; for the port see
    :func:`.check_address`.
    """

    def __init__(self, dimensions: Dimensions, title: str, host: str, port: int) -> None:
        check_address(host, port)
        self._policy = AccessPolicy(host)
        logging.getLogger('websockets').setLevel(logging.ERROR)
        first = USUAL_PORT if port == NEXT_FREE else port
        self.server = GuardedServer(self._policy, first, title)
        self.overlay = self.server.overlay
        self._title = title
        self.dimensions = dimensions  # of the robot shown
        self._area = Area.of(None)
        self._views: dict[int, str] = {}
        self._aspects: dict[int, float] = {}  # aspect ratio at the last update of each camera
        self._lock = threading.Lock()
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(238, 122, 40))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH)
        self.scene = Scene(self.server.scene)
        self.server.on_client_connect(self._welcome)
        self.server.on_client_disconnect(self._forget)

    @property
    def address(self) -> str:
        """The page's address with the token that lets it steer."""
        return self._policy.address(self.server.get_port())

    @property
    def has_clients(self) -> bool:
        """Whether a browser is connected."""
        return bool(self._views)

    def show_robot(self, dimensions: Dimensions) -> DrawnRobot:
        """Show the robot, replacing another one."""
        self.dimensions = dimensions
        return self.scene.add_robot('robot', dimensions)

    def notify(self, text: str) -> None:
        """Show a temporary message in all browsers."""
        for client in self.server.get_clients().values():
            client.add_notification(self._title, text, auto_close_seconds=_NOTICE_S)

    def show_floor(self, floor_map: FloorMap | None, start: tuple[float, float]) -> None:
        """Show a map, or an unlimited floor around `start` (x, y in ``map``) [m]."""
        self.scene.show_floor(floor_map)
        with self._lock:
            self._area = Area.of(floor_map, start)
            self._aspects.clear()

    def _welcome(self, client: viser.ClientHandle) -> None:
        """Set up the views of a new browser; hide the controls if it has no token."""
        may_steer = self.server.may_steer(client.client_id)
        client.gui.add_html('<div id="welcome"></div>' if may_steer else _ONLY_WATCHES, order=-1.5)
        names = [*VIEWS, _ORBIT]
        labels = [f'{number} {TITLES[view]}' for number, view in enumerate(VIEWS, 1)]
        labels.append('6 Free orbit')
        chooser: Any = client.gui.add_dropdown(
            'View', labels, initial_value=labels[names.index(VISTA)], order=-1.0
        )
        views = dict(zip(labels, names, strict=True))
        chooser.on_update(lambda _: self.set_view(client.client_id, views[chooser.value]))
        for number, label in enumerate(labels, 1):
            command = client.gui.add_command(label, hotkey=str(number))  # type: ignore[arg-type]

            @command.on_trigger
            def _(_: object, label: str = label) -> None:
                chooser.value = label

        self.set_view(client.client_id, VISTA)

    def set_view(self, client_id: int, view: str) -> None:
        """Select the view of a browser."""
        with self._lock:
            self._views[client_id] = view
            self._aspects.pop(client_id, None)

    def _forget(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._views.pop(client.client_id, None)
            self._aspects.pop(client.client_id, None)

    def update_cameras(self, snapshot: Snapshot) -> None:
        """Point the cameras of all browsers.

        A camera that does not track the robot is only pointed after a change of its view, of the
        floor, or of the aspect ratio of its window.
        """
        for client in self.server.get_clients().values():
            try:
                self._update_camera(client, snapshot)
            except (ArithmeticError, AssertionError, TypeError, ValueError):
                self._forget(client)  # the browser has sent an invalid camera

    def _update_camera(self, client: viser.ClientHandle, snapshot: Snapshot) -> None:
        number, aspect = client.client_id, client.camera.aspect
        with self._lock:
            view = self._views.get(number, _ORBIT)
            if view == _ORBIT or (view not in TRACKING and self._aspects.get(number) == aspect):
                return
            self._aspects[number] = aspect
            area = self._area
        to = camera(view, snapshot, self.dimensions, area, aspect)
        with client.atomic():
            client.camera.up_direction = np.array(to.up)
            client.camera.position = np.array(to.position)
            client.camera.look_at = np.array(to.look_at)
            if client.camera.fov != to.fov:
                client.camera.fov = to.fov

    def stop(self) -> None:
        """Close the page."""
        self.server.stop()
