"""The page that runs the robot in a browser: the same bits, pushes, branches, no other host."""

import contextlib
import functools
import http.server
import subprocess
import sys
import threading

import pytest
from browsing import DRAW_ON_DEMAND, shared_browser
from graph import LAST_RESORT_S
from playground_python import PLAYGROUND, load

from ballbot_ros.engine.golden import load_golden

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures('needs_browser')]

session = load('session.py')

DESKTOP = {'viewport': {'width': 1280, 'height': 800}, 'color_scheme': 'dark'}
PHONE = {'viewport': {'width': 390, 'height': 844}, 'has_touch': True, 'is_mobile': True}

BRANCH_S = 2.0


class QuietHandler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *values):
        pass


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    """Return the address of the page; skip where its packages of npm cannot be had."""
    folder = tmp_path_factory.mktemp('site') / 'page'
    command = [sys.executable, PLAYGROUND / 'build.py', folder]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if 'npm' in done.stderr and done.returncode == 2:
        pytest.skip(done.stderr)
    assert done.returncode == 0, done.stderr
    handler = functools.partial(QuietHandler, directory=folder)
    with http.server.ThreadingHTTPServer(('127.0.0.1', 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f'http://127.0.0.1:{server.server_port}/'
        server.shutdown()
        thread.join()


@contextlib.contextmanager
def opened(site, options):
    """Open the page; it must not complain, and ask no other host."""
    with shared_browser() as browser, contextlib.closing(browser.new_context(**options)) as context:
        page = context.new_page()
        page.add_init_script(DRAW_ON_DEMAND)
        page.set_default_timeout(LAST_RESORT_S * 1e3)
        faults = []
        page.on('console', lambda m: m.type in ('error', 'warning') and faults.append(m.text))
        page.on('pageerror', lambda error: faults.append(str(error)))
        page.on('request', lambda r: r.url.startswith((site, 'blob:')) or faults.append(r.url))
        page.goto(site)
        page.wait_for_function('window.ballbot?.isReady')
        yield page
        assert not [fault for fault in faults if 'GPU stall' not in fault]


@pytest.fixture(scope='module')
def desktop(site):
    """Return the page, opened once, because its Python takes seconds to start."""
    with opened(site, DESKTOP) as page:
        yield page


@pytest.fixture
def page(desktop):
    """Return the page at the start of a run of `stationary`."""
    start(desktop, 'stationary')
    return desktop


def start(page, scenario):
    if page.locator('#scenario').input_value() == scenario:
        press(page, 'Start again')
    else:
        page.locator('#scenario').select_option(scenario)
    page.wait_for_function('ballbot.rows.length > 0')


def runs_for(page, seconds):
    """Wait until the run is this long [s]."""
    page.wait_for_function(f'ballbot.rows.at(-1)?.time >= {seconds}')


def go_back(page, seconds):
    page.locator('#time').evaluate(
        "(slider, time) => { slider.value = time; slider.dispatchEvent(new Event('input')); }",
        seconds,
    )


def press(page, name):
    page.get_by_role('button', name=name, exact=True).click()


def test_the_page_computes_the_same_bits(page):
    press(page, 'Compute the hash')
    page.wait_for_selector('#hash[data-kind]')
    text = page.locator('#hash').inner_text()
    assert load_golden().scenarios['stationary'] in text
    assert text.startswith('✓')
    found = page.evaluate("ballbot.hash('hardware_standing', 10)")
    assert found['hash'] == session.duty_sha256('hardware_standing', 10.0)
    assert found['golden'] == load_golden().scenarios['hardware_standing']
    start(page, 'remote_wall')
    runs_for(page, 2.0)
    rows = session.Session('remote_wall').advance(500)
    names = page.evaluate('Object.keys(ballbot.rows[0])')
    shown = page.evaluate('ballbot.rows.slice(0, 500).flatMap((row) => Object.values(row))')
    assert len(names) == len(session.ROW)
    assert shown == rows.tolist()


def test_a_branch_repeats_the_run_and_the_ghost_is_the_run_before(page):
    runs_for(page, BRANCH_S + 2.0)
    go_back(page, BRANCH_S)
    before = page.evaluate('ballbot.rows')
    press(page, 'Go on')
    page.wait_for_function('ballbot.ghost.length')
    runs_for(page, BRANCH_S + 1.0)
    branch, ghost = page.evaluate('[ballbot.rows, ballbot.ghost]')
    earlier = [row for row in before if row['time'] >= BRANCH_S]
    assert earlier
    assert ghost[: len(earlier)] == earlier  # a few ticks may have come after `before`
    length = min(len(branch), len(before))
    assert branch[:length] == before[:length]


def test_the_gain_makes_it_ring_in_a_branch(page):
    runs_for(page, BRANCH_S)
    go_back(page, 1.0)
    page.locator('#gain').fill('1.5')
    page.wait_for_function("document.getElementById('ringing').textContent.includes('Rings')")
    rows = page.evaluate('ballbot.rows')
    assert {row['gain'] for row in rows if row['time'] < 1.0} == {1.0}
    assert {row['gain'] for row in rows if row['time'] >= 1.0} == {1.5}
    go_back(page, 0.5)
    assert page.locator('#gain').input_value() == '1'


def test_dragging_the_robot_pushes_it_and_the_stick_drives_it(page):
    drag_and_drive(page)


def test_a_phone_pushes_and_drives_it_too(site):
    with opened(site, PHONE) as page:
        drag_and_drive(page)
        assert page.evaluate('document.documentElement.scrollWidth') <= PHONE['viewport']['width']


def drag_and_drive(page):
    runs_for(page, 2.5)
    x, y = page.evaluate('ballbot.robotOnScreen()')
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 30, y, steps=4)
    page.get_by_text('A push of').wait_for()
    page.mouse.up()
    page.wait_for_function('ballbot.rows.some((row) => Math.abs(row.pitchY) > 0.01)')
    start(page, 'stationary')
    box = page.locator('.stick').bounding_box()
    middle = box['x'] + box['width'] / 2.0, box['y'] + box['height'] / 2.0
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + box['width'] / 2.0, middle[1])
    page.wait_for_function('ballbot.rows.at(-1)?.y > 0.1')
    page.mouse.up()


def test_falling_ends_the_run_until_one_goes_back(page):
    runs_for(page, 1.0)
    page.locator('#gain').fill('0.4')
    page.get_by_text('It has fallen').wait_for()
    length = page.evaluate('ballbot.rows.length')
    go_back(page, 1.0)
    page.locator('#gain').fill('1')
    page.wait_for_function(f'ballbot.ghost.length && ballbot.rows.length < {length}')
    runs_for(page, 1.5)
    assert not page.get_by_text('It has fallen').is_visible()
