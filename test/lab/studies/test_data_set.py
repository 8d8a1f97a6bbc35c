"""A study's folder begins, resumes and ends; other folders, and faults, are refused in one line."""

import errno
import json
import os
import resource
import shutil
import subprocess
from contextlib import contextmanager
from pathlib import Path

import pytest
from laws import refusal
from study_folders import MEASURES, NOW, VARIED, encoded, record, rows_of, write_part, write_study

pytest.importorskip('pyarrow')

from ballbot_ros.errors import StudyError
from ballbot_ros.lab.studies.data_set import begin_or_resume, read_manifest
from ballbot_ros.lab.studies.manifest import Manifest, PartSummary, StudyRecord, Versions
from ballbot_ros.lab.studies.part_file import store_part
from ballbot_ros.lab.studies.study_data import StudyData


@pytest.fixture
def folder(tmp_path):
    return tmp_path / 'study'


def begin(folder, study):
    """Begin or resume a study, and leave its folder again."""
    with begin_or_resume(folder, study, NOW):
        pass


def totals(study):
    return sum((rows_of(study, part).summary for part in range(study.parts)), PartSummary())


def files(folder):
    return {each: each.read_bytes() for each in folder.rglob('*') if each.is_file()}


def test_a_study_begins_and_ends(folder):
    study = record()
    with begin_or_resume(folder, study, NOW) as begun:
        assert (begun.resumed, begun.is_finished) == (False, False)
        assert begun.check_parts() == ([0, 1, 2], PartSummary(), [])
        summaries = [write_part(folder, study, part, rows_of(study, part)) for part in (2, 0)]
        assert begun.check_parts() == ([1], sum(summaries, PartSummary()), [])
        assert begun.finish(NOW).missing == [1]
        assert not begun.is_finished
        write_part(folder, study, 1, rows_of(study, 1))
        assert begun.finish(NOW) == ([], totals(study), [])
        assert begun.is_finished
    assert {each.name for each in folder.iterdir()} == {'.lock', 'manifest.json', 'parts'}
    assert len(list((folder / 'parts').iterdir())) == 3
    manifest = read_manifest(folder)
    assert manifest == Manifest(study, NOW.isoformat(), NOW.isoformat(), totals(study))


def test_an_interrupted_study_resumes(folder):
    study = write_study(folder, parts=[1])
    before = files(folder)
    dead = folder / 'parts/.part-000002.parquet.0f.tmp'
    dead.write_bytes(b'PAR1')
    (folder / '.manifest.json.0f.tmp').write_bytes(b'{')
    with begin_or_resume(folder, study, NOW) as begun:
        assert begun.resumed
        check = begun.check_parts()
    assert (check.missing, check.notices) == ([0, 2], [])
    assert files(folder) == before


def test_a_finished_study_says_so_and_restarts_only_if_asked(folder):
    study = write_study(folder)
    before = files(folder)
    with begin_or_resume(folder, study, NOW) as begun:
        assert begun.is_finished
        assert begun.check_parts().missing == []
        assert files(folder) == before
        begun.restart(NOW)
        assert not begun.is_finished
        assert begun.check_parts() == ([0, 1, 2], PartSummary(), [])
    with begin_or_resume(folder, study, NOW) as begun:
        assert not begun.is_finished


def test_another_study_is_refused(folder):
    write_study(folder, parts=[0])
    before = files(folder)
    versions = record().versions
    for other, difference in (
        (record(name='basin'), 'its name: robustness, not basin'),
        (record(runs=26), 'its runs: 25, not 26'),
        (record(seed=2), 'its seed: 1, not 2'),
        (record(text='runs: 25 \n'), 'its text differs'),
        (record(scenario=''), 'its scenario differs'),
        (record(parameters=''), 'its parameters differ'),
        (record(runs_per_part=5), 'its runs per part differ'),
        (record(varied=VARIED[:2]), 'its columns differ'),
        (record(measures=MEASURES[::-1]), 'its columns differ'),
        (record(code_sha256='1' * 64), 'its code differs'),
        (
            record(versions=Versions('0.1', '3.12', '2.1', '1.14', '0.60', '18.0')),
            'its numpy version: 2.0, not 2.1',
        ),
    ):
        text = refusal(StudyError, begin, folder, other)
        assert text.startswith(f'{folder}: '), text
        assert difference in text
        assert 'choose another --output' in text
    assert files(folder) == before
    # Results do not depend on these.
    same = Versions('0.1', '3.13', versions.numpy, versions.scipy, '0.61', '19.0')
    with begin_or_resume(folder, record(versions=same), NOW) as begun:
        assert begun.resumed


def test_a_record_of_this_code_has_its_identity():
    known = (
        'text',
        'scenario',
        'parameters',
        'runs',
        'seed',
        'runs_per_part',
        'varied',
        'measures',
    )
    study = StudyRecord('robustness', **{name: getattr(record(), name) for name in known})
    assert len(study.code_sha256) == 64
    assert study.versions.numpy
    assert study.versions.pyarrow
    assert Manifest.from_json(Manifest(study, 'now').to_json()) == Manifest(study, 'now')


def test_foreign_folders_are_refused_and_left_alone(tmp_path):
    file = tmp_path / 'file'
    file.write_text('mine')
    foreign = tmp_path / 'foreign'
    foreign.mkdir()
    (foreign / 'notes.txt').write_text('mine')
    no_manifest = tmp_path / 'no_manifest'
    write_study(no_manifest)
    (no_manifest / 'manifest.json').unlink()
    parts_is_file = tmp_path / 'parts_is_file'
    parts_is_file.mkdir()
    (parts_is_file / 'parts').write_text('mine')
    before = files(tmp_path)
    for folder, reason in (
        (file, 'not a folder'),
        (file / 'below', 'not a folder'),
        (foreign, 'has files, but no manifest.json'),
        (no_manifest, 'has files, but no manifest.json'),
        (parts_is_file, 'has files, but no manifest.json'),
        (Path('/proc/ballbot_study'), 'No such file or directory'),
        (tmp_path / ('n' * 300), 'File name too long'),
    ):
        text = refusal(StudyError, begin, folder, record())
        assert str(folder) in text, text
        assert reason in text
        assert '--output' in text
    assert files(tmp_path) == before


def test_what_a_kill_at_the_beginning_leaves_is_no_foreign_folder(folder):
    (folder / 'parts').mkdir(parents=True)
    (folder / '.lock').touch()
    (folder / '.manifest.json.0f.tmp').write_text('{')
    with begin_or_resume(folder, record(), NOW) as begun:
        assert not begun.resumed
    assert not (folder / '.manifest.json.0f.tmp').exists()


def test_a_damaged_manifest_is_refused(folder):
    write_study(folder)
    path = folder / 'manifest.json'
    good = path.read_text(encoding='utf-8')

    def altered(change):
        values = json.loads(good)
        change(values)
        return json.dumps(values).encode()

    texts = [
        b'', b'[]', b'{}', b'null', b'\xff', b'[' * 100_000, good.encode()[:-3], good.encode()[:99],
        altered(lambda values: values.update(format=2)),
        altered(lambda values: values.update(identity='0')),
        altered(lambda values: values.update(begun=1)),
        altered(lambda values: values.pop('totals')),
        altered(lambda values: values['study'].update(runs=24)),
        altered(lambda values: values['study'].update(runs='24')),
        altered(lambda values: values['study'].update(runs=True)),
        altered(lambda values: values['study'].update(runs=-1)),
        altered(lambda values: values['study'].update(more=1)),
        altered(lambda values: values['study'].update(versions=[])),
        altered(lambda values: values['study']['varied'].append(None)),
        altered(lambda values: values['study']['varied'][0].update(kind='complex')),
        altered(lambda values: values['study']['measures'][0].update(maximum=6.0)),
    ]  # fmt: skip
    for text in texts:
        path.write_bytes(text)
        for read in (StudyData.open, read_manifest):
            assert str(path) in refusal(StudyError, read, folder), text
        message = refusal(StudyError, begin, folder, record())
        assert 'choose another --output' in message, text
        assert path.read_bytes() == text
    path.unlink()
    path.mkdir()
    assert 'directory' in refusal(StudyError, read_manifest, folder)


def test_damaged_and_foreign_parts_are_moved_aside_and_redone(folder):
    study = write_study(folder)
    good = files(folder)
    parts = folder / 'parts'
    names = [study.part_name(part) for part in range(3)]
    (parts / names[0]).write_bytes(b'')
    (parts / names[1]).write_bytes(encoded(study, 0, rows_of(study, 0)).data)
    (parts / 'part-000009.parquet').write_bytes(b'mine')
    for round_ in (1, 2):
        with begin_or_resume(folder, study, NOW) as begun:
            check = begun.check_parts()
            assert check.missing == [0, 1]
            assert check.summary == rows_of(study, 2).summary
            reasons = [] if round_ == 2 else ['not a part of this study']
            for reason in (*reasons, 'empty', 'another part of this study'):
                assert any(reason in each for each in check.notices), reason
            assert all('\n' not in each and 'moved to' in each for each in check.notices)
            for part in check.missing:
                write_part(folder, study, part, rows_of(study, part))
            assert begun.finish(NOW) == ([], totals(study), [])
        kept = {each: data for each, data in files(folder).items() if 'damaged' not in each.parts}
        assert kept == good
        (parts / names[0]).write_bytes(b'')
        (parts / names[1]).write_bytes(encoded(study, 0, rows_of(study, 0)).data)
    assert len(list((folder / 'damaged').iterdir())) == 5


def test_a_folder_without_parts_can_be_another_study(folder):
    begin(folder, record())
    with begin_or_resume(folder, record(seed=2), NOW) as begun:
        assert begun.study.seed == read_manifest(folder).study.seed == 2


def test_one_command_at_a_time(folder):
    with begin_or_resume(folder, record(), NOW):
        text = refusal(StudyError, begin, folder, record())
        assert 'in use by another command' in text
    begin(folder, record())
    # A study that is refused does not stay locked.
    write_study(folder, parts=[0])
    refusal(StudyError, begin, folder, record(seed=2))
    begin(folder, record())


def test_the_lock_ends_although_a_forked_worker_lives(folder):
    with begin_or_resume(folder, record(), NOW):
        read, write = os.pipe()
        worker = os.fork()
        if worker == 0:
            os.close(write)
            os.read(read, 1)
            os._exit(0)
        os.close(read)
    try:
        begin(folder, record())
    finally:
        os.close(write)
        os.waitpid(worker, 0)


def test_a_late_writer_does_no_harm(folder, monkeypatch):
    study = write_study(folder)
    good = files(folder)
    write_part(folder, study, 1, rows_of(study, 1))
    assert files(folder) == good
    # A command that resumes the study removes its temporary file: it writes another one.
    replace = Path.replace
    removals = iter([True])

    def removed_once(self, target):
        if next(removals, False):
            self.unlink()
        return replace(self, target)

    monkeypatch.setattr(Path, 'replace', removed_once)
    write_part(folder, study, 1, rows_of(study, 1))
    assert files(folder) == good
    shutil.rmtree(folder)
    assert str(folder) in refusal(StudyError, write_part, folder, study, 1, rows_of(study, 1))


@contextmanager
def small_files(size):
    """Let this process write no larger files."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_part_that_can_not_be_written_leaves_nothing(folder, monkeypatch):
    study = write_study(folder, parts=[0])
    good = files(folder)
    part = (folder, study, 1, encoded(study, 1, rows_of(study, 1)).data)
    with small_files(1000):
        text = refusal(StudyError, store_part, *part)
    assert 'File too large; the parts in the folder are kept' in text
    assert files(folder) == good

    def full(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(os, 'fsync', full)
        text = refusal(StudyError, store_part, *part)
        assert 'No space left on device' in text
        assert 'make room and give the same command again' in text
        assert files(folder) == good
        with begin_or_resume(folder, study, NOW) as begun:
            assert 'No space left' in refusal(StudyError, begun.restart, NOW)
        refusal(StudyError, begin, folder.parent / 'new', study)
    assert files(folder) == good
    with begin_or_resume(folder.parent / 'new', study, NOW) as begun:
        assert not begun.resumed


@pytest.fixture
def small_disk(tmp_path):
    """Return a folder on a file system of 64 KiB."""
    path = tmp_path / 'disk'
    path.mkdir()
    command = ['mount', '-t', 'tmpfs', '-o', 'size=64k', 'ballbot_test', path]
    try:
        mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip('no file system can be mounted here')
    yield path
    subprocess.run(['umount', path], check=True)


def write_all(folder, study):
    for part in range(study.parts):
        write_part(folder, study, part, rows_of(study, part))


def test_a_full_disk_keeps_what_is_complete(small_disk):
    study = record(runs=300)
    folder = small_disk / 'study'
    with begin_or_resume(folder, study, NOW):
        text = refusal(StudyError, write_all, folder, study)
        assert 'No space left on device' in text
        written = len(list((folder / 'parts').glob('*.parquet')))
        assert 0 < written < study.parts
    (folder / 'parts' / study.part_name(0)).unlink()
    with begin_or_resume(folder, study, NOW) as begun:
        check = begun.check_parts()
        assert check.missing == [0, *range(written, study.parts)]
        assert check.notices == []
        write_part(folder, study, 0, rows_of(study, 0))
