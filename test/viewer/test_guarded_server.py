"""Foreign pages, and clients without the token, on a served page."""

import collections
import contextlib
import dataclasses
import http.client
import itertools
import json
import threading
import time
from functools import partial
from http.server import BaseHTTPRequestHandler, HTTPServer
from types import SimpleNamespace
from urllib.parse import urlsplit
from urllib.request import urlopen

import msgspec
import pytest
import viser
from browsing import FOREIGN, SIZE, StubRobot, another, browsing, shared_page, wait_until
from graph import LAST_RESORT_S, wait_for
from viser import _messages
from viser.infra import _infra
from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosedError, InvalidStatus
from websockets.sync.client import connect

from ballbot_ros.errors import ViewerError
from ballbot_ros.parameters import Dimensions, ParameterSet, ViewerParameters
from ballbot_ros.viewer import guarded_server
from ballbot_ros.viewer.live_controls import ScenarioChooser, add_push_buttons
from ballbot_ros.viewer.overlay import Banner, OverlayState, Press
from ballbot_ros.viewer.page import Page
from ballbot_ros.viewer.scene import ScenePanel
from ballbot_ros.viewer.snapshot import Snapshot

PROTOCOL = f'viser-v{viser.__version__}'
UPGRADE = {
    'Upgrade': 'websocket',
    'Connection': 'Upgrade',
    'Sec-WebSocket-Key': 'dGhlIHNhbXBsZSBub25jZQ==',
    'Sec-WebSocket-Version': '13',
    'Sec-WebSocket-Protocol': PROTOCOL,
}
FIELDS_OF_VIEW = itertools.count(0.5, 0.001)

# Sends the messages; reports whether the server has answered or refused the connection.
PRESS = """([address, protocol, messages]) => new Promise(resolve => {
  const socket = new WebSocket(address, [protocol]);
  socket.onopen = () => messages.forEach(each => socket.send(Uint8Array.from(each)));
  socket.onmessage = () => resolve('answered');
  socket.onerror = () => resolve('refused');
})"""


# Keeps viser's thread from connecting until it is released.
HOLD = """window.held = [];
const post = Worker.prototype.postMessage;
Worker.prototype.postMessage = function (message, ...others) {
  const send = () => post.call(this, message, ...others);
  if (message?.server && window.held) window.held.push(send);
  else send();
};
window.release = () => {
  window.held.forEach(send => send());
  window.held = null;
};"""


class Served:
    """A page with controls, which stores the requests to the robot."""

    def __init__(self):
        self.robot = StubRobot()
        self.page = Page(
            Dimensions.from_parameters(ParameterSet().of(ViewerParameters)), 'test', '127.0.0.1', 0
        )
        self.server = self.page.server
        self.controls = ScenarioChooser(self.server.gui, self.robot.start, ['push', 'square'])
        add_push_buttons(self.server.gui, self.robot.push)
        self.controls.offer(offer=True)
        ScenePanel(self.server.gui).show(Snapshot(0.0, (0.0, 0.0), (0.0, 0.0)))
        self.address = self.page.address
        self.place = urlsplit(self.address).netloc
        self.inputs = {
            handle.label: handle for handle in self.server.gui._gui_input_handle_from_uuid.values()
        }

    def status(self, path='/', **headers):
        """Return the status of the answer to a request with these headers."""
        connection = http.client.HTTPConnection(self.place)
        with contextlib.closing(connection):
            connection.request('GET', path, headers=headers)
            return connection.getresponse().status

    def set(self, name, /, **updates):
        """Return a browser's message that changes a control."""
        return _messages.GuiUpdateMessage(self.inputs[name]._impl.uuid, updates)


def camera(fov, **changes):
    """Return a browser's message about its camera, which is also its first message."""
    message = _messages.ViewerCameraMessage(
        wxyz=(1.0, 0.0, 0.0, 0.0), position=(0.0, 0.0, 1.0), fov=fov, near=0.01, far=1000.0,
        image_height=400, image_width=600, look_at=(0.0, 0.0, 0.0), up_direction=(0.0, 0.0, 1.0),
    )  # fmt: skip
    return dataclasses.replace(message, **changes)


def encoded(message):
    return msgspec.msgpack.encode(message.as_serializable_dict())


@pytest.fixture
def served():
    served = Served()
    yield served
    served.page.stop()


@contextlib.contextmanager
def client(served, query=''):
    """Connect without a browser; yield a function that sends messages and awaits their handling."""

    def send(*messages, **changes):
        fov = next(FIELDS_OF_VIEW)
        for message in (*messages, camera(fov, **changes)):
            socket.send(encoded(message))
        wait_for(lambda: fov in fields_of_view(), what='the last message')

    def fields_of_view():
        return [each.camera.fov for each in served.server.get_clients().values()]

    with connect(f'ws://{served.place}/{query}', subprotocols=[PROTOCOL]) as socket:
        send()
        yield send


def test_foreign_pages_are_refused(served):
    own = f'http://{served.place}'
    port = urlsplit(own).port
    assert served.status() == 200
    assert served.status(**UPGRADE) == 101
    assert served.status(**UPGRADE, Origin=own) == 101
    assert served.status(**UPGRADE, Origin='https://evil.example') == 403
    assert served.status(**UPGRADE, Origin='null') == 403
    foreign = f'{FOREIGN}:{port}'
    assert served.status(Host=foreign) == 403
    assert served.status(**UPGRADE, Host=foreign) == 403
    assert served.status(**UPGRADE, Host=foreign, Origin=f'http://{foreign}') == 403


@pytest.mark.parametrize('query', ['', '?token=', '?token=wrong'])
def test_a_client_without_the_token_can_not_change_anything(served, query, monkeypatch):
    shared = []
    monkeypatch.setattr(served.server, 'request_share_url', lambda: shared.append('shared'))
    force = served.inputs['Force [N]']
    before = force.value, force.label
    with client(served, query) as send, client(served, f'?{urlsplit(served.address).query}') as own:
        send(
            served.set('Direction', value='forward'),
            served.set('Start', value=True),
            served.set('Force [N]', value=3.0),
            served.set('Force [N]', label='Power [N]'),
            _messages.ShareUrlRequest(),
        )
        own(served.set('Direction', value='left'))
        wait_for(lambda: served.robot.asked, what='the push')
        assert served.robot.asked == [('push', (0.0, -before[0]))]
        assert (force.value, force.label) == before
        assert not shared
        own(served.set('Force [N]', value=3.0))
        assert force.value == 3.0


def test_the_overlay_s_link_needs_the_token_to_steer(served):
    overlay, query = served.page.overlay, urlsplit(served.address).query
    overlay.move_playhead(1.0)
    address = f'ws://{served.place}/link'

    def receive(socket, *topics):
        return {k: v for _ in topics for k, v in json.loads(socket.recv(LAST_RESORT_S)).items()}

    with connect(f'{address}?{query}') as own, connect(f'{address}?token=wrong') as other:
        assert receive(own, 'may_steer', 'state', 'time')['may_steer'] is True
        assert receive(other, 'may_steer', 'state', 'time')['may_steer'] is False
        other.send('{"press": "pause"}')
        overlay.show(OverlayState(can_drive=True))
        assert receive(own, 'state')['state']['can_drive'] is True
        assert receive(other, 'state')['state']['can_drive'] is True
        other.send('{"press": "pause"}')
        own.send(b'{"press": "binary"}')
        own.send('nonsense')
        own.send('{"press": "step"}')
        taken = []
        wait_for(lambda: taken.extend(overlay.take()) or taken, what='the request')
        assert taken == [Press('step')]
    for origin in (f'http://{FOREIGN}', 'null'):
        with pytest.raises(InvalidStatus, match='403'):
            connect(f'{address}?{query}', additional_headers={'Origin': origin})


def test_a_page_that_does_not_read_delays_no_other(served):
    overlay, address = served.page.overlay, f'ws://{served.place}/link'
    with connect(address, max_queue=1, close_timeout=0), connect(address) as other:
        long = 'x' * 100_000
        for number in range(200):
            overlay.show(OverlayState(banner=Banner(f'{number} {long}')))
        overlay.move_playhead(5.0)
        wait_for(
            lambda: json.loads(other.recv(LAST_RESORT_S)).get('time') == 5.0, what='the newest time'
        )


def test_a_document_is_made_for_each_request(served):
    made = []
    served.server.serve_document(
        '/report', lambda: made.append(1) or f'<p>{len(made)}</p>'.encode()
    )
    for number in (1, 2):
        with urlopen(f'http://{served.place}/report') as answer:
            assert answer.read() == f'<p>{number}</p>'.encode()
            assert answer.headers['Content-Type'] == 'text/html; charset=utf-8'
    for path in ('/assets/none.js', '/assets/../page.py', '/none'):
        assert served.status(path) == 404


def test_a_document_may_take_longer_than_the_library_s_limit(monkeypatch):
    limit_s = 0.2
    monkeypatch.setattr(guarded_server, 'serve', partial(serve, open_timeout=limit_s))
    served = Served()
    served.server.serve_document('/slow', lambda: time.sleep(2.0 * limit_s) or b'slow')
    with urlopen(f'http://{served.place}/slow') as answer:
        assert answer.read() == b'slow'
    served.page.stop()


@pytest.mark.filterwarnings('ignore:.*does not match annotation')
@pytest.mark.parametrize('changes', [{'image_height': 0}, {'image_width': 0}, {'position': ()}])
def test_an_invalid_camera_does_not_end_the_server(served, changes):
    snapshot = Snapshot(0.0, (0.0, 0.0), (0.0, 0.0))
    with client(served) as hostile, client(served):
        wait_for(lambda: len(served.page._views) == 2, what='the welcome')
        hostile(**changes)
        served.page.update_cameras(snapshot)
        assert len(served.page._aspects) == 1  # only the valid client's camera has been pointed


def test_a_viser_with_another_server_start_is_refused(monkeypatch):
    websockets = SimpleNamespace(**vars(_infra.websockets))
    websockets.asyncio = SimpleNamespace(
        server=SimpleNamespace(**vars(_infra.websockets.asyncio.server))
    )
    monkeypatch.setattr(_infra, 'websockets', websockets)
    with pytest.raises(ViewerError, match='access control does not support viser'):
        Served()


class Blank(BaseHTTPRequestHandler):
    """An empty page."""

    def do_GET(self):
        self.send_response(200)
        self.send_header('Content-Type', 'text/html')
        self.end_headers()

    def log_message(self, *_):
        pass


@pytest.fixture
def foreign_site():
    """Serve an empty page; yield its port."""
    with HTTPServer(('127.0.0.1', 0), Blank) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_port
        server.shutdown()
        thread.join()


@pytest.mark.slow
def test_no_foreign_page_in_a_browser_steers(served, foreign_site, needs_browser):
    with shared_page(*SIZE) as page:
        a_foreign_page_does_not_steer(page, served, foreign_site)


def a_foreign_page_does_not_steer(page, served, foreign_site):
    port = urlsplit(served.address).port
    query = urlsplit(served.address).query
    presses = [list(encoded(each)) for each in (camera(0.5), served.set('Start', value=True))]

    def press(address):
        return page.evaluate(PRESS, [address, PROTOCOL, presses])

    for site in (f'127.0.0.1:{foreign_site}', f'{FOREIGN}:{foreign_site}'):
        page.goto(f'http://{site}/')
        for target in ('', f'?{query}'):  # a site is refused even with the token
            assert press(f'ws://{served.place}/{target}') == 'refused'

    answer = page.goto(f'http://{FOREIGN}:{port}/')  # the name now points to this machine
    assert answer.status == 403
    assert page.evaluate('location.origin') == f'http://{FOREIGN}:{port}'
    assert press(f'ws://{FOREIGN}:{port}/?{query}') == 'refused'
    assert press(f'ws://{served.place}/?{query}') == 'refused'

    assert page.goto(f'http://{served.place}/').status == 200
    assert press(f'ws://{served.place}/') == 'answered'
    assert served.robot.asked == []
    assert press(f'ws://{served.place}/?{query}') == 'answered'
    wait_for(lambda: served.robot.asked == [('start', 'push')], what='the start')


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_page_steers_with_the_token_and_only_shows_without_it(served, needs_browser):
    with browsing(served.address) as browser:
        browser.press('Start')
        wait_until(lambda: served.robot.asked == [('start', 'push')], browser)
        browser.page.reload()
        browser.press('Start')
        wait_until(lambda: served.robot.asked[1:] == [('start', 'push')], browser)
        assert browser.errors == []

        other = another(browser, f'http://{served.place}/?websocket=ws://evil.example')
        assert other.page.url == f'http://{served.place}/'
        other.wait_for_text('This page can only watch')
        for text in ('Scenario', 'Push'):
            other.page.get_by_text(text, exact=True).wait_for(state='hidden')
        other.wait_for_text('state')
        other.choose('1 Top')
        assert other.errors == []
        assert len(served.robot.asked) == 2


def test_a_page_shows_our_sign_until_it_is_connected_and_never_the_token(served, needs_browser):
    """In its address and fields, also when it is reloaded or the connection is lost."""
    token = served.address.partition('token=')[2]

    def shows_token():
        fields = page.locator('input').evaluate_all('all => all.map(each => each.value)')
        return any(token in text for text in (page.url, page.inner_text('body'), *fields))

    def sign():
        return page.evaluate("getComputedStyle(document.documentElement, '::after').content")

    def covers():
        return page.evaluate("document.elementFromPoint(9, 9).closest('body') === null")

    with shared_page(*SIZE) as page:
        page.add_init_script(HOLD)
        for load in (lambda: page.goto(served.address), page.reload):
            load()
            page.wait_for_function('window.held.length')  # viser is about to connect
            page.wait_for_selector('#overlay', state='attached')
            assert 'connecting' in sign()
            assert covers()
            assert not shows_token()
            page.evaluate('release()')
            page.wait_for_function("!document.documentElement.matches('.is-connecting')")
            assert sign() == 'none'
            assert not covers()
            assert page.url == f'http://{served.place}/'
            assert not shows_token()
            page.get_by_role('button', name='Start', exact=True).click()
        wait_for(lambda: served.robot.asked == [('start', 'push')] * 2, what='both starts')


def test_every_address_without_the_token_leads_to_the_same_page(served):
    assert served.status() == 200
    for query in ('token=', 'token=wrong', 'websocket=ws://evil.example'):
        connection = http.client.HTTPConnection(served.place)
        with contextlib.closing(connection):
            connection.request('GET', f'/?{query}')
            answer = connection.getresponse()
            assert (answer.status, answer.headers['Location']) == (302, '/'), query


def test_invalid_data_closes_the_connection_with_one_line(served, caplog):
    with client(served) as other:
        with connect(f'ws://{served.place}/', subprotocols=[PROTOCOL]) as socket:
            socket.send(b'\xc1')
            with pytest.raises(ConnectionClosedError):
                list(socket)
        wait_for(lambda: caplog.records, what='the line')
        other()
    [record] = caplog.records
    assert record.getMessage().startswith('viewer: connection handler failed: ')
    assert record.exc_info is None


class WaitersByThread(collections.deque):
    """Stores the threads that look for waiters."""

    def __init__(self, waiters, threads):
        super().__init__(waiters)
        self._threads = threads

    def __iter__(self):
        self._threads.append(threading.current_thread())
        return super().__iter__()


def test_connections_are_woken_only_in_the_event_loop(served):
    """Another thread that iterates over the waiters could collide with a waiter that leaves."""
    server = served.server._websock_server
    with client(served), client(served):
        own = [state.message_buffer for state in server._client_state_from_id.values()]
        for buffer in (server._broadcast_buffer, *own):
            event, threads = buffer.message_event, []
            wait_for(lambda event=event: event._waiters, what='a connection that waits')
            event._waiters = WaitersByThread(event._waiters, threads)
            buffer.push(_messages.GuiUpdateMessage('none', {}))
            wait_for(lambda threads=threads: threads, what='the wake-up')
            assert threading.current_thread() not in threads
