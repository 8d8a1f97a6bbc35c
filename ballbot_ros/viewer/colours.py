"""The colours of the robot and its surroundings."""

from __future__ import annotations

Colour = tuple[int, int, int]
"""Red, green, blue, 0 ... 255."""

LIGHT, DARK, ORANGE, BLACK, BLUE, WHITE = (
    (214, 217, 220), (92, 98, 106), (238, 122, 40), (38, 41, 46), (44, 116, 190), (246, 247, 248),
)  # fmt: skip

NAMES: dict[Colour, str] = {
    LIGHT: 'light',
    DARK: 'dark',
    ORANGE: 'orange',
    BLACK: 'black',
    BLUE: 'blue',
    WHITE: 'white',
}
"""The colours of the robot's parts by name."""

FLOOR, WALL, LINE = (236, 233, 226), (148, 158, 170), (40, 42, 46)

ZENITH, HORIZON = (188, 204, 222), (242, 245, 248)

TRAIL, GHOST_TRAIL, GHOST = (238, 122, 40), (110, 120, 200), (120, 135, 220)

GHOST_LIGHT = (176, 186, 238)
"""The curve of plane y of the ghost; that of plane x has the colour of the ghost."""

FORCE = (44, 116, 190)

BEAM, BEAM_OPACITY = (255, 160, 60), 0.22

HEADING, HEADING_OPACITY = DARK, 0.45
