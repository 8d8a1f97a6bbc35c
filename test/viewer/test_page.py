"""The page in a browser: live beside a graph, and from a file."""

import socket
import threading
import time

import pytest
import viser

pytest.importorskip('rclpy')
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures('needs_browser')]

from browsing import browsing, serving, wait_until  # noqa: E402
from ros_client import Client  # noqa: E402

from ballbot_ros.messages.conversions import ball_position, body_pitch  # noqa: E402
from ballbot_ros.messages.topics import ACCEPTED_PUSH, PLANT_IMU, PLANT_ODOM  # noqa: E402
from ballbot_ros.viewer.live_controls import LiveControls  # noqa: E402
from ballbot_ros.viewer.page import Page  # noqa: E402
from ballbot_ros.viewer.panel import Panel  # noqa: E402
from ballbot_ros.viewer.playback import Playback  # noqa: E402
from ballbot_ros.viewer.player import Player  # noqa: E402
from ballbot_ros.viewer.snapshot import History, Snapshot  # noqa: E402

DRIVE = (
    'drive', '--viewer', '--no-keyboard', '--no-record', '--map', 'track', '--start', '0', '-0.3',
    '--set', 'viewer.port=0',
)  # fmt: skip


class Truth:
    """What the graph tells while the browser is busy."""

    def __init__(self, domain):
        self.client = Client(domain)
        for topic in (ACCEPTED_PUSH, PLANT_IMU, PLANT_ODOM):
            self.client.watch(topic, depth=128)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _spin(self):
        while not self._end.is_set():
            self.client.executor.spin_once(timeout_sec=0.1)

    def close(self):
        self._end.set()
        self._thread.join()
        self.client.close()

    def largest_lean(self):
        seen = self.client.seen.get(PLANT_IMU.name, [])
        return max((abs(body_pitch(message)[0]) for message in list(seen)), default=0.0)

    def position(self):
        return ball_position(self.client.newest[PLANT_ODOM.name])[0]


@pytest.mark.graph
@pytest.mark.timeout(180)
def test_a_live_page_shows_the_robot_and_drives_it(domain):
    with serving(domain, *DRIVE) as (address, _), browsing(address) as browser:
        truth = Truth(domain)
        try:
            browser.wait_for_text('remote')
            assert truth.largest_lean() < 1e-3
            browser.open('Push')
            browser.page.wait_for_timeout(500)
            browser.press('forward')
            wait_until(lambda: ACCEPTED_PUSH.name in truth.client.seen, browser)
            assert truth.client.seen[ACCEPTED_PUSH.name][0].wrench.force.x == 1.0
            wait_until(lambda: truth.largest_lean() > 0.01, browser)

            before = truth.position()
            browser.open('Sticks (hold)')
            browser.page.wait_for_timeout(500)
            browser.hold('Drive forward', 2.0)
            wait_until(lambda: truth.position() > before + 0.05, browser)
            assert browser.has_moved()

            browser.page.keyboard.press('3')
            wait_until(lambda: '3 Chaser 1 (left)' in browser.inputs(), browser)

            browser.press('Pause')
            browser.page.wait_for_timeout(1000)
            held = browser.shown_time()
            assert not browser.has_moved()
            assert browser.shown_time() == held
            browser.press('Run')
            wait_until(lambda: browser.shown_time() > held, browser)
            assert browser.errors == []
        finally:
            truth.close()


def test_a_recorded_run_follows_its_slider(recording, domain):
    with serving(domain, 'view', recording, recording, '--port', 0) as (address, process):
        with browsing(address) as browser:
            browser.press('Pause')
            slider = browser.page.get_by_role('slider').first
            slider.focus()
            slider.press('Home')
            wait_until(lambda: browser.shown_time() == 0.0, browser)
            browser.wait_for_text('calibration')
            slider.press('End')
            wait_until(lambda: browser.shown_time() == pytest.approx(9.996, abs=0.006), browser)
            slider.press('ArrowLeft')
            wait_until(lambda: browser.shown_time() < 9.99, browser)
            assert browser.errors == []
        process.terminate()
        assert process.wait(10.0) == 0


HANDSHAKE = """GET / HTTP/1.1\r
Host: 127.0.0.1\r
Upgrade: websocket\r
Connection: Upgrade\r
Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r
Sec-WebSocket-Version: 13\r
Sec-WebSocket-Protocol: viser-v{version}\r
\r
"""


def test_a_browser_that_stops_reading_holds_up_nobody(recording):
    """Its connection is full: what is shown goes on, and only the newest of it is kept."""
    run = Playback(recording)
    page = Page(run.dimensions, 'test', '127.0.0.1', 0)
    player = Player(page, [run])
    address = ('127.0.0.1', page.server.get_port())
    with socket.socket() as stuck:
        stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stuck.connect(address)
        stuck.sendall(HANDSHAKE.format(version=viser.__version__).encode())
        slowest = 0.0
        for number in range(600):
            began = time.monotonic()
            player.show(number / 60.0, panel=number % 12 == 0)
            slowest = max(slowest, time.monotonic() - began)
            time.sleep(0.001)
        waiting = len(page.server._websock_server._broadcast_buffer.message_from_id)
        assert page.server._websock_server._live_connections
    page.stop()
    assert slowest < 1.0
    assert waiting < 500


class StubRobot:
    """Notes what the page asks for."""

    def __init__(self):
        self.asked = []

    def __getattr__(self, name):
        return lambda *arguments: self.asked.append((name, *arguments))


def test_scenarios_are_offered_where_they_can_be_started(recording):
    page = Page(Playback(recording).dimensions, 'test', '127.0.0.1', 0)
    robot = StubRobot()
    controls = LiveControls(page.server.gui, robot, ['push', 'square', 'stationary'])
    Panel(page.server.gui).show(Snapshot(0.0, (0.0, 0.0), (0.0, 0.0)), History().trace())
    with browsing(page.address) as browser:
        assert browser.page.get_by_role('button', name='Start', exact=True).count() == 0
        controls.offer_scenarios(offer=True)
        controls.show_scenario('square')
        browser.press('Start')
        wait_until(lambda: robot.asked == [('start', 'square')], browser)
        browser.page.get_by_label('Next').click()
        browser.page.get_by_role('option', name='push').click()
        browser.press('Start')
        wait_until(lambda: robot.asked[1:] == [('start', 'push')], browser)
        page.notify('push begins')
        browser.wait_for_text('push begins')
        controls.offer_scenarios(offer=False)
        browser.page.get_by_role('button', name='Start').wait_for(state='hidden')
        assert browser.errors == []
    page.stop()
