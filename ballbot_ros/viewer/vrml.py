"""The robot and the document's five viewpoints (8.3) in VRML 2.0, for the file with the map.

Lengths are in centimetres and y is up: x of ``map`` is x, y of ``map`` is -z. A Transform is named
after each frame of docs/frames.md. Programs move the robot by ``base_footprint.translation``, and
the viewpoints that follow it move with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ballbot_ros.parameters import Dimensions
from ballbot_ros.recording.messages.tool_messages import FOOTPRINT
from ballbot_ros.robot.world.floor_map import FloorMap
from ballbot_ros.viewer import robot
from ballbot_ros.viewer.markers import Area
from ballbot_ros.viewer.robot import MAP, SONAR, Colour, Part
from ballbot_ros.viewer.snapshot import Snapshot
from ballbot_ros.viewer.views import CHASER_1, CHASER_2, ROBOT, TOP, VISTA, Camera, camera

VIEWPOINTS = {
    TOP: ('Top View', MAP),
    VISTA: ('Vista View', MAP),
    CHASER_1: ('Chaser View 1', FOOTPRINT),
    CHASER_2: ('Chaser View 2', FOOTPRINT),
    ROBOT: ('Robot View', SONAR),
}
"""The document's name of each view, and the frame that its camera is fixed to."""

_START = Snapshot(0.0, (0.0, 0.0), (0.0, 0.0))


def robot_nodes(floor_map: FloorMap, dimensions: Dimensions) -> str:
    """Return the nodes of ``map``, with the viewpoints and the robot upright in its middle."""
    # A vertex of the floor is the middle of its square, so the corner of the map is at -0.5.
    middle = (floor_map.columns - 1) / 2.0, 0.0, (floor_map.rows - 1) / 2.0
    poses = robot.poses_in_map(robot.Frames(dimensions).at(_START.position, _START.psi))
    # At the start the axes of all frames are parallel, so differences are positions in the parent.
    places = {MAP: np.zeros(3)} | {name: pose.position for name, pose in poses.items()}
    pieces = list(robot.parts(dimensions))
    area = Area.of(floor_map)

    def viewpoints(frame: str) -> Iterator[str]:
        for view, (name, carrier) in VIEWPOINTS.items():
            if carrier == frame:
                # VRML's field of view is that of the shorter side, whatever the window.
                seen = camera(view, _START, dimensions, area, aspect=1.0)
                yield (
                    f'DEF {name.replace(" ", "_")} Viewpoint {{ description "{name}" '
                    f'position {_cm(seen.position - places[frame])} '
                    f'orientation {_turn(_direction(seen))} fieldOfView {_text([seen.fov])} }}'
                )

    def content(frame: str) -> Iterator[str]:
        yield from viewpoints(frame)
        yield from (_shape(part) for part in pieces if part.link == frame)
        for child, parent in robot.PARENTS.items():
            if parent == frame:
                at = _cm(places[child] - places[frame])
                yield f'DEF {child} Transform {{ translation {at} children ['
                yield from (f'  {line}' for line in content(child))
                yield '] }'

    return '\n'.join(
        (
            f'Background {{ skyColor {_colour(robot.HORIZON)} }}',
            # The light of a camera that looks ahead does not reach the floor.
            'NavigationInfo { headlight FALSE }',
            'DirectionalLight { direction 0.2 -1 0.1 intensity 0.8 }',
            'DirectionalLight { direction 0.5 -0.2 -1 intensity 0.6 }',
            'DirectionalLight { direction -0.8 -0.2 0.7 intensity 0.6 }',
            f'DEF {MAP} Transform {{ translation {_text(middle)} children [',
            *content(MAP),
            '] }\n',
        )
    )


def _shape(part: Part) -> str:
    width, *rest = 100.0 * np.array(part.size)
    if part.shape == 'box':
        breadth, height = rest
        geometry = f'Box {{ size {_text([width, height, breadth])} }}'
    elif part.shape == 'cylinder':
        geometry = f'Cylinder {{ radius {_text([width])} height {_text(rest)} }}'
    else:
        geometry = f'Sphere {{ radius {_text([width])} }}'
    rotation = Rotation.from_euler('xyz', part.rpy)
    return (
        f'Transform {{ translation {_cm(part.position)} rotation {_turn(rotation)} '
        f'children Shape {{ geometry {geometry} '
        f'appearance Appearance {{ material Material {{ diffuseColor {_colour(part.colour)} }} }} '
        '} }'
    )


def _direction(seen: Camera) -> Rotation:
    """Return the rotation in ``map`` of VRML's camera, which looks along +y of ``map``, up +z."""
    ahead = np.subtract(seen.look_at, seen.position)
    right = np.cross(ahead, seen.up)
    axes = np.column_stack([right, ahead, np.cross(right, ahead)])
    return Rotation.from_matrix(axes / np.linalg.norm(axes, axis=0))


def _cm(vector: ArrayLike) -> str:
    return _text(100.0 * _in_vrml(vector))


def _turn(rotation: Rotation) -> str:
    turn = rotation.as_rotvec()
    angle = float(np.linalg.norm(turn))
    return _text([*_in_vrml(turn / angle if angle else (0.0, 0.0, 1.0)), angle])


def _in_vrml(vector: ArrayLike) -> NDArray[np.float64]:
    x, y, z = np.asarray(vector, np.float64)
    return np.array([x, z, -y])


def _colour(colour: Colour) -> str:
    return _text([channel / 255.0 for channel in colour])


def _text(numbers: Iterable[float]) -> str:
    return ' '.join(f'{round(number, 6) + 0.0:.9g}' for number in numbers)
