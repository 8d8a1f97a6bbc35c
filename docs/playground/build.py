"""Builds the page that runs the robot in a browser: one folder of static files.

    python docs/playground/build.py FOLDER

The page has this package's own sources; which of them a run needs follows from a run. The packages
of package.json come from npm.
"""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import yaml

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT), str(HERE)]

from session import Session  # noqa: E402

from ballbot_ros.engine.scenario.reader import load_scenario, scenario_names  # noqa: E402
from ballbot_ros.parameters import Dimensions, PlantParameters  # noqa: E402
from ballbot_ros.parameters.timing import TICK_S  # noqa: E402
from ballbot_ros.robot.world.floor_map import CELL_M, WALL_HEIGHT_CM, map_path  # noqa: E402
from ballbot_ros.robot.world.world import World  # noqa: E402
from ballbot_ros.viewer.markers import walls  # noqa: E402
from ballbot_ros.viewer.robot import parts, wheel_centres  # noqa: E402

FROM_NPM = {
    'pyodide': (
        'pyodide.mjs', 'pyodide.asm.mjs', 'pyodide.asm.wasm', 'python_stdlib.zip',
        'pyodide-lock.json',
    ),
    'three': (
        'build/three.module.js', 'build/three.core.js', 'examples/jsm/controls/OrbitControls.js',
    ),
}  # fmt: skip
"""The files of the packages of npm that the page needs."""

DOWNLOADED = (
    'python.zip', 'pyodide/pyodide.asm.wasm', 'pyodide/python_stdlib.zip',
    'pyodide/pyodide-lock.json',
)  # fmt: skip
"""What the worker fetches."""

FROM_VIEWER = 'driving.js', 'element.js', 'icon.svg'
"""Files of the viewer's page that this page has, too."""

CONFIGURATION = 'package.xml', 'config/golden.yaml', 'config/profiles/*', 'config/scenarios/*'

FIRST = 'stationary', 'push', 'square', 'hardware_standing'
"""The scenarios that come first in the page's choice."""

SHOWN, SHOWN_S, SHOWN_TICKS = 'push', 14, 5
"""The run that the page shows while it loads: scenario, duration [s], ticks from row to row."""

LIST_MODULES = """
import sys, session
session.Session('hardware_standing').advance(100)
session.golden_sha256('stationary')
print(*(each.__file__ for name, each in sys.modules.items() if name.split('.')[0] == 'ballbot_ros'))
"""


def build(folder: Path) -> None:
    """Build the page in a folder, which is replaced."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(HERE / 'page', folder)
    for name in FROM_VIEWER:
        shutil.copy(ROOT / 'ballbot_ros/viewer/assets' / name, folder)
    with tempfile.TemporaryDirectory() as packages:
        install_packages(Path(packages))
        for package, names in FROM_NPM.items():
            (folder / package).mkdir()
            for name in names:
                shutil.copy(Path(packages) / 'node_modules' / package / name, folder / package)
    scenarios = [_scenario(name) for name in sorted(scenario_names(), key=_rank)]
    maps = map_names()
    for name in maps:
        shutil.copy(map_path(name), folder / f'{name}.png')
    write_python(folder / 'python.zip', maps)
    robot = {
        'scenarios': scenarios,
        'maps': {name: _map(name) for name in maps},
        'robot': _robot(),
        'shown': _shown(),
        'shownPeriod': SHOWN_TICKS * TICK_S,
        'bytes': sum((folder / name).stat().st_size for name in DOWNLOADED),
    }
    (folder / 'robot.json').write_text(json.dumps(robot, separators=(',', ':')))


def install_packages(folder: Path) -> None:
    """Let npm install the packages of the page in a folder; exit with status 2 if it can't."""
    if not (npm := shutil.which('npm')):
        fail('needs npm: sudo apt install npm')
    for name in ('package.json', 'package-lock.json'):
        shutil.copy(HERE / name, folder)
    command = [npm, 'ci', '--no-audit', '--no-fund', '--ignore-scripts', '--fetch-retries=1']
    done = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
    if done.returncode:
        fail(f'npm cannot install {" and ".join(FROM_NPM)}: {done.stderr.strip()[-300:]}')


def fail(problem: str) -> NoReturn:
    """Print one line and exit with status 2."""
    print(f'docs/playground/build.py: {problem}', file=sys.stderr)
    raise SystemExit(2)


def _rank(name: str) -> tuple[int, str]:
    return FIRST.index(name) if name in FIRST else len(FIRST), name


def map_names() -> list[str]:
    """Return the maps of the shipped scenarios."""
    plants = (load_scenario(name).parameters.of(PlantParameters) for name in scenario_names())
    return sorted({plant.map for plant in plants if plant.map})


def write_python(path: Path, maps: list[str]) -> None:
    """Write the Python of the page: what a run needs of this package, its files, and PyYAML."""
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for module in _modules():
            archive.write(module, module.relative_to(ROOT))
        for pattern in CONFIGURATION:
            for each in sorted(ROOT.glob(pattern)):
                archive.write(each, each.relative_to(ROOT))
        for each in sorted(Path(yaml.__file__).parent.glob('*.py')):
            archive.write(each, f'yaml/{each.name}')
        for each in sorted((HERE / 'stand_in').rglob('*.py')):
            archive.write(each, each.relative_to(HERE / 'stand_in'))
        archive.write(HERE / 'session.py', 'session.py')
        for name in maps:
            archive.writestr(f'maps/{name}', _tables(name))


def _modules() -> list[Path]:
    """Return the modules of this package that a run imports."""
    command = [sys.executable, '-c', f'import sys; sys.path[:0] = {sys.path[:2]}{LIST_MODULES}']
    found = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return sorted(map(Path, found.split()))


def _world(name: str) -> World:
    world = World.of(PlantParameters(map=name))
    assert world is not None
    return world


def _tables(name: str) -> bytes:
    """Return the walls of a map as :class:`session.Floor` reads them."""
    sides, walls_before = _world(name).walls_as_numbers
    return struct.pack('<2i', *sides.shape) + bytes(sides) + bytes(walls_before)


def _scenario(name: str) -> dict[str, object]:
    scenario = load_scenario(name)
    plant = scenario.parameters.of(PlantParameters)
    return {
        'name': name,
        'purpose': scenario.purpose,
        'duration': plant.duration,
        'map': plant.map,
    }


def _map(name: str) -> dict[str, object]:
    """Return the size of a map and its walls [m], as rectangles in ``map``."""
    floor = _world(name).map
    return {
        'size': [floor.columns * CELL_M, floor.rows * CELL_M],
        'height': WALL_HEIGHT_CM / 100.0,
        'walls': walls(floor),
    }


def _robot() -> dict[str, object]:
    """Return the robot's shape [m] [rad]."""
    dimensions = Dimensions.from_parameters(PlantParameters())
    return {
        'parts': [each._asdict() for each in parts(dimensions)],
        'wheels': wheel_centres(dimensions),
        'ballRadius': dimensions.ball_radius,
        'wheelRadius': dimensions.wheel_radius,
        'gripHeight': dimensions.ball_radius + dimensions.body_height,
    }


def _shown() -> list[list[float]]:
    """Return the rows of the run that the page shows while it loads."""
    return list(_rows(Session(SHOWN)))


def _rows(session: Session) -> Iterator[list[float]]:
    for _ in range(round(SHOWN_S / (SHOWN_TICKS * TICK_S))):
        rows = session.advance(SHOWN_TICKS)
        yield [round(each, 5) for each in rows[: len(rows) // SHOWN_TICKS]]


if __name__ == '__main__':
    build(Path(sys.argv[1]))
