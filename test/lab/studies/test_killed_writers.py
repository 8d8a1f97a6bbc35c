"""Kills lose no complete part, and what resumes doubles none."""

import os
import random
import signal
import subprocess
import sys
from contextlib import contextmanager

import part_writer
import pytest
from study_folders import record, rows_of

pytest.importorskip('pyarrow')

from ballbot_ros.lab.studies.manifest import PartSummary
from ballbot_ros.lab.studies.study_data import StudyData

KILLS = 100
MOST_PARTS = 8
MAX_DELAY_S = 0.02


@contextmanager
def part_writers():
    """Return a function that lets a process write a study, and returns its exit status."""
    with subprocess.Popen(
        [sys.executable, part_writer.__file__],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        bufsize=1,
    ) as program:

        def write(folder, parts='', delay_s=0.0):
            print(parts, delay_s, folder, sep='\t', file=program.stdin)
            return int(program.stdout.readline())

        try:
            yield write
        finally:
            program.stdin.close()
            program.wait()


def test_kills_lose_no_complete_part_and_double_none(tmp_path):
    moments = random.Random(3)
    study = record(**part_writer.SMALL)
    kills, folders, complete = 0, [], set()
    with part_writers() as write:
        while kills < KILLS:
            if not folders or len(complete) == study.parts:
                folders.append(tmp_path / f'study_{len(folders)}')
                complete = set()
            status = write(
                folders[-1], moments.randint(0, MOST_PARTS), moments.uniform(0, MAX_DELAY_S)
            )
            assert status in (0, -signal.SIGKILL)
            kills += status != 0
            there = {each.name for each in folders[-1].glob('parts/*.parquet')}
            assert complete <= there
            complete = there
        for folder in folders:
            assert write(folder) == 0
    # The studies got on in spite of the kills.
    assert len(folders) > 1
    whole = sum((rows_of(study, part).summary for part in range(study.parts)), PartSummary())
    for folder in folders:
        data = StudyData.open(folder)
        assert data.totals() == data.manifest.totals == whole
        assert data.column('number').tolist() == list(range(study.runs))
        assert not list(folder.rglob('*.tmp'))
        assert not (folder / 'damaged').exists()
