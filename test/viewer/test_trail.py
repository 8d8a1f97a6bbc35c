"""The trail in the scene: only what changes is sent."""

import numpy as np

from ballbot_ros.viewer.shapes import Trail
from ballbot_ros.viewer.snapshot import TRAIL_PIECE

POINTS = [(0.01 * number, -0.02 * number) for number in range(4 * TRAIL_PIECE)]


class Line:
    """A line in the scene, which counts how often its points are set."""

    def __init__(self, points):
        self._points, self.sent, self.visible = points, 0, True

    @property
    def points(self):
        return self._points

    @points.setter
    def points(self, points):
        self._points = points
        self.sent += 1


class Scene:
    """The lines that a trail adds."""

    def __init__(self):
        self.lines = []
        self.trail = Trail(self, '/trail', (0, 0, 0), 0.5)

    def remove_by_name(self, name):
        pass

    def add_frame(self, name, **options):
        pass

    def add_line_segments(self, name, points, colour, thickness):
        self.lines.append(Line(points))
        return self.lines[-1]

    def shown(self):
        """Return the visible points, without the one that two pieces share."""
        segments = np.concatenate([line.points for line in self.lines if line.visible])
        np.testing.assert_array_equal(segments[1:, 0], segments[:-1, 1])
        assert (segments[:, :, 2] == 0.5).all()
        return np.concatenate([segments[:1, 0], segments[:, 1]])[:, :2]

    def sent(self):
        return [line.sent for line in self.lines]


def test_a_trail_is_one_line_whatever_its_length():
    scene = Scene()
    lengths = (2, TRAIL_PIECE, TRAIL_PIECE + 1, TRAIL_PIECE + 2, len(POINTS), 10, len(POINTS))
    for length in lengths:
        scene.trail.show(POINTS[:length])
        np.testing.assert_allclose(scene.shown(), POINTS[:length], rtol=1e-6)


def test_no_point_and_a_single_one_are_no_line():
    scene = Scene()
    for points in ([], POINTS[:1], POINTS[:5], POINTS[:1], []):
        scene.trail.show(points)
        assert any(line.visible for line in scene.lines) is (len(points) > 1)


def test_only_the_last_piece_of_a_growing_trail_is_sent_again():
    scene = Scene()
    scene.trail.show(POINTS[: 3 * TRAIL_PIECE + 10])
    scene.trail.show(POINTS[: 3 * TRAIL_PIECE + 20])
    scene.trail.show(POINTS[: 3 * TRAIL_PIECE + 20])
    assert scene.sent() == [1, 1, 1, 2]


def test_pieces_come_back_without_being_sent_again():
    scene = Scene()
    scene.trail.show(POINTS)
    scene.trail.show(POINTS[:TRAIL_PIECE])
    scene.trail.show(POINTS)
    assert scene.sent() == [3, 1, 1, 1]
