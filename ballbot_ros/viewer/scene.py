"""The scene: floor, walls, lines, robots and trails; and the panel next to it."""

from __future__ import annotations

import base64
import io
import math
import time
import wave
from collections.abc import Callable, Coroutine
from functools import cache
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from viser import MeshHandle, SceneApi, SceneNodeDragEvent

from ballbot_ros.parameters import Dimensions
from ballbot_ros.recording.messages.conversions import body_orientation
from ballbot_ros.robot.brick.brick import COLUMNS, ROWS, Tone
from ballbot_ros.robot.world.floor_map import WALL_HEIGHT_CM, FloorMap
from ballbot_ros.viewer import markers as floor
from ballbot_ros.viewer import robot as colours
from ballbot_ros.viewer import shapes
from ballbot_ros.viewer.robot import (
    BALL,
    BODY,
    LCD_SIZE,
    LINKS,
    WHEEL_X,
    WHEEL_Y,
    WHITE,
    Colour,
    cone_slope,
    grip,
    lcd_position,
    parts,
    sonar_position,
    wheel_centres,
    wxyz,
)
from ballbot_ros.viewer.shapes import ForceArrow, Points, Trail, line_mesh
from ballbot_ros.viewer.snapshot import Snapshot
from ballbot_ros.viewer.views import RollingOrientation, body_rotation

_PAPER, _INK = (176, 196, 168), (24, 34, 30)
_CELL = (15, 22)
_MARGIN = 8


@cache
def _font() -> ImageFont.FreeTypeFont:
    # Use the monospaced font of matplotlib; Pillow ships none.
    from matplotlib.font_manager import findfont

    return ImageFont.truetype(findfont('DejaVu Sans Mono'), 24)


def _lcd_image(page: str) -> NDArray[np.uint8]:
    """Return the display with a page of text, shape (rows, columns, 3)."""
    size = (COLUMNS * _CELL[0] + 2 * _MARGIN, ROWS * _CELL[1] + 2 * _MARGIN)
    image = Image.new('RGB', size, _PAPER)
    draw = ImageDraw.Draw(image)
    for row, line in enumerate(page.splitlines()[:ROWS]):
        draw.text((_MARGIN, _MARGIN - 3 + row * _CELL[1]), line[:COLUMNS], _INK, _font())
    return np.asarray(image)


_RATE = 8000
_MAX_TONE_S = 5.0


def tone_html(tone: Tone, number: int) -> str:
    """Return an HTML element that plays a tone once.

    Browsers play it only after a click on the page. The `number` differs from tone to tone, so that
    a repeated one plays again.
    """
    time = np.arange(round(min(tone.duration_ms * 1e-3, _MAX_TONE_S) * _RATE)) / _RATE
    loudness = min(max(tone.volume, 0), 100) / 100.0
    wave_form = np.sin(2.0 * np.pi * tone.frequency_hz * time)
    samples = np.round(127.5 + 60.0 * loudness * wave_form).astype(np.uint8)
    data = io.BytesIO()
    with wave.open(data, 'wb') as file:
        file.setnchannels(1)
        file.setsampwidth(1)
        file.setframerate(_RATE)
        file.writeframes(samples.tobytes())
    encoded = base64.b64encode(data.getvalue()).decode()
    return f'<audio autoplay data-number="{number}" src="data:audio/wav;base64,{encoded}"></audio>'


PERIOD = 12
"""Updates of the scene per update of the panel."""

_TONE_DELAY_S = 3.0
"""Maximum time after which a browser still starts a tone."""


class ScenePanel:
    """Operating state, display and tones."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._status = gui.add_html('', order=0.0)
        self._sound = gui.add_html('', order=100.0)
        self._tones = 0
        self._tone_end = math.inf

    def show(self, snapshot: Snapshot, factor: float | None = None) -> None:
        """Show the state; `factor` is the speed in multiples of real time, None to omit."""
        if time.monotonic() > self._tone_end:
            self._sound.content = ''  # browsers that connect later must not play an old tone
        rows = [('state', snapshot.state or '–'), ('sim time', f'{snapshot.time:.2f} s')]
        if factor is not None:
            rows.append(('real-time factor', f'{factor:.2f}'))
        battery = snapshot.battery
        rows.append(('battery', '–' if math.isnan(battery) else f'{battery:.2f} V'))
        self._status.content = _status(rows, snapshot.lcd)

    def clear(self) -> None:
        """Show that there is no state."""
        self._status.content = _status([('state', '–'), ('sim time', '–'), ('battery', '–')], '')
        self._sound.content = ''

    def play(self, tone: Tone) -> None:
        """Play a tone."""
        self._tones += 1
        self._sound.content = tone_html(tone, self._tones)
        self._tone_end = time.monotonic() + tone.duration_ms * 1e-3 + _TONE_DELAY_S


def _status(rows: list[tuple[str, str]], lcd: str) -> str:
    cells = ''.join(f'<tr><td>{name}</td><td>{value}</td></tr>' for name, value in rows)
    page = lcd.replace('&', '&amp;').replace('<', '&lt;')
    return f'<div class="status"><table>{cells}</table><pre>{page}</pre></div>'


GHOST_OPACITY = 0.35

HEADING_GAP, HEADING_LENGTH = 0.03, 0.07
"""Distance from the front of the body to the arrow that shows where forward is; its length [m]."""

_SKY_SHADES = 64

_LIFT = 1e-3
"""Height of lines above the floor [m], against flicker."""

# Images lie in the x-y plane with y down: this rotation makes them face +x, upright.
_FACES_FORWARD = (0.5, -0.5, -0.5, 0.5)


def _sky() -> NDArray[np.uint8]:
    """Return the background, paler towards the ground: a picture is drawn faster than a sphere."""
    shade = np.linspace(0.0, 1.0, _SKY_SHADES)[:, np.newaxis, np.newaxis]
    column = (1.0 - shade) * colours.ZENITH + shade * colours.HORIZON
    return np.repeat(column, 2, axis=1).astype(np.uint8)


class Scene:
    """Everything visible except the camera."""

    def __init__(self, api: SceneApi) -> None:
        self._api = api
        api.set_up_direction('+z')
        api.configure_default_lights(enabled=False)
        api.configure_environment_map(hdri=None)  # an environment map would weaken the shadows
        api.add_light_ambient('/lights/ambient', intensity=0.6)
        api.add_light_hemisphere(
            '/lights/sky', sky_color=(255, 255, 255), ground_color=(190, 180, 170), intensity=1.3
        )
        api.add_light_directional(
            '/lights/sun', color=(255, 248, 236), intensity=2.2, position=(-1.2, -1.8, 3.0),
            cast_shadow=True,
        )  # fmt: skip
        api.set_background_image(_sky(), format='png')
        self.show_floor(None)

    def show_floor(self, floor_map: FloorMap | None) -> None:
        """Show a map, or an unlimited floor."""
        self._api.remove_by_name('/floor')
        self._api.add_frame('/floor', show_axes=False)
        if floor_map is None:
            self._api.add_grid(
                '/floor/grid', infinite_grid=True, cell_size=0.1, section_size=0.5,
                cell_color=(222, 224, 228), section_color=(190, 194, 202), fade_distance=8.0,
                plane_color=colours.FLOOR, plane_opacity=1.0, shadow_opacity=0.25,
            )  # fmt: skip
            return
        area = floor.Area.of(floor_map)
        base = -area.half_x, -area.half_y, area.half_x, area.half_y
        self._add_prisms('base', [base], -0.02, 0.0, colours.FLOOR)
        if lines := line_mesh(floor_map):
            self._api.add_mesh_simple(
                '/floor/lines', *lines, color=colours.LINE, side='double', flat_shading=True,
                cast_shadow=False, position=(0.0, 0.0, _LIFT),
            )  # fmt: skip
        if walls := floor.walls(floor_map):
            self._add_prisms('walls', walls, 0.0, WALL_HEIGHT_CM / 100, colours.WALL)

    def _add_prisms(
        self, name: str, rectangles: list[floor.Rectangle], low: float, high: float, colour: Colour
    ) -> None:
        self._api.add_mesh_simple(
            f'/floor/{name}', *shapes.prisms(rectangles, low, high), color=colour,
            flat_shading=True, cast_shadow=high > 0.0,
        )  # fmt: skip

    def add_robot(self, name: str, dimensions: Dimensions, *, ghost: bool = False) -> DrawnRobot:
        """Add a robot, replacing one of that name; a ghost is transparent."""
        self._api.remove_by_name(f'/{name}')
        return DrawnRobot(self._api, name, dimensions, ghost=ghost)


class DrawnRobot:
    """A robot in the scene, with its trail; a ghost is transparent and has only its shape."""

    def __init__(self, api: SceneApi, name: str, dimensions: Dimensions, *, ghost: bool) -> None:
        self._dimensions = dimensions
        self._orientation = RollingOrientation(dimensions)
        self._root = api.add_frame(f'/{name}', show_axes=False, visible=False)
        paths = {
            BALL: f'/{name}/ball',
            BODY: f'/{name}/body',
            WHEEL_X: f'/{name}/body/wheel_x',
            WHEEL_Y: f'/{name}/body/wheel_y',
        }
        self._links = {link: api.add_frame(paths[link], show_axes=False) for link in LINKS}
        for link, at in zip((WHEEL_X, WHEEL_Y), wheel_centres(dimensions), strict=True):
            self._links[link].position = at
        self._body_meshes: list[MeshHandle] = []
        self._add_meshes(api, paths, ghost=ghost)
        self._cone = self._display = self._force = self._heading = None
        if not ghost:
            self._force = ForceArrow(api, f'{name}/force', with_size=False)
            self._heading = api.add_mesh_simple(
                f'/{name}/heading', *shapes.flat_arrow(), color=colours.HEADING,
                opacity=colours.HEADING_OPACITY, scale=HEADING_LENGTH, cast_shadow=False,
            )  # fmt: skip
            self._cone = api.add_mesh_simple(
                f'/{name}/body/cone', *shapes.unit_cone(), color=colours.BEAM,
                opacity=colours.BEAM_OPACITY, side='double', cast_shadow=False,
                receive_shadow=False, position=sonar_position(dimensions), visible=False,
            )  # fmt: skip
            self._display = api.add_image(
                f'/{name}/body/lcd', _lcd_image(''), *LCD_SIZE, format='png', cast_shadow=False,
                receive_shadow=False, position=lcd_position(dimensions), wxyz=_FACES_FORWARD,
            )  # fmt: skip
        self._page = ''
        colour = colours.GHOST_TRAIL if ghost else colours.TRAIL
        self._trail = Trail(api, f'/{name}_trail', colour, 2 * _LIFT)

    def _add_meshes(self, api: SceneApi, paths: dict[str, str], *, ghost: bool) -> None:
        opacity = GHOST_OPACITY if ghost else None
        meshes = shapes.link_meshes(part for part in parts(self._dimensions) if part.link != BALL)
        for number, ((link, colour), mesh) in enumerate(meshes.items()):
            handle = api.add_mesh_simple(
                f'{paths[link]}/{number}', *mesh, color=colours.GHOST if ghost else colour,
                opacity=opacity, flat_shading=True, cast_shadow=not ghost,
            )  # fmt: skip
            if link == BODY:
                self._body_meshes.append(handle)
        pair = next(part.colour for part in parts(self._dimensions) if part.link == BALL), WHITE
        halves = shapes.ball_sectors(self._dimensions.ball_radius)
        for number, (mesh, colour) in enumerate(zip(halves, pair, strict=True)):
            api.add_mesh_simple(
                f'{paths[BALL]}/{number}', *mesh, color=colours.GHOST if ghost else colour,
                opacity=opacity, cast_shadow=not ghost,
            )  # fmt: skip

    def on_drag(
        self, callback: Callable[[SceneNodeDragEvent[Any]], Coroutine[Any, Any, None]]
    ) -> None:
        """Call a coroutine for each event of a drag of the body with the left button."""
        for mesh in self._body_meshes:
            mesh.on_drag(callback)

    def show(self, snapshot: Snapshot) -> None:
        """Update the pose of the robot."""
        self._root.visible = True
        ball = snapshot.position[0], -snapshot.position[1], self._dimensions.ball_radius
        self._links[BALL].position = self._links[BODY].position = ball
        rolled = self._orientation.ball(snapshot.position)
        self._links[BALL].wxyz = wxyz(rolled) if snapshot.ball is None else snapshot.ball
        self._links[BODY].wxyz = body_orientation(snapshot.psi)
        rotations = self._orientation.wheels(snapshot.position, snapshot.psi)
        for link, rotation in zip((WHEEL_X, WHEEL_Y), rotations, strict=True):
            self._links[link].wxyz = wxyz(rotation)
        if self._cone is not None:
            self._cone.visible = echo = math.isfinite(snapshot.sonar) and snapshot.sonar > 0.0
            if echo:
                width = cone_slope(snapshot.cone_angle)
                self._cone.scale = (snapshot.sonar, snapshot.sonar * width, snapshot.sonar * width)
        if self._heading is not None:
            ahead = self._dimensions.body_depth / 2.0 + HEADING_GAP
            self._heading.position = (ball[0] + ahead, ball[1], 2.0 * _LIFT)
        if self._force is not None:
            self._show_force(self._force, np.array(ball), snapshot)
        if self._display is not None and snapshot.lcd != self._page:
            self._page = snapshot.lcd
            self._display.image = _lcd_image(snapshot.lcd)

    def hide(self) -> None:
        """Hide the robot and its trail until it is shown again."""
        self._root.visible = False
        self.show_trail([])

    def _show_force(self, arrow: ForceArrow, ball: NDArray[np.float64], snapshot: Snapshot) -> None:
        """Show the force of the pushes at the side of the body to which it points."""
        x, y = snapshot.force
        if not 0.0 < math.hypot(x, y) < math.inf:
            arrow.hide()
            return
        at = body_rotation(snapshot.psi).apply(grip(self._dimensions, (x, -y)))
        arrow.show(ball + at, snapshot.force)

    def show_trail(self, points: Points) -> None:
        """Show the trail."""
        self._trail.show(points)
