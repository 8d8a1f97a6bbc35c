"""The Python of the page that runs the robot in a browser, in this interpreter without numpy."""

import functools
import importlib.util
import json
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

PLAYGROUND = Path(__file__).parents[1] / 'docs/playground'

_RUN = """
import json, sys
sys.path[:0] = [sys.argv[1]]
import session
session.use_tables()
assert 'ballbot_ros' in sys.modules['ballbot_ros'].__file__
print(json.dumps({code}))
"""


def load(name):
    """Import a module of the page from its file."""
    spec = importlib.util.spec_from_file_location(f'playground_{name}', PLAYGROUND / name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@functools.cache
def _unpacked():
    folder = tempfile.TemporaryDirectory()
    code = (
        f'import sys; sys.path[:0] = [{str(PLAYGROUND)!r}]; from pathlib import Path; import build;'
        'build.write_python(Path(sys.argv[1]), build.map_names())'
    )
    archive = Path(folder.name) / 'python.zip'
    subprocess.run([sys.executable, '-c', code, archive], check=True)
    with zipfile.ZipFile(archive) as opened:
        opened.extractall(folder.name)
    return folder


def without_numpy(code):
    """Return what an expression with the module `session` gives, without installed packages."""
    command = [sys.executable, '-S', '-I', '-c', _RUN.format(code=code), _unpacked().name]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
