"""The sliders of the live page."""

import math
from dataclasses import replace

import pytest
from browsing import receive
from parts import DIMENSIONS

from ballbot_ros.viewer.page import Page
from ballbot_ros.viewer.tuning_sliders import RESTORE, Tunable, TuningSliders

GAIN = Tunable('k_i', 'a gain [V]', -1e9, 1e9, (-0.5,), (-0.4,))
ROW = Tunable('k_f', 'gains', -math.inf, math.inf, (1.0, 2.0), (1.0, 2.0), is_array=True)
WHOLE = Tunable('dst_thr', 'a distance [cm]', -1, 255, (30,), (30,), is_whole=True)


class Shown:
    """Sliders on a page, and what a browser does to them."""

    def __init__(self, server):
        self.server = server
        self.sliders = TuningSliders(server.gui)

    @property
    def inputs(self):
        return {each.label: each for each in self.server.gui._gui_input_handle_from_uuid.values()}

    def values(self):
        return {
            label: each.value
            for label, each in self.inputs.items()
            if label not in ('View', RESTORE)
        }

    def move(self, *moves):
        receive(self.server, *((self.inputs[label], value) for label, value in moves))

    def settle(self, condition):
        """Wait for callbacks, which run in a pool of threads."""
        from graph import wait_for

        wait_for(condition, what='the sliders')


@pytest.fixture
def shown():
    page = Page(DIMENSIONS, 'test', '127.0.0.1', 0)
    yield Shown(page.server)
    page.stop()


def test_a_slider_for_each_number_shows_the_present_value(shown):
    assert not shown.sliders._folder.visible
    shown.sliders.show([GAIN, ROW, WHOLE])
    assert shown.values() == {'k_i': -0.4, 'k_f[0]': 1.0, 'k_f[1]': 2.0, 'dst_thr': 30}
    assert shown.inputs['k_i'].hint == 'a gain [V]'
    assert shown.sliders._folder.visible
    shown.sliders.show([WHOLE])
    assert shown.values() == {'dst_thr': 30}
    shown.sliders.show([])
    assert shown.values() == {}
    assert not shown.sliders._folder.visible


def test_the_newest_position_of_each_slider_is_wanted_once(shown):
    shown.sliders.show([GAIN, ROW])
    shown.move(('k_i', -0.3), ('k_i', -0.2), ('k_f[1]', 3.0))
    wanted = {}
    shown.settle(lambda: wanted.update(shown.sliders.take()) or len(wanted) == 2)
    shown.settle(lambda: wanted.update(shown.sliders.take()) or wanted['k_i'] == (-0.2,))
    assert wanted == {'k_i': (-0.2,), 'k_f': (1.0, 3.0)}
    assert shown.sliders.take() == {}


def test_a_number_outside_the_slider_is_taken_back(shown):
    """The page lets users type any number next to a slider, and may lose its sign."""
    shown.sliders.show([GAIN, ROW])
    shown.move(('k_i', -0.3), ('k_i', 0.3))
    shown.settle(lambda: shown.values()['k_i'] == -0.3)
    assert shown.sliders.take() == {'k_i': (-0.3,)}


def test_sliders_follow_other_changes_without_asking_for_them(shown):
    shown.sliders.show([GAIN, ROW])
    shown.sliders.follow({'k_i': (5.0,), 'k_f': (1.5, -9.0), 'other': (1.0,)})
    assert shown.values() == {'k_i': 5.0, 'k_f[0]': 1.5, 'k_f[1]': -9.0}
    assert shown.inputs['k_i'].max >= 5.0
    assert shown.inputs['k_f[1]'].min <= -9.0
    receive(shown.server)
    assert shown.sliders.take() == {}


def test_a_button_goes_back_to_the_start_of_the_run(shown):
    shown.sliders.show([GAIN, ROW, replace(WHOLE, value=(40,))])
    shown.move((RESTORE, True))
    wanted = {}
    shown.settle(lambda: wanted.update(shown.sliders.take()) or len(wanted) == 2)
    assert wanted == {'k_i': (-0.5,), 'dst_thr': (30,)}
    assert shown.values() == {'k_i': -0.5, 'k_f[0]': 1.0, 'k_f[1]': 2.0, 'dst_thr': 30}
