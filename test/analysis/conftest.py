"""Recordings of runs without nodes, and changed copies of them."""

from functools import partial

import pytest
from graph import record
from recordings import copy_recording

from ballbot_ros.analysis.assessment import assess
from ballbot_ros.analysis.report import report_document
from ballbot_ros.analysis.run_data import read_run


@pytest.fixture(scope='session')
def make_run(tmp_path_factory):
    """Run a scenario; return the recording and the result that the run printed."""

    def make(scenario, *arguments):
        return record(tmp_path_factory.mktemp('run'), scenario, *arguments)

    return make


@pytest.fixture(scope='session')
def driven(make_run):
    """The scenario forward_backward, with noise in plane y."""
    return make_run('forward_backward', '--set=gyro_driver.noise=0.7')


@pytest.fixture(scope='session')
def short(make_run):
    """Three seconds of the scenario stationary."""
    return make_run('stationary', '--set=plant_sim.duration=3')


@pytest.fixture(scope='session')
def driven_assessment(driven):
    return assess(read_run(driven[0]))


@pytest.fixture(scope='session')
def short_assessment(short):
    return assess(read_run(short[0]))


@pytest.fixture(scope='session')
def short_document(short_assessment):
    return report_document(short_assessment)


@pytest.fixture
def copy(tmp_path):
    """Write a changed copy of recordings, one after the other."""
    return partial(copy_recording, tmp_path / 'copy.mcap')
