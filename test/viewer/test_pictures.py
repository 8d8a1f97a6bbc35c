"""The five views, compared with reference pictures checked by eye.

To renew them after a change of the scene, delete them, run this test, and check the new ones.
"""

from pathlib import Path

import numpy as np
import pytest
from browsing import shared_page
from PIL import Image

from ballbot_ros.viewer.offscreen import offscreen_scene
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.views import VIEWS

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures('needs_browser')]

REFERENCE = Path(__file__).with_name('reference')
SIZE = (240, 132)
TOLERANCE = 4.0
"""Mean difference of gray values; other versions of the browser differ in the edges."""


@pytest.fixture(scope='module')
def pictures(recording):
    from ballbot_ros.viewer import render

    made = render.frames(PlaybackRun(recording), [(view, 9.0) for view in VIEWS])
    return {
        view: Image.fromarray(picture).resize(SIZE)
        for view, picture in zip(VIEWS, made, strict=True)
    }


def difference(a, b):
    return float(np.abs(np.asarray(a, float) - np.asarray(b.convert('RGB'), float)).mean())


@pytest.mark.parametrize('view', VIEWS)
def test_a_view_equals_its_reference_picture(view, pictures):
    path = REFERENCE / f'{view}.png'
    if not path.exists():
        pictures[view].save(path)
        pytest.fail(f'{path.name} was not there: look at the new one')
    assert difference(pictures[view], Image.open(path)) < TOLERANCE


def test_all_views_differ(pictures):
    for view in VIEWS:
        others = [difference(pictures[view], pictures[other]) for other in VIEWS if other != view]
        assert min(others) > 2.0 * TOLERANCE


def test_a_slow_machine_does_not_lower_the_resolution(monkeypatch):
    monkeypatch.setattr('ballbot_ros.viewer.offscreen.browser_page', shared_page)
    with offscreen_scene(*SIZE) as offscreen:
        assert 'fixedDpr=1' in offscreen._browser.evaluate('location.search')
