"""The picture of a run: all its text is legible."""

from itertools import combinations

import numpy as np
from matplotlib.text import Annotation

from ballbot_ros.analysis.drawing import draw_motion
from ballbot_ros.analysis.figure_parts import png_of
from ballbot_ros.engine.scenario.reader import load_scenario, scenario_names
from ballbot_ros.engine.scenario.scenario import Segment
from ballbot_ros.engine.trajectory import Trajectory

LONGEST = max((f'{name}: {load_scenario(name).purpose}' for name in scenario_names()), key=len)


def draw(title='', segments=(), duration=2.0):
    """Return the figure of a trajectory, as written to a file."""
    time = np.linspace(0.0, duration, 501)
    # Curves fill the axes to every corner: wherever a legend might be, there is a curve.
    angle = time * 40.0 / duration
    waves = np.stack([np.sin(angle), np.cos(angle)], axis=1) * 0.02
    trajectory = Trajectory(time, waves, waves, (waves * 5000.0).astype(np.int8))
    figure = draw_motion(trajectory, title, 1.0, segments)
    assert png_of(figure).startswith(b'\x89PNG')
    figure.draw_without_rendering()  # Positions at the figure's own resolution.
    return figure


def test_the_longest_shipped_heading_is_not_cut_off():
    figure = draw(LONGEST)
    extent = figure._suptitle.get_window_extent()
    assert 0.0 <= extent.x0 < extent.x1 <= figure.bbox.x1
    assert ' '.join(figure.get_suptitle().split()) == LONGEST


def test_the_legend_covers_no_curve():
    axes = draw().axes
    legends = [each.get_legend() for each in axes if each.get_legend()]
    assert legends
    for legend in legends:
        assert not any(legend.get_window_extent().overlaps(each.bbox) for each in axes)


def test_a_dollar_sign_is_not_mathtext():
    draw(r'costs $5^ or {$6_', [Segment(r'$\forward$', ((0.5, 0.0), (1.5, 10.0)))])


def names(segments, duration=2.0):
    """Return the names above the curves, from left to right; none is written across another."""
    figure = draw(segments=segments, duration=duration)
    texts = figure.findobj(Annotation)
    extents = [text.get_window_extent() for text in texts]
    assert not any(one.overlaps(other) for one, other in combinations(extents, 2))
    return [text.get_text() for text in texts]


def test_names_without_room_are_left_out():
    def steps(name, *starts):
        return [Segment(name, ((start, 50.0), (start + 0.1, 50.0))) for start in starts]

    assert names(steps('right', 1.0, 1.5)) == ['calibration', 'right', 'right']
    assert names(steps('backward', 1.2, 1.3, 1.4)) == ['calibration', 'backward']
    # Both sticks swing all the time.
    assert names(load_scenario('excitation').segments, 40.0) == ['calibration']
