"""The same bits with any processor, C library, Python, numpy and scipy.

The machine as it is computes all golden runs. Each row of the matrix computes some in a separate
process, and proves by the bits of scipy's matrix exponential or of the C library's sine that its
setting took effect. A row whose setting this machine lacks is skipped as not exercised.

A setting changes a library's functions, and a run calls the same functions again and again. So a
row computes the arithmetic, a share of the random runs, whose hashes see every bit, and two
scenarios, a linear and a nonlinear one. Another Python may change anything: it computes all
scenarios.
"""

import functools
import json
import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import setuptools
from golden_runs import MODELS, RANDOM_FILE, SETS, SHARES, WITHOUT_FMA, seeds_of_share

from ballbot_ros.engine.golden import load_golden
from ballbot_ros.engine.scenario.reader import scenario_names
from ballbot_ros.run.machine_checks import GOLDEN_SCENARIOS

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / 'test' / 'golden_runs.py'

# Oldest first. A processor that lacks the instructions of one uses a kernel of another row, or ends
# the process.
CORE_TYPES = ('Nehalem', 'Sandybridge', 'Haswell', 'SkylakeX')
PACKAGES = ('numpy', 'scipy', 'pillow', 'PyYAML')


def compute(*arguments, python=sys.executable, **settings):
    kept = {'PATH', 'HOME', 'TMPDIR', 'LD_LIBRARY_PATH'}
    environment = {name: value for name, value in os.environ.items() if name in kept}
    done = subprocess.run(
        [python, PROGRAM, *arguments],
        env={**environment, 'PYTHONPATH': str(ROOT), 'PYTHONDONTWRITEBYTECODE': '1', **settings},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


@functools.cache
def probe(**settings):
    return compute('--probe', **settings)['probes']


def probe_kernels(core_type):
    """Return the matrix exponential with the kernels of a processor; None if they do not run."""
    try:
        return probe(OPENBLAS_CORETYPE=core_type)['expm']
    except subprocess.CalledProcessError as error:
        if error.returncode != -signal.SIGILL:
            raise
        return None


def assert_golden(answer, seeds, scenarios):
    golden = load_golden()
    assert answer['arithmetic'] == golden.arithmetic
    assert answer['scenarios'] == {name: golden.scenarios[name] for name in scenarios}
    expected = json.loads(RANDOM_FILE.read_text())
    differing = [
        (model, seed)
        for model in MODELS
        for seed, digest in zip(seeds, answer['random'][model], strict=True)
        if digest != expected[model][seed]
    ]
    assert not differing


def assert_share_is_golden(share, **settings):
    """Each row has a share of its own, so that the rows together compute nearly all runs."""
    answer = compute('--share', str(share), *GOLDEN_SCENARIOS, **settings)
    assert_golden(answer, seeds_of_share(share), GOLDEN_SCENARIOS)


def test_every_scenario_and_200_random_runs_of_each_model_have_a_golden_hash():
    assert list(load_golden().scenarios) == scenario_names()
    expected = json.loads(RANDOM_FILE.read_text())
    assert list(expected) == list(MODELS)
    for hashes in expected.values():
        assert len(set(hashes)) == SETS == 200


def test_the_shares_are_all_random_runs_and_each_has_both_kinds():
    shares = [seeds_of_share(number) for number in range(SHARES)]
    assert sorted(seed for share in shares for seed in share) == list(range(SETS))
    assert all({seed % 2 for seed in share} == {0, 1} for share in shares)


def test_this_machine_as_it_is():
    assert_golden(compute(), range(SETS), scenario_names())


@pytest.mark.parametrize('core_type', CORE_TYPES)
def test_the_kernels_of_another_processor(core_type):
    number = CORE_TYPES.index(core_type)
    others = CORE_TYPES[:number] or CORE_TYPES[1:2]
    here = probe_kernels(core_type)
    if here is None:
        pytest.skip(f'not exercised: this processor lacks instructions of {core_type}')
    if here in (probe_kernels(other) for other in others):
        pytest.skip(f'not exercised: OPENBLAS_CORETYPE={core_type} changes no bit here')
    assert_share_is_golden(number, OPENBLAS_CORETYPE=core_type)


def test_a_c_library_without_fused_multiply_add():
    if probe(**WITHOUT_FMA)['sine'] == probe()['sine']:
        pytest.skip('not exercised: GLIBC_TUNABLES changes no bit of the sine here')
    assert_share_is_golden(len(CORE_TYPES), **WITHOUT_FMA)


def find_python(minor):
    """Return a working Python 3.`minor`, or None: from PATH, or from pyenv."""
    pyenv = Path(os.environ.get('PYENV_ROOT', Path.home() / '.pyenv'))
    candidates = [shutil.which(f'python3.{minor}')]
    candidates += sorted(pyenv.glob(f'versions/3.{minor}.*/bin/python3'))
    for candidate in filter(None, candidates):
        command = [candidate, '-c', 'import sys, venv; print(sys.version_info[1])']
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.stdout.strip() == str(minor):
            return candidate
    return None


def oldest_allowed(monkeypatch):
    """Return the requirements for the oldest numpy and scipy that setup.py allows."""
    arguments = {}
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(setuptools, 'setup', arguments.update)
    runpy.run_path('setup.py')
    bounds = dict(
        re.fullmatch(r'([\w-]+)>=([\d.]+)', text).groups()
        for text in arguments['install_requires']
        if text.startswith(('numpy', 'scipy'))
    )
    return {name: f'{lowest}.0' for name, lowest in bounds.items()}


@functools.cache
def other_pythons():
    """Return the Pythons 3.10 to 3.13 that are found besides the running one, by minor number."""
    minors = [minor for minor in range(10, 14) if minor != sys.version_info.minor]
    found = {minor: find_python(minor) for minor in minors}
    return {minor: python for minor, python in found.items() if python}


@pytest.mark.slow
@pytest.mark.timeout(900)  # pip downloads
@pytest.mark.parametrize('select', [min, max], ids=['oldest', 'newest'])
def test_another_python_with_numpy_and_scipy_of_its_age(select, tmp_path, monkeypatch):
    """The oldest found with the oldest releases, the newest with the newest.

    What is between them differs from both by less than they do from each other.
    """
    if not other_pythons():
        pytest.skip('not exercised: this machine has no other Python 3.10 to 3.13')
    minor = select(other_pythons())
    python = other_pythons()[minor]
    pinned = oldest_allowed(monkeypatch) if select is min else {}
    wanted = [f'{name}=={pinned[name]}' if name in pinned else name for name in PACKAGES]
    subprocess.run([python, '-m', 'venv', '--without-pip', tmp_path / 'venv'], check=True)
    own = tmp_path / 'venv' / 'bin' / 'python'
    installed = subprocess.run(
        [sys.executable, '-m', 'pip', '--python', own, 'install', '--quiet', '--no-compile',
         '--disable-pip-version-check', '--only-binary=:all:', *wanted],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if installed.returncode:
        pytest.skip(f'not exercised: pip installs no {" ".join(wanted)}: {installed.stderr[-200:]}')
    answer = compute('--share', str(minor), python=own)
    versions = answer['probes']
    assert versions['python'].startswith(f'3.{minor}.')
    for name, version in pinned.items():
        assert versions[name] == version
    assert_golden(answer, seeds_of_share(minor), scenario_names())
