"""The verdict on a run of processes."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from ballbot_ros.cli.separate_processes import judged

SILENT = 'plant_sim does not answer'


def process(name, exit_status=0):
    return SimpleNamespace(name=name, exit_status=exit_status)


@pytest.mark.parametrize(
    ('outcome', 'failure', 'ends', 'signal', 'expected'),
    [
        ('completed', '', {}, 0, ('completed', '', 1)),
        ('completed', SILENT, {'plant_sim': -9}, 0, ('completed', '', 1)),
        ('completed', 'gyro_driver died of SIGKILL', {'gyro_driver': -9}, 0, ('completed', '', 1)),
        ('completed', '', {'recorder': 1}, 0, ('failed', 'recorder failed', 1)),
        ('failed', SILENT, {'plant_sim': -9}, 0, ('failed', SILENT, 1)),
        ('failed', 'sonar_driver ended with status 2', {'sonar_driver': 2}, 0,
         ('failed', 'sonar_driver ended with status 2', 2)),
        ('completed', SILENT, {}, 2, ('stopped', '', 130)),
    ],
)  # fmt: skip
def test_a_completed_run_is_completed(outcome, failure, ends, signal, expected):
    processes = {name: process(name, ends.get(name, 0)) for name in ('plant_sim', *ends)}
    summary = {'outcome': outcome, 'reason': ''}
    verdict = judged(summary, failure, processes, SimpleNamespace(signal=signal), False)
    assert (verdict['outcome'], verdict['reason'], verdict['exit_status']) == expected
