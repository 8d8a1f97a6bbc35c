"""Studies on a real Dask scheduler with real workers, which die and differ."""

import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
import tried_searches
import tried_studies
import yaml
from dask_processes import LAST_RESORT_S, ROOT, Cluster, environment, forked_workers, wait_for
from own_controllers import BALANCE
from PIL import Image
from tried_searches import Searching, files_in
from tried_studies import Observer, carry_out

pytest.importorskip('distributed')
pytest.importorskip('numba')

from distributed import Client

from ballbot_ros.errors import BallbotError
from ballbot_ros.lab.search.falsify import Falsification
from ballbot_ros.lab.search.falsify import search as search_violations
from ballbot_ros.lab.search.tune import run_tuning
from ballbot_ros.lab.search.tuning import read_tuning
from ballbot_ros.lab.studies import cluster
from ballbot_ros.lab.studies.cluster import workers_of
from ballbot_ros.lab.studies.execution import LocalWorkers
from ballbot_ros.lab.studies.reader import read_study

KILLS = int(os.environ.get('BALLBOT_TEST_KILLS', '8'))
"""How often a worker is killed; a kill costs half a second, so 100 are for those who ask."""

MOST_PARTS = 3
RUNS_PER_PART = 2

CONTENT = {
    'purpose': 'a test',
    'scenario': 'push',
    'runs': 1_000,
    'vary': {
        'plant_sim.body_mass': {'uniform': [0.6, 0.75]},
        'push.1.force': {'uniform': [0.5, 3.0]},
    },
    'metrics': ['peak_pitch_deg'],
    'expectations': {'peak_pitch_deg': {'max': 10.0}},
}
SMALL = {
    'scenario': 'stationary', 'runs': RUNS_PER_PART * MOST_PARTS * KILLS,
    'parameters': {'plant_sim': {'duration': 1.0}},
    'vary': {'plant_sim.body_mass': {'uniform': [0.6, 0.75]}},
}  # fmt: skip


def write(folder, **changes):
    return tried_studies.write(folder, {**CONTENT, **changes})


def refusal(path, output, address):
    with pytest.raises(BallbotError) as refused:
        carry_out(path, output, workers_of(address))
    assert '\n' not in str(refused.value)
    return str(refused.value)


@pytest.fixture(scope='module')
def here(tmp_path_factory):
    """Return the results of the cores of this machine, which also keep the compiled code."""
    folder = tmp_path_factory.mktemp('here')
    return carry_out(write(folder), folder / 'results', LocalWorkers).table()


@pytest.fixture(scope='module')
def two_workers(tmp_path_factory, here):
    with Cluster(tmp_path_factory.mktemp('cluster') / 'dask') as running:
        running.add_worker()
        running.add_worker()
        yield running


def test_the_rows_are_those_of_this_machine_even_if_a_worker_is_killed(two_workers, here, tmp_path):
    def kill():
        two_workers.workers[-1].kill()
        two_workers.add_worker()

    observer = Observer(first=kill)
    data = carry_out(
        write(tmp_path), tmp_path / 'results', workers_of(two_workers.address), observer
    )
    assert data.table().equals(here)
    assert observer.advanced == 1_000


def test_files_travel_with_the_job(two_workers, tmp_path, monkeypatch):
    """The workers can't read the map and the controller of this machine: they are removed."""
    floor = np.full((200, 200), 255, np.uint8)
    floor[:2] = floor[-2:] = floor[:, :2] = floor[:, -2:] = 0
    Image.fromarray(floor).save(tmp_path / 'own.png')
    (tmp_path / 'own.py').write_text(BALANCE)
    monkeypatch.chdir(tmp_path)
    scenario = {'purpose': 'a test', 'duration': 2.0, 'map': str(tmp_path / 'own.png')}
    (tmp_path / 'own.yaml').write_text(yaml.safe_dump(scenario))
    changes = {
        'scenario': 'own.yaml', 'controller': 'own.py:Balance', 'runs': 3,
        'vary': {'plant_sim.body_mass': {'uniform': [0.6, 0.7]}},
    }  # fmt: skip
    path = write(tmp_path, **changes)
    expected = carry_out(path, tmp_path / 'here', LocalWorkers).table()

    def remove():
        for name in ('own.png', 'own.py'):
            (tmp_path / name).unlink()

    observer = Observer(actions={'threads': remove})
    data = carry_out(path, tmp_path / 'there', workers_of(two_workers.address), observer)
    assert not (tmp_path / 'own.py').exists()
    assert data.table().equals(expected)


def test_a_tick_that_hangs_fails_its_run(two_workers, tmp_path):
    changes = {
        'controller': 'instance_controllers:Hanging', 'runs': 2,
        'parameters': {'plant_sim': {'duration': 1.0, 'timeout': 0.3}},
        'vary': {'plant_sim.body_mass': {'uniform': [0.6, 0.7]}},
    }  # fmt: skip
    path = write(tmp_path, **changes)
    data = carry_out(path, tmp_path / 'results', workers_of(two_workers.address))
    assert [row['outcome'] for row in data.table().to_pylist()] == ['failed', 'failed']


def test_searches_take_the_same_way_even_if_a_worker_is_killed(two_workers, tmp_path):
    pytest.importorskip('cma')

    def replaced_worker():
        kills = iter([two_workers.workers[-1].kill])

        def after():
            for kill in kills:
                kill()
                two_workers.add_worker()

        return Searching(after=after)

    path = tried_searches.write(tmp_path, tried_searches.TUNING)
    for place, observer, workers in (
        ('here', Searching(), LocalWorkers),
        ('there', replaced_worker(), workers_of(two_workers.address)),
    ):
        run_tuning(read_tuning(str(path)), tmp_path / place, observer, workers)
    assert files_in(tmp_path / 'there') == files_in(tmp_path / 'here') != {}
    tuned = [(tmp_path / place / 'tuned.yaml').read_text() for place in ('here', 'there')]
    assert tuned[0] == tuned[1]

    falsification = Falsification(
        read_study(str(tried_searches.write(tmp_path, tried_searches.STUDY))), 2
    )
    here = search_violations(falsification, tmp_path / 'violations', Searching())
    observer, workers = replaced_worker(), workers_of(two_workers.address)
    there = search_violations(falsification, tmp_path / 'violations_there', observer, workers)
    assert here.counterexamples == there.counterexamples != []


def test_sigint_cancels_the_parts_on_the_cluster(two_workers, tmp_path):
    path, output = write(tmp_path, runs=20_000), tmp_path / 'results'
    with subprocess.Popen(
        [sys.executable, '-m', 'ballbot_ros.cli.main', 'study', str(path), '--output', str(output),
         '--cluster', two_workers.address],
        env=environment(), text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        wait_for(lambda: list((output / 'parts').glob('*.parquet')))
        # The command opens no port.
        assert not listening_ports(process.pid)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=LAST_RESORT_S)
    assert process.returncode == 130
    assert 'the same command goes on from there' in errors
    assert 'Traceback' not in errors
    with Client(two_workers.address, set_as_default=False) as client:
        wait_for(lambda: client.run_on_scheduler(count_tasks) == 0)
    assert 0 < len(list((output / 'parts').iterdir())) < 16


def count_tasks(dask_scheduler):
    return len(dask_scheduler.tasks)


count_tasks.__module__ = '__main__'  # so that it is sent as it is


def listening_ports(process):
    """Return the sockets of a process that listen."""
    folder, listening = Path(f'/proc/{process}'), set()
    for table in ('tcp', 'tcp6'):
        for line in (folder / 'net' / table).read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == '0A':
                listening.add(f'socket:[{fields[9]}]')
    own = set()
    for descriptor in (folder / 'fd').iterdir():
        with suppress(OSError):
            own.add(str(descriptor.readlink()))
    assert own
    return own & listening


def test_a_study_waits_for_workers_and_goes_on_after_its_scheduler(here, two_workers, tmp_path):
    path, output = write(tmp_path), tmp_path / 'results'
    with Cluster(tmp_path / 'one') as lost:
        observer = Observer(first=lost.scheduler.kill, actions={'waiting': lost.add_worker})
        with pytest.raises(BallbotError, match='lost the scheduler') as refused:
            carry_out(path, output, workers_of(lost.address), observer)
        assert '\n' not in str(refused.value)
        assert f'dask worker {lost.address}' in observer.notices[0]
    written = len(list((output / 'parts').glob('*.parquet')))
    observer = Observer()
    data = carry_out(path, output, workers_of(two_workers.address), observer)
    assert 0 < observer.advanced < 1_000
    assert written < data.study.parts
    assert data.table().equals(here)


@pytest.fixture(scope='module')
def lonely(tmp_path_factory):
    """Return a scheduler without workers."""
    with Cluster(tmp_path_factory.mktemp('cluster') / 'dask') as running:
        yield running


def missing(package):
    def make(folder):
        (folder / package).mkdir()
        text = f'raise ModuleNotFoundError("No module named {package!r}", name={package!r})\n'
        (folder / package / '__init__.py').write_text(text)

    return make


def changed(folder):
    shutil.copytree(ROOT / 'ballbot_ros', folder / 'ballbot_ros')
    for name in ('config', 'package.xml'):
        (folder / name).symlink_to(ROOT / name)
    with (folder / 'ballbot_ros/errors.py').open('a') as file:
        file.write('# changed\n')


@pytest.mark.parametrize(
    ('make', 'told'),
    [
        (changed, 'its code of ballbot_ros is SHA-256 '),
        (missing('ballbot_ros'), 'has no ballbot_ros; install ballbot_ros 0.1.0'),
        (missing('numba'), 'compiled runs need numba: pip install'),
    ],
)
def test_a_worker_that_could_give_other_rows_is_refused(make, told, lonely, tmp_path):
    make(tmp_path)
    worker = lonely.add_worker(tmp_path)
    message = refusal(write(tmp_path), tmp_path / 'results', lonely.address)
    worker.kill()
    assert message.startswith('worker tcp://127.0.0.1:')
    assert told in message
    with Client(lonely.address, set_as_default=False) as client:
        wait_for(lambda: not client.nthreads())


@contextmanager
def silent():
    """Return the address of a program that answers nothing."""
    with socket.create_server(('127.0.0.1', 0)) as server:
        yield f'tcp://127.0.0.1:{server.getsockname()[1]}'


def test_what_is_no_scheduler_is_refused(lonely, tmp_path, monkeypatch):
    path, output = write(tmp_path), tmp_path / 'results'
    # Only where nothing answers: a scheduler on a busy machine may need longer.
    with monkeypatch.context() as patched:
        patched.setattr(cluster, 'CONNECT_TIMEOUT_S', 1.0)
        with silent() as address:
            message = refusal(path, output, address)
            assert message.startswith(f'{address}: no Dask scheduler answers')
        message = refusal(path, output, address)
        assert message.startswith(f'{address}: no Dask scheduler answers')
    for bad in ('scheduler', 'tcp://scheduler', 'http://scheduler:8786', 'tcp://scheduler:port'):
        assert 'not the address of a scheduler' in refusal(path, output, bad)
    own = cluster.worker_versions()
    monkeypatch.setattr(cluster, 'worker_versions', lambda: {**own, 'distributed': '1.0'})
    message = refusal(path, output, lonely.address)
    assert f'the scheduler has distributed {own["distributed"]}, this command 1.0' in message


@pytest.mark.slow
def test_workers_that_are_killed_again_and_again_cost_nothing(here, tmp_path, monkeypatch):
    monkeypatch.setattr(os, 'fsync', lambda descriptor: None)  # most of the time, with small parts
    path, moments = write(tmp_path, **SMALL), random.Random(5)
    expected = carry_out(path, tmp_path / 'here', LocalWorkers).table()
    # A part is in work again and again when a worker is killed, by no fault of its own.
    variables = {'DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES': '1000'}
    with (
        Cluster(tmp_path / 'dask', **variables) as running,
        forked_workers(running.address, tmp_path / 'workers', path) as start,
    ):
        workers = [start(), start()]
        kills, until = 0, 1

        def kill():
            nonlocal kills, until
            until -= 1
            if until == 0 and kills < KILLS:
                os.kill(workers.pop(0), signal.SIGKILL)
                workers.append(start())
                kills, until = kills + 1, moments.randint(1, MOST_PARTS)

        begun = time.monotonic()
        observer = Observer(each=kill)
        data = carry_out(
            path,
            tmp_path / 'there',
            workers_of(running.address),
            observer,
            runs_per_part=RUNS_PER_PART,
        )
        print(f'{kills} kills in {time.monotonic() - begun:.1f} s')
    assert kills == KILLS
    assert observer.advanced == SMALL['runs']
    assert data.table().equals(expected)
    assert len(list((tmp_path / 'there/parts').iterdir())) == MOST_PARTS * KILLS
