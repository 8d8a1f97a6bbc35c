"""Studies as a whole: parts, resumption, stopping, rows that equal runs."""

import json
import os
import signal
import subprocess
from pathlib import Path

import pytest
import tried_studies
from graph import BALLBOT, LAST_RESORT_S, wait_for
from tried_studies import Observer, carry_out

from ballbot_ros.errors import BallbotError
from ballbot_ros.lab.studies import execution
from ballbot_ros.lab.studies.execution import run_study
from ballbot_ros.lab.studies.job import job_of
from ballbot_ros.lab.studies.reader import read_study
from ballbot_ros.lab.studies.sampling import Sampler
from ballbot_ros.lab.studies.study_data import StudyData

ROOT = Path(__file__).resolve().parents[3]
CONTENT = {
    'purpose': 'a test',
    'scenario': 'push',
    'runs': 60,
    'vary': {
        'plant_sim.body_mass': {'uniform': [0.6, 0.75]},
        'plant_sim.plant_model': {'list': ['linear', 'nonlinear']},
        'push.1.force': {'uniform': [0.5, 3.0]},
        'gyro_driver.noise': {'normal': [0.7, 0.1], 'min': 0.0, 'max': 1.0},
    },
    'metrics': ['peak_pitch_deg', 'settling_time_s'],
    'expectations': {'peak_pitch_deg': {'max': 10.0}},
}


def write(folder, **changes):
    return tried_studies.write(folder, {**CONTENT, **changes})


@pytest.fixture(scope='module')
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp('study')
    observer = Observer()
    return carry_out(write(folder), folder / 'results', observer=observer), observer


def test_all_runs_are_done_once(finished):
    data, observer = finished
    table = data.table()
    assert table['number'].to_pylist() == list(range(60))
    assert len(set(table['seed'].to_pylist())) == 60
    assert (observer.runs, observer.done.runs, observer.advanced) == (60, 0, 60)
    assert data.manifest.finished
    assert data.totals().runs == 60
    assert 0 < data.totals().passed < 60


def equal(one, other):
    return one.table().equals(other.table())


def test_a_finished_study_is_not_run_again_unless_asked(finished, tmp_path):
    path, output = write(tmp_path), tmp_path / 'results'
    carry_out(path, output)
    observer = Observer()
    carry_out(path, output, observer=observer)
    assert (observer.advanced, observer.done.runs) == (0, 60)
    observer = Observer()
    data = carry_out(path, output, observer=observer, again=True)
    assert (observer.advanced, observer.done.runs) == (60, 0)
    assert equal(data, finished[0])


def test_code_that_is_not_on_disk_is_compiled_where_it_can_be_given_up(monkeypatch, tmp_path):
    monkeypatch.setattr('ballbot_ros.lab.studies.programs.is_kept', lambda function: False)
    study = read_study(str(write(tmp_path)))
    observer = Observer()
    workers = execution.LocalWorkers(job_of(study, tmp_path / 'results'), observer)
    part = workers.submit(0, Sampler(study).part(0, 1))
    wait_for(lambda: workers._processes, what='a process')
    workers.close()
    assert isinstance(part.exception(), execution.PartGivenUpError)
    assert observer.notices == ['compiling, which takes about 20 s the first time ...']


def test_an_interrupted_study_goes_on(finished, tmp_path):
    path, output = write(tmp_path), tmp_path / 'results'
    parts = iter(range(3))

    def interrupt():
        if next(parts, None) is None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        carry_out(path, output, observer=Observer(each=interrupt))
    observer = Observer()
    data = carry_out(path, output, observer=observer)
    assert 0 < observer.done.runs < 60
    assert observer.done.runs + observer.advanced == 60
    assert equal(data, finished[0])


def test_a_missing_and_a_damaged_part_are_done_again(finished, tmp_path):
    path, output = write(tmp_path), tmp_path / 'results'
    carry_out(path, output)
    parts = sorted((output / 'parts').iterdir())
    parts[1].unlink()
    damaged = bytearray(parts[2].read_bytes())
    damaged[100] ^= 1
    parts[2].write_bytes(damaged)
    observer = Observer()
    data = carry_out(path, output, observer=observer)
    assert observer.advanced == 2 * data.study.runs_per_part
    assert [parts[2].name in notice for notice in observer.notices] == [True]
    assert equal(data, finished[0])


def test_the_folder_of_another_study_is_refused(finished, tmp_path):
    data, _ = finished
    with pytest.raises(BallbotError, match='its seed: 1, not 2') as refused:
        carry_out(write(tmp_path), data.path, seed=2)
    assert '\n' not in str(refused.value)


def test_without_numba_a_small_study_runs_and_a_large_one_is_refused(
    finished, tmp_path, monkeypatch
):
    monkeypatch.setattr('ballbot_ros.lab.studies.programs.can_compile', lambda: False)
    path = write(tmp_path)
    study = read_study(str(path), runs=4)
    observer = Observer()
    job = job_of(study, tmp_path / 'results')
    workers = SameProcess()
    monkeypatch.setattr('ballbot_ros.lab.studies.execution.WorkerProcess', lambda: workers)
    run_study(job, observer)
    assert [notice.partition(',')[0] for notice in observer.notices] == ['numba is not installed']
    few = StudyData.open(tmp_path / 'results').table().column('duty_sha256').to_pylist()
    assert few == finished[0].table().column('duty_sha256').to_pylist()[:4]
    large = read_study(str(path), runs=1_000_000)
    with pytest.raises(BallbotError, match='s of simulation need numba'):
        run_study(job_of(large, tmp_path / 'large'), observer)


class SameProcess:
    """Does parts in this process."""

    def call(self, method, job, part, samples):
        return method(job, part, samples, lambda runs: None)

    def kill(self):
        pass


def start(*words):
    """Start the command on two cores at most: with more, it would do all parts at a time."""
    cores = ','.join(map(str, sorted(os.sched_getaffinity(0))[:2]))
    return subprocess.Popen(
        ['taskset', '--cpu-list', cores, *BALLBOT, 'study', *map(str, words)],
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
        text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def await_part(process, output, known):
    """Wait until the command has written a part."""
    wait_for(lambda: parts_in(output) - known or process.poll() is not None, 'a part')


def parts_in(output):
    return {each.name for each in (output / 'parts').glob('*.parquet')}


LONG = {'runs': 6_000, 'vary': {'plant_sim.body_mass': {'uniform': [0.6, 0.75]}}}


def test_a_signal_costs_the_parts_in_work_only(command, tmp_path):
    """One study, which a signal stops again and again."""
    path, output = write(tmp_path, **LONG), tmp_path / 'results'
    words = (path, '--output', output, '--json')
    written = set()
    for number, times in (
        (signal.SIGINT, 1), (signal.SIGINT, 2), (signal.SIGTERM, 1), (signal.SIGKILL, 1),
    ):  # fmt: skip
        with start(*words) as process:
            await_part(process, output, written)
            for _ in range(times):
                process.send_signal(number)
            _, errors = process.communicate(timeout=LAST_RESORT_S)
        assert process.returncode == (-number if number == signal.SIGKILL else 128 + number)
        assert 'Traceback' not in errors
        assert ('goes on after' in errors) == bool(written)
        if number != signal.SIGKILL:
            assert 'the same command goes on from there' in errors
        assert written < parts_in(output)
        written = parts_in(output)
    status, answer, errors = command('study', *words)
    assert status == 0, errors
    assert 'goes on after' in errors
    assert json.loads(answer)['runs'] == 6_000
    data = StudyData.open(output)
    assert len(written) < data.study.parts
    assert data.table()['number'].to_pylist() == list(range(6_000))
