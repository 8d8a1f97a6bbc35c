"""`ballbot map`: check a map image, print its content, and export it."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Column, Table

from ballbot_ros.cli.options import NEW_FILE
from ballbot_ros.parameters import Dimensions
from ballbot_ros.robot.world.floor_map import CELL_M, LINE, FloorMap, load_map, write_files


@click.command('map')
@click.argument('image')
@click.option('--wrl', type=NEW_FILE, help='VRML 2.0 file to write.')
@click.option(
    '--robot', is_flag=True, help="Put the robot and the document's five viewpoints into --wrl."
)
@click.option(
    '--yaml',
    'nav2',
    type=NEW_FILE,
    help="File for nav2's map server to write; its .pgm is put next to it.",
)
@click.option('--check', is_flag=True, help='Only say whether the image is a map.')
def command(image: str, wrl: Path | None, robot: bool, nav2: Path | None, check: bool) -> None:
    """Check IMAGE, a PNG or BMP file or the name of a shipped map, and print its content."""
    if check and (wrl or nav2):
        raise click.UsageError('--check writes nothing: omit --wrl and --yaml')
    if robot and not wrl:
        raise click.UsageError('--robot needs --wrl FILE')
    floor_map = load_map(image)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    # One cell is one centimetre.
    size = f'{floor_map.columns} × {floor_map.rows}'
    if check:
        console.print(f'{image}: OK, {size} cm')
        return
    nodes = ''
    if robot:
        # Imported only here: scipy takes a quarter of a second.
        from ballbot_ros.viewer.vrml import robot_nodes

        nodes = robot_nodes(floor_map, Dimensions())
    written = write_files(floor_map, wrl=wrl, nav2=nav2, nodes=nodes)
    console.print(_table(floor_map, image, size))
    for path in written:
        console.print(f'wrote  {path}')


def _table(floor_map: FloorMap, image: str, size: str) -> Table:
    walls = int(np.count_nonzero(floor_map.walls))
    lines = int(np.count_nonzero(floor_map.cells == LINE))
    free_area = (floor_map.cells.size - walls) * CELL_M**2
    right = Column(justify='right')
    table = Table(Column(), right, title=image, title_justify='left', show_header=False)
    for name, value in (
        ('size', f'{size} cm'),
        ('cells', str(floor_map.cells.size)),
        ('free area', f'{free_area:.4f} m²'),
        ('wall cells', str(walls)),
        ('black line cells', str(lines)),
    ):
        table.add_row(name, value)
    return table
