"""The plots in a browser: choice, zoom and linked cursor."""

import math

import numpy as np
import pytest

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures('needs_browser')]

from browsing import browsing, wait_until  # noqa: E402

import ballbot_ros as bb  # noqa: E402
from ballbot_ros.viewer.page import Page  # noqa: E402
from ballbot_ros.viewer.playback_run import PlaybackRun  # noqa: E402
from ballbot_ros.viewer.plots import CHOOSER, PLOT_KINDS, Plots, plot_data  # noqa: E402  # noqa: E402
from ballbot_ros.viewer.recording_page import RecordingPage  # noqa: E402

IMU = '/plant/imu'
DEFAULT = ['body pitch [°]', 'position [cm]', 'duty [%]', 'sonar [cm]']


class ShownPlots:
    """The plots on a page, as a user sees and uses them."""

    def __init__(self, browser):
        self.browser = browser
        self.page = browser.page

    def titles(self):
        return self.page.locator('.u-title').all_inner_texts()

    def enlarge(self, title):
        """Open the enlarged plot of a title; return its line at the position of playback."""
        plot = self.page.locator('.uplot-container', has_text=title)
        plot.hover()
        plot.get_by_role('button').click()
        return self.page.locator('.mantine-Modal-root .playhead')

    def values(self, number):
        """Return the values in the legend of a plot, the time first; '' for none."""
        cells = self.page.locator('.uplot').nth(number).locator('.u-value').all_inner_texts()
        return [cell.strip('- ') for cell in cells]

    def point(self, number, share):
        """Return the pixel in a plot at a share of its width."""
        area = self.page.locator('.u-over').nth(number)
        area.scroll_into_view_if_needed()
        box = area.bounding_box()
        return box['x'] + share * box['width'], box['y'] + box['height'] / 2.0

    def point_at(self, number, share):
        """Move the mouse over a plot."""
        self.page.mouse.move(*self.point(number, share))

    def zoom(self, number, first, last):
        self.point_at(number, first)
        self.page.mouse.down()
        self.page.mouse.move(*self.point(number, last), steps=4)
        self.page.mouse.up()

    def reset(self, number):
        self.page.mouse.dblclick(*self.point(number, 0.5))

    def time_at(self, number, share):
        """Return the time under the mouse, which it moves over a plot; None without one."""
        self.point_at(number, share)
        value = self.values(number)[0]
        return float(value) if value else None

    def shows(self, number, first, last):
        """Return whether a plot reaches from about the time `first` to `last`."""
        ends = self.time_at(number, 0.01), self.time_at(number, 0.99)
        return None not in ends and np.allclose(ends, (first, last), atol=0.03 * (last - first))


@pytest.fixture
def recording_page(recording):
    run = PlaybackRun(recording)
    page = Page(run.dimensions, run.name, '127.0.0.1', 0)
    shown = RecordingPage(page, [run, run])
    shown.clock.is_playing = False
    shown.show(5.0, panel=True)
    yield shown, page
    page.stop()


def test_plots_of_a_recorded_run_share_cursor_and_zoom(recording_page):
    shown, page = recording_page
    with browsing(page.address) as browser:
        plots = ShownPlots(browser)
        wait_until(lambda: plots.titles() == DEFAULT, browser)
        wait_until(lambda: plots.shows(0, 0.0, 10.0), browser)
        seen = []
        for share in (0.3, 0.6):
            plots.point_at(0, share)
            seen.append([plots.values(number) for number in range(len(DEFAULT))])
        for before, after in zip(*seen, strict=True):
            assert before[0] != after[0]
            assert all(before[1:])
            assert before[1:] != after[1:]
        assert len({values[0] for values in seen[0]}) == 1
        ghost, actual = seen[0][2][1:3], seen[0][2][3:]
        assert ghost == actual
        plots.zoom(1, 0.5, 0.75)
        for number in range(len(DEFAULT)):
            wait_until(lambda number=number: plots.shows(number, 5.0, 7.5), browser)
        shown.show(9.0, panel=True)
        assert plots.shows(0, 5.0, 7.5)
        plots.reset(2)
        wait_until(lambda: plots.shows(0, 0.0, 10.0), browser)
        assert browser.errors == []


def test_plots_can_be_chosen_and_enlarged(recording_page, recording):
    shown, page = recording_page
    with browsing(page.address) as browser:
        plots = ShownPlots(browser)
        wait_until(lambda: plots.titles() == DEFAULT, browser)
        browser.open(CHOOSER)
        for label in ('battery [V]', 'duty [%]'):
            browser.page.get_by_label(label).click()

        def is_changed():
            shown.show(5.0, panel=True)
            return plots.titles() == [*DEFAULT[:2], DEFAULT[3], 'battery [V]']

        wait_until(is_changed, browser)
        wait_until(lambda: plots.time_at(3, 0.5) is not None, browser)
        assert plots.values(3)[1:] == ['8', '8']

        browser.press(IMU)
        browser.wait_for_text('never changes: angular_velocity_z_rad_per_s 0, ')
        assert browser.page.get_by_label('angular_velocity_z_rad_per_s').count() == 0
        browser.page.get_by_label('pitch_y_rad').click()
        title = f'{IMU} pitch_y_rad'

        def is_added():
            shown.show(5.0, panel=True)
            return plots.titles()[4:] == [title]

        wait_until(is_added, browser)
        wait_until(lambda: plots.time_at(4, 0.5) is not None, browser)
        time, *values = plots.values(4)
        pitch = bb.open(recording).frame()['pitch_y_deg']
        expected = math.radians(pitch.iloc[pitch.index.get_indexer([float(time)], 'nearest')[0]])
        assert [float(each) for each in values] == pytest.approx([abs(expected)] * 2, rel=0.01)
        assert plots.shows(4, 0.0, 10.0)

        playhead = plots.enlarge(title)
        shown.update(0.0)
        playhead.wait_for()
        width = browser.page.locator('.mantine-Modal-root .u-over').bounding_box()['width']
        for time in (5.0, 7.5):
            shown.clock.seek(time)
            shown.update(0.0)
            expected = pytest.approx(width * time / 10.0, abs=2)
            wait_until(lambda expected=expected: place(playhead) == expected, browser)
        assert browser.errors == []


def place(playhead):
    """Return the distance of a playhead from the left end of its plot [px]."""
    return float(playhead.evaluate('line => new DOMMatrix(line.style.transform).e'))


def test_the_zoom_of_a_live_run_moves_with_it(recording):
    dimensions = PlaybackRun(recording).dimensions
    page = Page(dimensions, 'test', '127.0.0.1', 0)
    plots = Plots(page.server.gui, PLOT_KINDS[:1])

    def show(end):
        time = np.linspace(end - 10.0, end, 500)
        pitch = np.where(time > end - 1.0, np.nan, np.sin(time))
        plots.refresh(lambda kind: plot_data(kind, time, {'pitch_x_deg': pitch}))

    show(10.0)
    page.server.gui.add_html('state')
    with browsing(page.address) as browser:
        shown = ShownPlots(browser)
        wait_until(lambda: shown.titles() == DEFAULT[:1], browser)
        wait_until(lambda: shown.shows(0, 0.0, 10.0), browser)
        assert shown.values(0)[1] == ''  # there is no value at the end
        shown.zoom(0, 0.5, 0.7)
        wait_until(lambda: shown.shows(0, 5.0, 7.0), browser)
        show(13.0)
        wait_until(lambda: shown.shows(0, 8.0, 10.0), browser)
        shown.reset(0)
        wait_until(lambda: shown.shows(0, 3.0, 13.0), browser)
        assert browser.errors == []
    page.stop()


def test_a_page_without_the_token_has_plots_and_no_choice_of_them(recording_page):
    _, page = recording_page
    with browsing(page.address.partition('?')[0]) as browser:
        plots = ShownPlots(browser)
        wait_until(lambda: plots.titles() == DEFAULT, browser)
        browser.page.get_by_text(CHOOSER).wait_for(state='hidden')
        wait_until(lambda: plots.shows(0, 0.0, 10.0), browser)
        assert browser.errors == []
