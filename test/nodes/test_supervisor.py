"""The choice of the next scenario, by the page of `ballbot run --viewer` and by `ros2`."""

import re
import signal

import pytest
from graph import wait_for
from mcap.reader import make_reader

pytest.importorskip('viser', reason='the extra viewer is not installed')
pytestmark = pytest.mark.graph

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue  # noqa: E402
from rcl_interfaces.srv import GetParameters, SetParameters  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402
from terminal import Terminal  # noqa: E402


def start(client, scenario):
    text = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=scenario)
    request = SetParameters.Request(parameters=[Parameter(name='scenario', value=text)])
    assert client.call(SetParameters, 'supervisor/set_parameters', request).results[0].successful
    return client.call(Trigger, 'supervisor/start', Trigger.Request())


def test_the_page_outlasts_its_runs(start_run, client, tmp_path):
    terminal = Terminal()
    run = start_run(
        'stationary', '--viewer', '--no-wait', '--set', 'viewer.port=0',
        '--set', 'plant_sim.duration=0.5', '--output', tmp_path, stderr=terminal.side,
    )  # fmt: skip
    terminal.wait_for_text(b'the page stays')
    assert run.process.poll() is None
    asked = GetParameters.Request(names=['scenario'])
    (chosen,) = client.call(GetParameters, 'supervisor/get_parameters', asked).values
    assert chosen.string_value == 'stationary'
    refused = start(client, 'nonsense')
    assert not refused.success
    assert 'unknown scenario' in refused.message

    for number, scenario in ((2, 'square'), (3, 'push')):  # the second ends the first
        assert start(client, scenario).success
        recording = tmp_path / f'{number}/{scenario}.mcap'
        wait_for(recording.exists, what='the recording of the other scenario')
    run.process.send_signal(signal.SIGINT)
    assert run.finish() == 128 + signal.SIGINT
    assert 'stopped' in run.stdout
    (address,) = set(re.findall(rb'viewer  (\S+)', terminal.screen))
    assert terminal.screen.count(b'the page stays') == 1
    token = address.rpartition(b'token=')[2]
    recordings = list(tmp_path.rglob('*.mcap'))
    assert len(recordings) == 3
    assert not any(token in content for path in recordings for content in contents(path))


def contents(recording):
    """Return the content of a recording."""
    with recording.open('rb') as stream:
        reader = make_reader(stream)
        return [
            *(message.data for _, _, message in reader.iter_messages()),
            *(attachment.data for attachment in reader.iter_attachments()),
            *(str(record).encode() for record in reader.iter_metadata()),
        ]
