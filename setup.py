"""Installs ballbot_ros by pip and, as an ament_python package, by colcon."""

import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = 'ballbot_ros'


def version() -> str:
    """Read the version without importing the package, whose dependencies may be missing."""
    text = Path(PACKAGE, '__init__.py').read_text(encoding='utf-8')
    return re.search(r"^__version__ = '(.+)'$", text, re.MULTILINE)[1]


def nodes() -> tuple[str, ...]:
    """Take the nodes from the parameter table, which needs only the standard library."""
    sys.path.insert(0, str(Path().resolve()))
    try:
        return import_module(f'{PACKAGE}.parameters').EXECUTABLES
    finally:
        del sys.path[0]


def long_description() -> str:
    """Return the README; a symlinked build tree of colcon has none."""
    readme = Path('README.md')
    return readme.read_text(encoding='utf-8') if readme.exists() else ''


def shared_files(pattern: str) -> Iterator[tuple[str, list[str]]]:
    """Pair each folder below share/ballbot_ros with the files that go there."""
    folders: dict[Path, list[str]] = {}
    for file in sorted(Path().glob(pattern)):
        if file.is_file():
            folders.setdefault(file.parent, []).append(str(file))
    for folder, files in folders.items():
        yield f'share/{PACKAGE}/{folder}', files


EXTRAS = {
    # Pinned, because these wheels are built against one another. Names without `jazzy` are
    # those of another ROS release.
    'ros': [
        'ros-jazzy-rclpy==7.1.6',
        'ros-jazzy-common-interfaces==5.3.6',
        'ros-jazzy-rmw-fastrtps-cpp==8.4.3',
        'ros-jazzy-rosgraph-msgs==2.0.3',
    ],
    # Gamepads and the keyboard.
    'drive': [
        'pygame-ce>=2.5',
        'prompt_toolkit>=3.0.36',
    ],
    # The environments for reinforcement learning.
    'gym': [
        'gymnasium>=1.0',
    ],
    # The controller mpc.
    'mpc': [
        'osqp>=1.0',
    ],
    'parquet': [
        'pyarrow>=14',
    ],
    # The interactive figures of reports.
    'report': [
        'plotly>=5.24',
    ],
    # Studies of many runs.
    'study': [
        'numba>=0.58',
        'pyarrow>=15',
        'SALib>=1.5',
    ],
    # Searches by tune and falsify.
    'search': [
        'cma>=4.0',
    ],
    # Studies on a Dask cluster, all of whose machines need the same release of distributed.
    'cluster': [
        'distributed>=2024.8',
        'numba>=0.58',
        'pyarrow>=15',
    ],
    # The 3D viewer. viewer/guarded_server.py uses internals of viser, so it stays in one minor
    # series.
    'viewer': [
        'viser>=1.1,<1.2',
        'websockets>=13.1',
        'trimesh>=4.0',
    ],
    # Pictures and films of the 3D scene.
    'film': [
        'imageio-ffmpeg>=0.5',
        'playwright>=1.50',
    ],
    # Run.frame.
    'pandas': [
        'pandas>=2.1',
    ],
    # Notebooks, as in docs/notebooks.
    'notebook': [
        'pandas>=2.1',
        'jupytext>=1.16',
        'jupyterlab>=4.0',
    ],
    # ruff and mypy stay in one minor series, since newer ones are stricter.
    'test': [
        'build>=1.0',
        'pytest>=7.4',
        'pytest-xdist>=3.4',
        'pytest-timeout>=2.2',
        'hypothesis>=6.98',
        'ruff>=0.17,<0.18',
        'mypy>=2.4,<2.5',
        'numpydoc>=1.8',
        'cma>=4.0',
        'colcon-common-extensions>=0.3',
        'cyclonedds>=11.0',
        'distributed>=2024.8',
        'duckdb>=1.0',
        'gymnasium>=1.0',
        'mcap-ros2-support>=0.5',
        'moviepy>=2.0',
        'numba>=0.58',
        'osqp>=1.0',
        'pandas>=2.1',
        'polars>=1.0',
        'pyarrow>=15',
        'pyte>=0.8',
        'rtamt>=0.4.10',
        'SALib>=1.5',
        'types-PyYAML>=6.0',
        'yourdfpy>=0.0.56',
    ],
    # The documentation site.
    'docs': [
        'sphinx>=8.1',
        'myst-nb>=1.2',
        'myst-parser>=4.0.1',
        'furo>=2024.8.6',
        'gymnasium>=1.0',
        'pandas>=2.1',
    ],
}

FOR_USERS = (
    'drive', 'viewer', 'film', 'report', 'study', 'search', 'parquet', 'pandas', 'gym', 'mpc',
)  # fmt: skip
"""The extras that commands and the library need on this machine."""

setup(
    name=PACKAGE,
    version=version(),
    description='The LEGO NXT Ballbot as a graph of ROS 2 nodes in lockstep, recorded to MCAP',
    long_description=long_description(),
    long_description_content_type='text/markdown',
    author='ballbot_ros developers',
    author_email='ballbot_ros@example.org',
    maintainer='ballbot_ros developers',
    maintainer_email='ballbot_ros@example.org',
    license='Apache-2.0',
    keywords=['ROS', 'ballbot', 'control', 'simulation'],
    classifiers=[
        'Intended Audience :: Education',
        'Intended Audience :: Science/Research',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3',
        'Topic :: Scientific/Engineering',
        'Typing :: Typed',
    ],
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={
        PACKAGE: ['py.typed'],
        f'{PACKAGE}.analysis': ['templates/*.html', 'assets/*.js'],
        f'{PACKAGE}.controllers': ['templates/*.jinja'],
        f'{PACKAGE}.controllers.codegen': ['templates/*', 'templates/*/*', 'target/*'],
        f'{PACKAGE}.lab.search': ['templates/*.html'],
        f'{PACKAGE}.lab.studies': ['templates/*.html'],
        f'{PACKAGE}.viewer': ['assets/*'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        *shared_files('config/**/*'),
        *shared_files('launch/**/*.launch.py'),
    ],
    # The lower bounds are the versions in Ubuntu 24.04, the platform of ROS 2 Jazzy, for all
    # packages that it has.
    install_requires=[
        'numpy>=1.26',
        'scipy>=1.11',
        'control>=0.10',
        'mcap>=1.6',
        'lz4>=4.0',
        'zstandard>=0.20',
        'rosbags>=0.11.9',
        'matplotlib>=3.6',
        'pillow>=10.2',
        'Jinja2>=3.1',
        'PyYAML>=6.0',
        'click>=8.1',
        'rich>=13.7',
    ],
    extras_require={**EXTRAS, 'all': [each for name in FOR_USERS for each in EXTRAS[name]]},
    zip_safe=True,
    entry_points={
        'ballbot_ros.controllers': [
            f'pid = {PACKAGE}.controllers.pid:PID',
            f'lqg = {PACKAGE}.controllers.lqg:LQG',
            f'drift_filter = {PACKAGE}.controllers.drift_filter:DriftFilter',
            f'mpc = {PACKAGE}.controllers.mpc:MPC',
            f'commissioning = {PACKAGE}.controllers.commissioning:Commissioning',
        ],
        'console_scripts': [
            f'ballbot = {PACKAGE}.cli.main:main',
            *(f'{node} = {PACKAGE}.nodes.executables:{node}' for node in nodes()),
        ],
    },
)
