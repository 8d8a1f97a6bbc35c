"""A gamepad that is connected and removed, with a fake library; and tests of the real one."""

import contextlib
import threading
from pathlib import Path

import pytest
from graph import wait_for

from ballbot_ros.errors import TeleopError
from ballbot_ros.nodes.teleop import gamepad
from ballbot_ros.nodes.teleop.gamepad import NO_MAPPING, Gamepad, GamepadDevice, GamepadState

PAD = GamepadDevice(0, 'Fancy Pad', True)
OTHER = GamepadDevice(1, 'Plain Joystick', True)
UNKNOWN = GamepadDevice(0, 'Strange Thing', False)
FORWARD = GamepadState([0.0, 1.0, 0.0, 0.0, 0.0, 0.0], [0] * 15)


class FakePad:
    def __init__(self, backend, device):
        self.backend, self.device = backend, device

    def attached(self):
        return self.device in self.backend.present

    def read(self):
        return FORWARD


class FakeBackend:
    def __init__(self, *present, broken=()):
        self.present, self.broken = list(present), broken
        self.threads, self.polls, self.stopped = set(), 0, False

    def start(self):
        self.threads.add(threading.get_ident())

    def pump(self):
        self.threads.add(threading.get_ident())
        self.polls += 1

    @property
    def devices(self):
        return list(self.present)

    def open(self, device):
        if device in self.broken:
            raise TeleopError('permission denied')
        return FakePad(self, device)

    def stop(self):
        self.stopped = True


class Listener:
    """Stores the reports of a gamepad."""

    def __init__(self):
        self.states, self.gone, self.problems = [], 0, []

    def leave(self):
        self.gone += 1


@pytest.fixture
def listener():
    return Listener()


@pytest.fixture
def open_gamepad(listener):
    with contextlib.ExitStack() as stack:

        def start(wanted, backend):
            gamepad = Gamepad(
                wanted,
                backend,
                on_state=listener.states.append,
                on_disconnected=listener.leave,
                on_problem=listener.problems.append,
            )
            stack.callback(gamepad.close)
            return gamepad

        yield start


def test_the_first_pad_is_read_on_one_thread_of_its_own(open_gamepad, listener):
    backend = FakeBackend(PAD, OTHER)
    gamepad = open_gamepad('any', backend)
    wait_for(lambda: len(listener.states) > 3)
    assert set(map(id, listener.states)) == {id(FORWARD)}
    assert gamepad.name == PAD.name
    gamepad.close()
    assert backend.stopped
    assert listener.gone == 1
    assert len(backend.threads) == 1
    assert threading.get_ident() not in backend.threads


def test_a_pad_that_is_unplugged_is_released_and_the_next_one_is_opened(open_gamepad, listener):
    backend = FakeBackend(PAD)
    gamepad = open_gamepad('any', backend)
    wait_for(lambda: listener.states)
    backend.present = []
    wait_for(lambda: listener.gone == 1)
    assert gamepad.name == ''
    told = len(listener.states)
    backend.present = [OTHER]
    wait_for(lambda: len(listener.states) > told)
    assert gamepad.name == OTHER.name


@pytest.mark.parametrize(('wanted', 'name'), [('plain', OTHER.name), ('1', OTHER.name)])
def test_a_pad_is_chosen_by_name_or_number(open_gamepad, listener, wanted, name):
    gamepad = open_gamepad(wanted, FakeBackend(PAD, OTHER))
    wait_for(lambda: listener.states)
    assert gamepad.name == name


def test_an_unwanted_pad_is_left_alone(open_gamepad, listener):
    backend = FakeBackend(PAD)
    open_gamepad('plain', backend)
    wait_for(lambda: backend.polls > 5)
    assert listener.states == []


@pytest.mark.parametrize(
    ('device', 'broken', 'told'),
    [(UNKNOWN, (), f'Strange Thing: {NO_MAPPING}'), (PAD, (PAD,), 'Fancy Pad: permission denied')],
)
def test_an_unusable_pad_is_reported_once_and_another_is_opened(
    open_gamepad, listener, device, broken, told
):
    backend = FakeBackend(device, broken=broken)
    open_gamepad('any', backend)
    wait_for(lambda: backend.polls > 5)
    assert listener.problems == [told]
    backend.present.append(OTHER)
    wait_for(lambda: listener.states)


def test_the_list_shows_number_name_and_mapping():
    assert gamepad.describe([]) == ['no gamepad found']
    assert gamepad.describe([UNKNOWN, OTHER]) == [
        f'0  Strange Thing  {NO_MAPPING}',
        '1  Plain Joystick  mapping known',
    ]
    backend = FakeBackend(PAD)
    line = gamepad.input_line(PAD, FakePad(backend, PAD))
    assert line == '0  axes +0.00 +1.00 +0.00 +0.00 +0.00 +0.00  buttons -'
    assert gamepad.wait_for_devices(backend) == [PAD]


def test_sdl_starts_and_stops_on_a_thread_without_a_display(open_gamepad, listener):
    pytest.importorskip('pygame')
    from ballbot_ros.nodes.teleop.gamepad import SdlBackend

    backend = SdlBackend()
    polls = []
    pump = backend.pump
    backend.pump = lambda: (pump(), polls.append(1))
    open_gamepad('a name that no pad has', backend)
    wait_for(lambda: len(polls) > 5)
    assert listener.problems == []


@pytest.mark.skipif(not Path('/dev/uinput').exists(), reason='needs /dev/uinput')
def test_a_virtual_pad_is_read_end_to_end(open_gamepad, listener):
    pytest.importorskip('pygame')
    evdev = pytest.importorskip('evdev')
    from evdev import AbsInfo
    from evdev import ecodes as e

    from ballbot_ros.nodes.teleop.gamepad import SdlBackend

    axis = AbsInfo(value=0, min=-32768, max=32767, fuzz=0, flat=0, resolution=0)
    abilities = {
        e.EV_ABS: [(code, axis) for code in (e.ABS_X, e.ABS_Y, e.ABS_RX, e.ABS_RY)],
        e.EV_KEY: [e.BTN_SOUTH, e.BTN_EAST, e.BTN_NORTH, e.BTN_WEST, e.BTN_TL, e.BTN_TR],
    }
    # The identifier of a pad that SDL knows.
    identity = {'name': 'Microsoft X-Box 360 pad', 'vendor': 0x045E, 'product': 0x028E}
    with evdev.UInput(abilities, version=0x110, **identity) as device:
        open_gamepad('360', SdlBackend())
        wait_for(lambda: listener.states)
        device.write(e.EV_ABS, e.ABS_Y, -32768)
        device.syn()
        wait_for(lambda: listener.states[-1].axes[1] == pytest.approx(1.0, abs=1e-3))
    wait_for(lambda: listener.gone)
