"""setup.py, package.xml and the package's imports agree with each other."""

import ast
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import setuptools

from ballbot_ros.nodes.registry import REGISTRY
from ballbot_ros.parameters import EXECUTABLES

ROOT = Path(__file__).resolve().parents[2]

# The rosdep keys of the distributions that setup.py names; None where rosdep has no key.
ROSDEP_KEYS = {
    'Jinja2': 'python3-jinja2',
    'PyYAML': 'python3-yaml',
    'click': 'python3-click',
    'control': None,
    'distributed': None,
    'gymnasium': None,
    'imageio-ffmpeg': None,
    'jupyterlab': None,
    'jupytext': None,
    'matplotlib': 'python3-matplotlib',
    'mcap': 'mcap-ros2-support',
    'numba': 'python3-numba',
    'numpy': 'python3-numpy',
    'pillow': 'python3-pil',
    'playwright': None,
    'plotly': 'python3-plotly',
    'prompt_toolkit': 'python3-prompt-toolkit',
    'pygame-ce': 'python3-pygame',
    'osqp': None,
    'pandas': 'python3-pandas',
    'pyarrow': None,
    'rich': 'python3-rich',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'SALib': None,
    'cma': None,
    'trimesh': 'python3-trimesh-pip',
    'viser': None,
    'websockets': None,
    'lz4': 'mcap-ros2-support',
    'zstandard': 'mcap-ros2-support',
    'ros-jazzy-common-interfaces': 'std_msgs',
    'ros-jazzy-rclpy': 'rclpy',
    'ros-jazzy-rmw-fastrtps-cpp': 'rmw_fastrtps_cpp',
    'ros-jazzy-rosgraph-msgs': 'rosgraph_msgs',
}
ROSDEP_TEST_KEYS = {
    'build': None,
    'colcon-common-extensions': 'python3-colcon-common-extensions',
    'cma': None,
    'cyclonedds': None,
    'distributed': None,
    'duckdb': None,
    'gymnasium': None,
    'hypothesis': 'python3-hypothesis',
    'mcap-ros2-support': 'mcap-ros2-support',
    'moviepy': None,
    'mypy': 'python3-mypy',
    'numba': 'python3-numba',
    'numpydoc': None,
    'osqp': None,
    'pandas': 'python3-pandas',
    'polars': None,
    'pyarrow': None,
    'pyte': None,
    'rtamt': None,
    'pytest': 'python3-pytest',
    'pytest-timeout': 'python3-pytest-timeout',
    'pytest-xdist': 'python3-pytest-xdist',
    'ruff': 'python3-ruff-pip',
    'SALib': None,
    'types-PyYAML': 'python3-types-pyyaml',
    'yourdfpy': None,
}
ROSDEP_DOC_KEYS = {
    'furo': None,
    'gymnasium': None,
    'myst-nb': None,
    'myst-parser': None,
    'pandas': 'python3-pandas',
    'sphinx': 'python3-sphinx',
}
TOOLS = {'test': ('test_depend', ROSDEP_TEST_KEYS), 'docs': ('doc_depend', ROSDEP_DOC_KEYS)}
MODULES = {
    'Jinja2': 'jinja2',
    'PyYAML': 'yaml',
    'imageio-ffmpeg': 'imageio_ffmpeg',
    'pillow': 'PIL',
    'pygame-ce': 'pygame',
}


@pytest.fixture
def setup(monkeypatch):
    """Return the arguments in setup.py."""
    arguments = {}
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(setuptools, 'setup', arguments.update)
    runpy.run_path('setup.py')
    return arguments


@pytest.fixture(scope='module')
def manifest():
    return ElementTree.parse(ROOT / 'package.xml').getroot()


def texts(manifest, tag):
    return {element.text for element in manifest.iter(tag)}


def names(requirements):
    return {re.match(r'[\w-]+', requirement)[0] for requirement in requirements}


def run_time_requirements(setup):
    extras = [value for key, value in setup['extras_require'].items() if key not in TOOLS]
    return names(setup['install_requires']).union(*map(names, extras))


def test_manifest_and_setup_name_the_same_package(setup, manifest):
    for tag in ('name', 'version', 'license', 'description', 'maintainer', 'author'):
        assert manifest.findtext(tag) == setup[tag]
    for tag in ('maintainer', 'author'):
        assert manifest.find(tag).get('email') == setup[f'{tag}_email']
    assert manifest.findtext('export/build_type') == 'ament_python'
    assert 'Apache License' in (ROOT / manifest.find('license').get('file')).read_text()


def test_package_and_setup_have_one_version(setup):
    import ballbot_ros

    assert ballbot_ros.__version__ == setup['version']


def test_manifest_declares_every_run_time_requirement(setup, manifest):
    required = run_time_requirements(setup)
    assert required == ROSDEP_KEYS.keys()
    assert {ROSDEP_KEYS[name] for name in required} - {None} <= texts(manifest, 'exec_depend')


@pytest.mark.parametrize('extra', TOOLS)
def test_manifest_declares_every_tool(setup, manifest, extra):
    tag, keys = TOOLS[extra]
    required = names(setup['extras_require'][extra])
    assert required == keys.keys()
    declared = texts(manifest, 'exec_depend') | texts(manifest, tag)
    assert {keys[name] for name in required} - {None} <= declared


def test_every_import_is_declared(setup, manifest):
    declared = {module_of(name) for name in run_time_requirements(setup)}
    declared |= texts(manifest, 'exec_depend') | {'ballbot_ros'} | sys.stdlib_module_names
    undeclared = {
        f'{file.relative_to(ROOT)}: {module}'
        for folder in ('ballbot_ros', 'launch')
        for file in (ROOT / folder).rglob('*.py')
        for module in imported_modules(file)
        if module not in declared
    }
    assert undeclared == set()


def test_the_scripts_start_without_the_extras_that_they_do_not_install(setup, manifest):
    """For each, the imports at the start of its program and of the modules of its folder."""
    extras = re.search(r' extras=([\w,]+)', (ROOT / 'scripts/environment.sh').read_text())[1]
    installed = names(setup['install_requires']).union(
        *(names(setup['extras_require'][extra]) for extra in extras.split(','))
    )
    installed = {module_of(name) for name in installed} | texts(manifest, 'exec_depend')
    installed |= sys.stdlib_module_names | {'ballbot_ros', 'benchmark', 'campaign'}
    scripts = filter(Path.is_file, (ROOT / 'scripts').iterdir())
    text = '\n'.join(script.read_text() for script in scripts)
    modules = re.findall(r'run_program ((?:benchmark|campaign)\.\w+)', text)
    assert 'benchmark.bench' in modules
    for module in modules:  # grows
        path = ROOT / f'scripts/programs/{module.replace(".", "/")}.py'
        tree = ast.parse(path.read_text(encoding='utf-8'))
        for node in tree.body:
            for name in names_imported(node):
                assert name.split('.')[0] in installed, f'{module}: {name}'
                if name.startswith(('benchmark.', 'campaign.')) and name not in modules:
                    modules.append(name)


def module_of(name):
    """Return the module of a distribution."""
    return MODULES.get(name, name.replace('-', '_'))


def imported_modules(file):
    for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
        yield from (name.split('.')[0] for name in names_imported(node))


def names_imported(node):
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and not node.level:
        yield node.module


def test_every_node_is_a_program(setup):
    scripts = setup['entry_points']['console_scripts']
    nodes = {name: f'{name} = ballbot_ros.nodes.executables:{name}' for name in REGISTRY}
    assert scripts == ['ballbot = ballbot_ros.cli.main:main', *nodes.values()]


def test_ros2_finds_every_program_and_launch_file_without_colcon(monkeypatch):
    index = pytest.importorskip('ament_index_python')
    prefix = Path(sys.prefix)
    if not (prefix / 'run.stamp').exists():
        pytest.skip('this environment was not made by the scripts')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    assert index.get_package_prefix('ballbot_ros') == str(prefix)
    programs = list((prefix / 'lib/ballbot_ros').iterdir())
    assert {program.name for program in programs} == {'ballbot', *EXECUTABLES}
    assert all(os.access(program, os.X_OK) for program in programs)
    share = Path(index.get_package_share_directory('ballbot_ros'))
    for name in ('package.xml', 'config', *files_in('launch')):
        assert (share / name).samefile(ROOT / name), name


def files_in(folder):
    return (file.relative_to(ROOT) for file in (ROOT / folder).glob('*.py'))


def test_the_list_of_nodes_needs_no_dependency():
    code = "import sys; sys.path.insert(0, '.'); from ballbot_ros.parameters import EXECUTABLES"
    bare = [sys.executable, '-I', '-S', '-c', code]
    done = subprocess.run(bare, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def package_of(file):
    return next(parent for parent in file.parents if (parent / '__init__.py').exists())


def test_every_subpackage_is_installed(setup):
    folders = {
        '.'.join(file.relative_to(ROOT).parent.parts)
        for file in (ROOT / 'ballbot_ros').rglob('*.py')
    }
    assert folders == set(setup['packages'])


@pytest.mark.parametrize(
    ('package', 'more_than'),
    [('analysis', 5), ('controllers', 6), ('controllers.codegen', 10), ('lab.studies', 0)],
)
def test_every_template_is_installed(setup, package, more_than):
    folder = ROOT / 'ballbot_ros' / package.replace('.', '/')
    patterns = setup['package_data'][f'ballbot_ros.{package}']
    installed = {file for pattern in patterns for file in folder.glob(pattern) if file.is_file()}
    there = {
        file
        for file in folder.rglob('*')
        if file.is_file() and file.suffix not in ('.py', '.pyc') and package_of(file) == folder
    }
    assert there == installed
    assert len(there) > more_than
