"""The parameters that a run sets for the graph."""

from dataclasses import replace

import pytest

pytest.importorskip('rclpy')

from ballbot_ros.parameters import ControllerParameters, PlantParameters, RecorderParameters
from ballbot_ros.run.graph import graph_parameters
from ballbot_ros.run.spec import RunOptions, RunSpec


@pytest.fixture
def spec():
    return RunSpec.of_scenario('stationary', RunOptions(assignments=('controller.sonar_hold=8',)))


def test_a_recorded_run_waits_for_its_recorder_which_attaches_its_files(spec, tmp_path):
    path = tmp_path / 'run.mcap'
    parameters = graph_parameters(spec, path, tmp_path)
    recorder = parameters.of(RecorderParameters)
    assert parameters.of(PlantParameters).require_recorder
    assert recorder.output == str(path)
    assert sorted(each.name for each in (tmp_path / 'attachments').iterdir()) == [
        'parameters.yaml', 'scenario.yaml', 'versions.yaml',
    ]  # fmt: skip
    assert recorder.attachments == str(tmp_path / 'attachments')


def test_a_recorder_that_chooses_its_file_attaches_them_too(spec, tmp_path):
    recorder = graph_parameters(spec, None, tmp_path).of(RecorderParameters)
    assert (recorder.output, recorder.attachments) == ('', str(tmp_path / 'attachments'))


def test_a_run_waits_for_a_recorder_of_the_user_and_attaches_nothing(spec, tmp_path):
    parameters = graph_parameters(replace(spec, external=('recorder',)), None, tmp_path)
    assert parameters.of(PlantParameters).require_recorder
    assert parameters.of(RecorderParameters) == RecorderParameters()
    assert list(tmp_path.iterdir()) == []


def test_a_run_without_a_recording_waits_for_none(spec, tmp_path):
    parameters = graph_parameters(replace(spec, record=False), None, tmp_path)
    assert not parameters.of(PlantParameters).require_recorder
    assert parameters.of(RecorderParameters) == RecorderParameters()
    assert list(tmp_path.iterdir()) == []


def test_the_parameters_of_the_run_stay_as_they_are(spec, tmp_path):
    before = spec.parameters.of(PlantParameters)
    parameters = graph_parameters(spec, tmp_path / 'run.mcap', tmp_path)
    assert spec.parameters.of(PlantParameters) == before
    assert parameters.of(ControllerParameters).sonar_hold == 8
