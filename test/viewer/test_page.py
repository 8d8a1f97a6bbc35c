"""The page in a browser: live with a graph, and from a file."""

import contextlib
import itertools
import math
import socket
import threading
import time
from urllib.parse import urlsplit

import numpy as np
import pytest
import viser

pytest.importorskip('rclpy')
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures('needs_browser')]

from browsing import StubRobot, another, browsing, running, serving, wait_until  # noqa: E402
from graph import LAST_RESORT_S, wait_for  # noqa: E402
from parts import DIMENSIONS  # noqa: E402
from ros_client import Client  # noqa: E402
from scipy import ndimage  # noqa: E402
from std_srvs.srv import SetBool  # noqa: E402
from websockets.asyncio.server import ServerConnection  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from ballbot_ros.recording.messages.conversions import body_pitch, odometry_position, stamp_ns  # noqa: E402
from ballbot_ros.recording.messages.topics import (  # noqa: E402
    ACCEPTED_PUSH,
    PARAMETER_EVENTS,
    PLANT_IMU,
    PLANT_ODOM,
    VIEWER_JOY,
)
from ballbot_ros.robot.world.floor_map import CELL_M, FLOOR, LINE, load_map  # noqa: E402
from ballbot_ros.viewer.live_controls import ScenarioChooser, add_push_buttons  # noqa: E402
from ballbot_ros.viewer.markers import Area  # noqa: E402
from ballbot_ros.viewer.page import Page  # noqa: E402
from ballbot_ros.viewer.playback_run import PlaybackRun  # noqa: E402
from ballbot_ros.viewer.recording_page import RecordingPage  # noqa: E402
from ballbot_ros.viewer.robot import BLACK, DARK, parts  # noqa: E402
from ballbot_ros.viewer.scene import ScenePanel  # noqa: E402
from ballbot_ros.viewer.snapshot import Snapshot  # noqa: E402
from ballbot_ros.viewer.tuning_sliders import FOLDER  # noqa: E402
from ballbot_ros.viewer.views import CHASER_1, ROBOT, TITLES, VIEWS, camera  # noqa: E402

START = (0.0, -0.3)
DRIVE = ('drive', '--no-keyboard', '--no-record', '--map', 'track', '--start', *START)


HANDSHAKE = """GET / HTTP/1.1\r
Host: 127.0.0.1:{port}\r
Upgrade: websocket\r
Connection: Upgrade\r
Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r
Sec-WebSocket-Version: 13\r
Sec-WebSocket-Protocol: viser-v{version}\r
\r
"""


@contextlib.contextmanager
def unread(port):
    """A browser that connects and never reads."""
    with socket.socket() as stuck:
        stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stuck.connect(('127.0.0.1', port))
        stuck.sendall(HANDSHAKE.format(port=port, version=viser.__version__).encode())
        yield


class GraphRecorder:
    """Records the graph's messages while the browser is busy."""

    def __init__(self, domain):
        self.client = Client(domain)
        for topic in (ACCEPTED_PUSH, PARAMETER_EVENTS, PLANT_IMU, PLANT_ODOM, VIEWER_JOY):
            self.client.watch(topic, depth=128)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _spin(self):
        while not self._end.is_set():
            self.client.executor.spin_once(timeout_sec=0.1)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._end.set()
        self._thread.join()
        self.client.close()

    def pause_when_calibrated(self):
        wait_for(lambda: self.newest_ns() > 2_500_000_000, what='the calibration')
        pause = self.client.node.create_client(SetBool, 'plant_sim/pause')
        assert pause.wait_for_service(LAST_RESORT_S)
        wait_for(pause.call_async(SetBool.Request(data=True)).done, what='the pause')

    def newest_ns(self):
        message = self.client.newest.get(PLANT_IMU.name)
        return stamp_ns(message) if message else 0

    def largest_lean(self):
        seen = self.client.seen.get(PLANT_IMU.name, [])
        return max((abs(body_pitch(message)[0]) for message in list(seen)), default=0.0)

    def position(self):
        return odometry_position(self.client.newest[PLANT_ODOM.name])[0]

    def newest_axes(self):
        """Return the newest stick of the pages, forward and rightward."""
        message = self.client.newest.get(VIEWER_JOY.name)
        return (message.axes[1], -message.axes[2]) if message else (0.0, 0.0)

    def is_driven(self):
        return any(self.newest_axes())


def start_viewer(start_node, **parameters):
    """Start the node; return its process and the address of its page."""
    node = start_node('viewer', **parameters)
    return node.process, node.lines_until('http://')[-1].split()[-1]


def spots(points, view, browser):
    """Return rows and columns of those points that are in the picture of a view."""
    size, scene = browser.canvas_size(), browser.scene
    still = Snapshot(0.0, (START[0], -START[1]), (0.0, 0.0))
    stand = camera(view, still, DIMENSIONS, Area.of(TRACK), size[0] / size[1])
    ahead = np.subtract(stand.look_at, stand.position)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, stand.up)
    right /= np.linalg.norm(right)
    away = np.asarray(points) - stand.position
    away = away[away @ ahead > 0.05]
    scale = size[1] / 2.0 / math.tan(stand.fov / 2.0) / (away @ ahead)
    columns = np.round(size[0] / 2.0 + scale * (away @ right) - scene['x']).astype(int)
    rows = np.round(size[1] / 2.0 - scale * (away @ np.cross(right, ahead)) - scene['y'])
    rows = rows.astype(int)
    seen = (rows >= 0) & (rows < scene['height']) & (columns >= 0) & (columns < scene['width'])
    return rows[seen], columns[seen]


def cells_about(x, y):
    """Return the types of the floor's cells within 8 cm."""
    column = round(x / CELL_M + TRACK.columns / 2)
    row = round(TRACK.rows / 2 - y / CELL_M)
    return TRACK.cells[row - 8 : row + 9, column - 8 : column + 9]


TRACK = load_map('track')
PLATE_EDGE = (0.0, 0.06, 0.039)
"""A point on the left edge of the lower plate, relative to the centre of the ball [m]."""

LINES = [
    ((column + 0.5 - TRACK.columns / 2) * CELL_M, (TRACK.rows / 2 - row - 0.5) * CELL_M, 0.0)
    for row, column in np.argwhere(TRACK.cells == LINE)[::10]
]
FLOORS = [
    (x, y, 0.0)
    for x, y in itertools.product(np.arange(-1.2, 1.2, 0.05), repeat=2)
    if (cells_about(x, y) == FLOOR).all() and math.dist((x, y), START) > 0.3
]
ROBOT_PARTS = [
    np.add((*START, DIMENSIONS.ball_radius), part.position)
    for part in parts(DIMENSIONS)
    if part.colour in (DARK, BLACK)
]


def shows_lines_robot_and_floor(browser, view):
    """Return whether lines and robot are dark and the floor is bright in the view.

    The robot, its shadow and the walls hide a part of the floor; the robot's bright parts hide some
    of its dark ones.
    """
    picture = browser.picture()
    floor, robot = (picture[spots(points, view, browser)] for points in (FLOORS, ROBOT_PARTS))
    # A distant line is as thin as a pixel, next to which its points may be.
    lines = ndimage.minimum_filter(picture, 3)[spots(LINES, view, browser)]
    return (
        (lines < 110.0).mean() > 0.6
        and (floor > 170.0).mean() > 0.3
        and (view == ROBOT or (robot < 110.0).mean() > 0.4)
    )


@pytest.mark.graph
@pytest.mark.timeout(600)
def test_live_pages_show_the_robot_and_drive_it(domain, start_node):
    with running(domain, *DRIVE), GraphRecorder(domain) as truth:
        viewer, address = start_viewer(start_node, port=0)
        port = urlsplit(address).port
        # Pause the robot: at rest it is not redrawn, so pages load sooner.
        truth.pause_when_calibrated()
        with browsing(address) as browser:
            browser.wait_for_text('remote')
            for key, view in enumerate(VIEWS, 1):
                browser.choose(f'{key} {TITLES[view]}')
                # The others are in the reference pictures of test_pictures.py.
                if view in (VIEWS[0], VIEWS[-1]):
                    wait_until(
                        lambda view=view: shows_lines_robot_and_floor(browser, view), browser
                    )
            browser.pause(is_paused=False)
            push_makes_it_lean(browser, truth)
            stick_drives_it(browser, truth)
            keys_drive_it(browser, truth)
            drag_pushes_it(browser, truth)
            slider_tunes_it(browser, truth)
            pause_holds_it(browser)

            with unread(port):
                other = another(browser, address)
                other.choose('4 Chaser 2 (front)')
                other.pause(is_paused=False)
                other.hold_stick(1.0, 0.0)
                wait_until(truth.is_driven, other)
                wait_until(lambda: other.has_moved(0.3), other)
                shown = truth.newest_ns() * 1e-9
                wait_until(lambda: (browser.shown_time() or 0.0) > shown, browser)
                assert '3 Chaser 1 (left)' in browser.inputs()
                assert '4 Chaser 2 (front)' in other.inputs()
                other.page.close()  # while the stick is held
                wait_until(lambda: not truth.is_driven(), browser)
            assert browser.errors == []

            shown = browser.shown_time()
            viewer.kill()
            viewer.wait()
            _, address = start_viewer(start_node, port=port)
            wait_until(lambda: (browser.shown_time() or 0.0) > shown, browser)
            browser.wait_for_text(
                'This page can only watch'
            )  # its token was that of the other viewer
            browser.page.goto(address)
            browser.wait_for_text('state')
            browser.pause()


def push_makes_it_lean(browser, truth):
    assert truth.largest_lean() < 1e-3
    browser.open('Push')
    browser.page.wait_for_timeout(500)
    browser.press('forward')
    wait_until(lambda: ACCEPTED_PUSH.name in truth.client.seen, browser)
    assert truth.client.seen[ACCEPTED_PUSH.name][0].wrench.force.x == 1.0
    wait_until(lambda: truth.largest_lean() > 0.01, browser)


def stick_drives_it(browser, truth):
    """Drive diagonally by the stick; the longest diagonal is 1 in length."""
    browser.hold_stick(1.0, -1.0)
    # First the stick: the robot still moves by the push.
    diagonal = pytest.approx([0.5**0.5, -(0.5**0.5)], abs=0.02)
    wait_until(lambda: truth.newest_axes() == diagonal, browser)
    before = truth.position()
    wait_until(lambda: truth.position() > before + 0.05, browser)
    # A page that had no processor for a moment counts as silent until its next report.
    wait_until(lambda: truth.newest_axes() == diagonal, browser)
    browser.let_go()
    wait_until(lambda: not truth.is_driven(), browser)


def keys_drive_it(browser, truth):
    """Drive by letters and arrows, also diagonally."""
    keyboard = browser.page.keyboard
    for keys, axes in ((['w'], (0.5, 0.0)), (['ArrowDown', 'd'], (-0.5, 0.5))):
        for key in keys:
            keyboard.down(key)
        wait_until(lambda axes=axes: truth.newest_axes() == pytest.approx(axes), browser)
        for key in keys:
            keyboard.up(key)
        wait_until(lambda: not truth.is_driven(), browser)


def drag_pushes_it(browser, truth):
    """Drag a plate of the body, in the view from its left, where forward is on the left."""
    known = len(truth.client.seen[ACCEPTED_PUSH.name])
    browser.choose('3 Chaser 1 (left)')
    grip = np.add((*START, DIMENSIONS.ball_radius), PLATE_EDGE)
    rows, columns = spots([grip], CHASER_1, browser)
    x, y = browser.scene['x'] + int(columns[0]), browser.scene['y'] + int(rows[0])
    mouse = browser.page.mouse

    def is_pushed():
        """Drag again if the page has not drawn the view yet."""
        mouse.move(x, y)
        mouse.down()
        mouse.move(x - 60, y, steps=6)
        browser.page.wait_for_timeout(200)
        mouse.up()
        browser.page.wait_for_timeout(1000)
        return len(truth.client.seen[ACCEPTED_PUSH.name]) > known

    wait_until(is_pushed, browser)
    force = truth.client.seen[ACCEPTED_PUSH.name][known].wrench.force
    assert force.x > 0.2
    assert abs(force.y) < force.x


def slider_tunes_it(browser, truth):
    browser.open(FOLDER)
    browser.wait_for_text('pwm_gain')
    # k_thetadot comes first: it is shared with the teleop, which has to take it over, too.
    slider = browser.page.get_by_role('slider').last
    slider.focus()
    slider.press('ArrowRight')
    wait_until(lambda: PARAMETER_EVENTS.name in truth.client.seen, browser)
    (changed,) = truth.client.seen[PARAMETER_EVENTS.name][0].changed_parameters
    assert (changed.name, changed.value.integer_value) == ('tone_gain', 1)
    browser.open(FOLDER)  # closes it


def pause_holds_it(browser):
    browser.pause()
    wait_until(lambda: stands_still(browser), browser)


def stands_still(browser):
    shown = browser.shown_time()
    return not browser.has_moved() and browser.shown_time() == shown


@pytest.mark.timeout(600)
def test_a_recorded_run_follows_keys_and_time_line(recording, domain):
    with serving(domain, 'view', recording, recording, '--port', 0) as (address, process):
        with browsing(address) as browser:
            browser.page.locator('.timeline').wait_for()
            keyboard = browser.page.keyboard

            def shows(time):
                return browser.shown_time() == pytest.approx(time, abs=1e-6)

            keyboard.press('End')
            wait_until(lambda: shows(10.0), browser)
            browser.page.get_by_role('button', name='Play').wait_for()
            before = browser.tones()
            keyboard.press('Home')
            wait_until(lambda: shows(0.0), browser)
            browser.wait_for_text('calibration')
            keyboard.press('ArrowRight')
            wait_until(lambda: shows(5.0), browser)
            keyboard.press('.')
            wait_until(lambda: shows(5.0), browser)
            browser.page.get_by_text('5.00 / 10.00 s').wait_for()
            playhead = browser.page.locator('.playhead').first
            place = playhead.bounding_box()['x']
            keyboard.press('End')
            wait_until(lambda: playhead.bounding_box()['x'] > place + 50, browser)
            browser.page.locator('.mark[data-kind="state"]').nth(1).click()
            wait_until(lambda: browser.shown_time() == pytest.approx(1.0, abs=0.05), browser)
            assert browser.page.locator('.mark[data-kind="tone"]').count() == 1
            assert browser.tones() in (0, before)  # the page forgets an old tone

            keyboard.press('Home')
            keyboard.press(' ')
            wait_until(lambda: browser.tones() > before, browser)
            wait_until(
                lambda: browser.page.locator('audio').evaluate('a => a.currentTime > 0'), browser
            )
            keyboard.press('-')
            pressed = browser.page.locator('.rates [aria-pressed="true"]')
            wait_until(lambda: pressed.inner_text() == '0.5×', browser)
            browser.press('0.1×')
            wait_until(lambda: pressed.inner_text() == '0.1×', browser)
            keyboard.press(' ')
            browser.page.get_by_role('button', name='Play').wait_for()
            wait_until(lambda: stands_still(browser), browser)
            assert 1.0 <= browser.shown_time() < 9.0
            assert browser.errors == []
        process.terminate()
        assert process.wait(LAST_RESORT_S) == 0


def test_a_recorded_run_waits_until_a_page_has_drawn_it(recording):
    run = PlaybackRun(recording)
    page = Page(run.dimensions, 'test', '127.0.0.1', 0)
    shown = RecordingPage(page, [run])
    link = page.address.replace('http', 'ws').replace('/?', '/link?')
    with connect(link) as connection:
        shown.update(1.0)
        assert shown.clock.time == 0.0
        connection.send('{"drawn":true}')
        wait_for(lambda: page.overlay.is_drawn)
        shown.update(1.0)
    page.stop()
    assert shown.clock.time == 1.0


def test_a_browser_that_stops_reading_does_not_block_others(recording, monkeypatch):
    """Updates continue while its connection is full, and only the newest content waits for it."""
    # A slow machine needs longer than the server waits for the answer to a ping.
    monkeypatch.setattr(ServerConnection, 'start_keepalive', lambda connection: None)
    run = PlaybackRun(recording)
    page = Page(run.dimensions, 'test', '127.0.0.1', 0)
    recording_page = RecordingPage(page, [run])
    with unread(page.server.get_port()):
        for number in range(600):
            recording_page.show(number / 60.0, panel=number % 12 == 0)
            time.sleep(0.001)
        waiting = len(page.server._websock_server._broadcast_buffer.message_from_id)
        assert page.server._websock_server._live_connections
    page.stop()
    assert waiting < 500


def test_scenarios_are_offered_where_they_can_be_started(recording):
    page = Page(PlaybackRun(recording).dimensions, 'test', '127.0.0.1', 0)
    robot = StubRobot()
    controls = ScenarioChooser(page.server.gui, robot.start, ['push', 'square', 'stationary'])
    add_push_buttons(page.server.gui, robot.push)
    ScenePanel(page.server.gui).show(Snapshot(0.0, (0.0, 0.0), (0.0, 0.0)))
    with browsing(page.address) as browser:
        assert browser.page.get_by_role('button', name='Start', exact=True).count() == 0
        controls.offer(offer=True)
        controls.show('square')
        browser.press('Start')
        wait_until(lambda: robot.asked == [('start', 'square')], browser)
        browser.page.get_by_label('Next').click()
        browser.page.get_by_role('option', name='push').click()
        browser.press('Start')
        wait_until(lambda: robot.asked[1:] == [('start', 'push')], browser)
        page.notify('push begins')
        browser.wait_for_text('push begins')
        controls.offer(offer=False)
        browser.page.get_by_role('button', name='Start').wait_for(state='hidden')
        assert browser.errors == []
    page.stop()
