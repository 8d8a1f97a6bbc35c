"""The choice of the next scenario, as the page of `ballbot run --viewer` and `ros2` make it."""

import re
import signal

import pytest
from graph import children, wait_for

pytest.importorskip('viser', reason='the extra viewer is not installed')
pytestmark = pytest.mark.graph

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from ros_client import Client  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402
from terminal import Terminal  # noqa: E402

from ballbot_ros.recording.reader import RecordingReader  # noqa: E402

STAYS = b'the page stays'


@pytest.fixture
def client(domain):
    client = Client(domain)
    yield client
    client.close()


def start(client, scenario):
    text = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=scenario)
    request = SetParameters.Request(parameters=[Parameter(name='scenario', value=text)])
    assert client.call(SetParameters, 'supervisor/set_parameters', request).results[0].successful
    return client.call(Trigger, 'supervisor/start', Trigger.Request())


def test_another_scenario_takes_the_place_of_the_run_and_the_page_stays(
    start_run, client, tmp_path
):
    terminal = Terminal()
    run = start_run(
        'stationary', '--viewer', '--set', 'viewer.port=0', '--set', 'plant_sim.duration=60',
        '--output', tmp_path, stderr=terminal.side,
    )  # fmt: skip
    terminal.wait_for_text(b' / 60 s', timeout=40.0)
    refused = start(client, 'nonsense')
    assert not refused.success
    assert 'unknown scenario' in refused.message

    assert start(client, 'square').success
    wait_for((tmp_path / '2/square.mcap').exists, what='the recording of the other scenario')
    terminal.wait_for_text(b' / 60 s', since=len(terminal.screen), timeout=40.0)
    viewers = set(re.findall(rb'viewer  (\S+)', terminal.screen))
    assert len(viewers) == 1

    run.process.send_signal(signal.SIGINT)
    assert run.finish() == 128 + signal.SIGINT
    assert run.stdout.count('stopped') == 2
    assert STAYS not in terminal.screen
    for name in ('stationary', '2/square'):
        with RecordingReader(tmp_path / f'{name}.mcap') as reader:
            assert reader.complete


def test_the_page_stays_after_the_run_until_it_is_interrupted(start_run):
    terminal = Terminal()
    run = start_run(
        'stationary', '--viewer', '--set', 'viewer.port=0', '--no-record', '--real-time-factor',
        '0', stderr=terminal.side,
    )  # fmt: skip
    terminal.wait_for_text(STAYS, timeout=60.0)
    assert run.process.poll() is None
    run.process.send_signal(signal.SIGINT)
    assert run.finish() == 0
    assert children(run.process.pid) == {}
    assert 'passed' in run.stdout
