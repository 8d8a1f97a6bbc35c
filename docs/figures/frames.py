"""Draws docs/images/frames.png: the axes, planes and signs that docs/frames.md describes.

    .venv/bin/python docs/figures/frames.py

Lengths are to scale, in millimetres.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Polygon, Rectangle, Wedge
from matplotlib.transforms import Affine2D

BALL, WHEEL, WHEEL_WIDTH = 26.0, 21.0, 22.0
SIDE = 135.0
CENTRE = 170.0  # L, from the ball's centre to the body's
LEAN = 11.0  # deg

# Okabe and Ito's colours, as in the figures of a run.
BLUE, ORANGE, GREEN, GRAY, BLACK = '#0072B2', '#D55E00', '#009E73', '#666666', '#222222'
BODY = '#E8EAED'
BALL_FILL = '#CFE3F1'


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], **style: Any) -> None:
    """Draw a straight arrow."""
    axes.add_patch(
        FancyArrowPatch(
            start, end,
            arrowstyle='-|>', mutation_scale=style.pop('head', 14), shrinkA=0, shrinkB=0,
            linewidth=style.pop('linewidth', 1.8), **style,
        )
    )  # fmt: skip


def turn(
    axes: Axes, centre: tuple[float, float], radius: float, begin: float, end: float, color: str
) -> None:
    """Draw a clockwise circular arrow between two angles [deg], counted from page right."""
    axes.add_patch(
        Arc(centre, 2 * radius, 2 * radius, theta1=end, theta2=begin, color=color, linewidth=1.8)
    )
    tip = math.radians(end)
    x, y = centre[0] + radius * math.cos(tip), centre[1] + radius * math.sin(tip)
    # The head alone: a short arrow along the tangent, which bends inwards a little.
    back = math.radians(end + 0.9 * math.degrees(8.0 / radius))
    start = (centre[0] + radius * math.cos(back), centre[1] + radius * math.sin(back))
    arrow(axes, start, (x, y), color=color, head=13)


def into_page(axes: Axes, at: tuple[float, float], color: str) -> None:
    """Draw an axis that points away from the reader."""
    size = 5.0
    axes.add_patch(Circle(at, size, facecolor='white', edgecolor=color, linewidth=1.6, zorder=5))
    for sign in (1, -1):
        reach = size * math.sqrt(0.5)
        axes.plot(
            [at[0] - reach, at[0] + reach],
            [at[1] - sign * reach, at[1] + sign * reach],
            color=color, linewidth=1.6, zorder=6,
        )  # fmt: skip


def out_of_page(axes: Axes, at: tuple[float, float], color: str) -> None:
    """Draw an axis that points to the reader."""
    axes.add_patch(Circle(at, 5.0, facecolor='white', edgecolor=color, linewidth=1.6, zorder=5))
    axes.add_patch(Circle(at, 1.6, facecolor=color, edgecolor=color, zorder=6))


def label(axes: Axes, at: tuple[float, float], text: str, color: str = BLACK, **style: Any) -> None:
    """Write on the drawing."""
    settings = {'ha': 'center', 'va': 'center', 'fontsize': 10, **style}
    axes.text(*at, text, color=color, **settings)


def sheet(axes: Axes, title: str, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Prepare a view."""
    axes.set_title(title, fontsize=12, pad=8)
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    axes.set_aspect('equal')
    axes.axis('off')


def draw_top(axes: Axes) -> None:
    """Draw the robot from above: page up is forward, page left is left."""
    sheet(axes, 'From above (along −z)', (-185, 185), (-186, 260))
    half = SIDE / 2
    axes.add_patch(Rectangle((-half, -half), SIDE, SIDE, facecolor=BODY, edgecolor=GRAY))
    axes.add_patch(Circle((0, 0), BALL, facecolor=BALL_FILL, edgecolor=GRAY, linestyle='--'))

    # REP 103 axes at the ball's centre.
    arrow(axes, (0, 0), (0, 128), color=BLUE)
    arrow(axes, (0, 0), (-128, 0), color=ORANGE)
    out_of_page(axes, (0, 0), GREEN)
    label(axes, (-20, 120), '+x', BLUE, fontsize=12, weight='bold')
    label(axes, (-146, 0), '+y', ORANGE, fontsize=12, weight='bold')
    label(axes, (-14, -13), '+z', GREEN, fontsize=12, weight='bold')

    # Sonar at the front face.
    axes.add_patch(Wedge((0, half), 105, 75, 105, facecolor='#DDDDDD', alpha=0.45, zorder=0))
    axes.add_patch(Rectangle((-22, half - 6), 44, 12, facecolor='white', edgecolor=GRAY, zorder=2))
    label(axes, (52, half + 15), 'sonar, port S3,\nlooks along +x', GRAY, fontsize=9, ha='left')

    # Motor wheels: B turns about y, C turns about x.
    axes.add_patch(
        Rectangle((-WHEEL_WIDTH / 2, -48 - WHEEL), WHEEL_WIDTH, 2 * WHEEL,
                  facecolor='white', edgecolor=BLUE, linewidth=1.6)
    )  # fmt: skip
    label(axes, (0, -48), 'B', BLUE, weight='bold')
    axes.add_patch(
        Rectangle((48 - WHEEL, -WHEEL_WIDTH / 2), 2 * WHEEL, WHEEL_WIDTH,
                  facecolor='white', edgecolor=ORANGE, linewidth=1.6)
    )  # fmt: skip
    label(axes, (48, 0), 'C', ORANGE, weight='bold')

    # Gyros: the double arrows are their axes of rotation.
    for at, tip, name, color in (
        ((-18, 42), (-52, 42), 'S1', BLUE),
        ((-44, -52), (-44, -18), 'S2', ORANGE),
    ):
        arrow(axes, at, tip, color=color, linewidth=1.4, head=11)
        near = (tip[0] + 0.24 * (at[0] - tip[0]), tip[1] + 0.24 * (at[1] - tip[1]))
        arrow(axes, at, near, color=color, linewidth=1.4, head=11)
        axes.add_patch(
            Rectangle((at[0] - 8, at[1] - 8), 16, 16, facecolor='white', edgecolor=color, zorder=4)
        )
        label(axes, at, name, color, fontsize=9, zorder=5)

    # The planes.
    arrow(axes, (-160, 150), (-160, 222), color=BLUE, linewidth=3.2, head=20)
    label(axes, (-148, 186), 'plane x: forward,\nposition_x = +x', BLUE, ha='left')
    arrow(axes, (-36, -100), (36, -100), color=ORANGE, linewidth=3.2, head=20)
    label(axes, (0, -124), 'plane y: rightward,  position_y = −y', ORANGE)
    label(axes, (0, -160), 'gyro axes: S1 measures about +y, S2 about +x', GRAY, fontsize=9)


def draw_side(
    axes: Axes, title: str, color: str, plane: str, names: tuple[str, str, str, str], word: str
) -> None:
    """Draw one plane: page right is its positive direction."""
    sheet(axes, title, (-165, 205), (-58, 388))
    into, gyro, motor, angle_name = names
    ball = (0.0, BALL)
    axes.plot([-155, 195], [0, 0], color=GRAY, linewidth=1.4)

    # The leaning body.
    lean = Affine2D().rotate_deg_around(*ball, -LEAN) + axes.transData
    half = SIDE / 2
    bottom, top = BALL + 12.0, BALL + 2 * CENTRE - 20.0
    outline = [(-half, bottom + 25), (-half, top), (half, top), (half, bottom + 25), (30, bottom),
               (-30, bottom)]  # fmt: skip
    axes.add_patch(Polygon(outline, facecolor=BODY, edgecolor=GRAY, transform=lean, zorder=1))
    axes.add_patch(Circle(ball, BALL, facecolor=BALL_FILL, edgecolor=GRAY, linewidth=1.4, zorder=2))
    axes.add_patch(
        Circle((0, BALL + BALL + WHEEL), WHEEL, facecolor='white', edgecolor=color,
               linewidth=1.6, transform=lean, zorder=3)
    )  # fmt: skip
    angle = math.radians(LEAN)

    def on_body(height: float, aside: float = 0.0) -> tuple[float, float]:
        return (
            height * math.sin(angle) + aside * math.cos(angle),
            BALL + height * math.cos(angle) - aside * math.sin(angle),
        )

    label(axes, on_body(BALL + WHEEL), motor, color, weight='bold', zorder=4)

    # Pitch: from the vertical to the body's axis.
    axes.plot([0, 0], [BALL, 362], color=GRAY, linestyle=':', linewidth=1.2, zorder=3)
    end = on_body(350)
    axes.plot([0, end[0]], [BALL, end[1]], color=GRAY, linestyle='-.', linewidth=1.0, zorder=2)
    turn(axes, ball, 318, 90, 90 - LEAN, color)
    label(axes, (-12, 366), f'ψ{plane} > 0', color, fontsize=12, weight='bold', ha='right')
    label(axes, (80, 366), f'{angle_name}, about {into}', color, fontsize=9, ha='left')

    # Body's centre of mass and the gyro.
    centre = on_body(CENTRE)
    axes.add_patch(Circle(centre, 4.5, facecolor=BLACK, zorder=4))
    label(axes, (centre[0] + 8, centre[1] - 2), 'body centre\nL = 170 mm', fontsize=8, ha='left',
          zorder=4)  # fmt: skip
    spot = on_body(118, -43)
    into_page(axes, spot, color)
    label(axes, (spot[0], spot[1] - 21), f'gyro\n{gyro}', color, fontsize=9)

    # Ball and motor: positive turns roll to page right.
    turn(axes, ball, 37, 213, 160, color)
    label(axes, (-46, 13), f'θ{plane} > 0', color, fontsize=12, weight='bold', ha='right')
    label(axes, (98, 66), f'motor {motor}: angle and\nduty > 0 turn the\nball {word}', color,
          fontsize=9, ha='left')  # fmt: skip
    wheel = on_body(BALL + WHEEL)
    axes.plot([wheel[0] + WHEEL + 2, 94], [wheel[1], 68], color=color, linewidth=0.8)

    # Travel and the axes of REP 103.
    arrow(axes, (0, -16), (72, -16), color=color, linewidth=3.2, head=20)
    axes.plot([0, 0], [-24, 0], color=GRAY, linewidth=1.0)
    label(axes, (0, -42), f'position_{plane} = Rs θ{plane}   ({word})', color, ha='left')
    forward = plane == 'x'
    origin = (-142.0 if forward else -98.0, 52.0)
    arrow(axes, origin, (origin[0], origin[1] + 55), color=GREEN)
    label(axes, (origin[0], origin[1] + 66), '+z', GREEN, fontsize=12, weight='bold')
    aside = 52.0 if forward else -52.0
    arrow(axes, origin, (origin[0] + aside, origin[1]), color=color)
    label(axes, (origin[0] + aside, origin[1] - 13), '+x' if forward else '+y', color,
          fontsize=12, weight='bold')  # fmt: skip
    other = ORANGE if forward else BLUE
    into_page(axes, origin, other)
    label(axes, (origin[0], origin[1] - 17), into, other, fontsize=12, weight='bold')


def main() -> None:
    """Write the picture."""
    figure = Figure(figsize=(13.5, 5.9), layout='constrained', facecolor='white')
    top, side, rear = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.0))
    draw_top(top)
    draw_side(side, 'Plane x, from the right (along +y)', BLUE, 'x', ('+y', 'S1', 'B', 'pitch'),
              'forward')  # fmt: skip
    draw_side(rear, 'Plane y, from behind (along +x)', ORANGE, 'y', ('+x', 'S2', 'C', 'roll'),
              'rightward')  # fmt: skip
    path = Path(__file__).resolve().parents[1] / 'images' / 'frames.png'
    figure.savefig(path, dpi=110)


if __name__ == '__main__':
    main()
