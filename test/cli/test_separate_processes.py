"""How a run of processes is watched, and the verdict on it."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from ballbot_ros.cli.separate_processes import judged, watch
from ballbot_ros.parameters import NODES, PLANT, VIEWER
from ballbot_ros.simulation.timing import FIRST_TICK_NS, TICK_NS

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


def watched(victim, now_ns):
    """What the watch says of a graph in which one node has died, after a few looks."""
    running = SimpleNamespace(running=True, died=False, exit_status=None, pid=1)
    dead = SimpleNamespace(
        running=False, died=True, exit_status=-9, how_it_ended='died of SIGKILL', pid=2
    )
    processes = dict.fromkeys((*NODES, VIEWER), running) | {victim: dead}
    monitor = SimpleNamespace(now_ns=now_ns, poll=lambda: None, plant_hangs=lambda pid: False)
    notices = []
    progress = SimpleNamespace(notice=notices.append, update=lambda now_s: None)
    looks = iter([False, False, True])
    reason = watch(processes, monitor, progress, lambda: next(looks))
    assert notices == [f'{victim} died of SIGKILL']
    return reason


@pytest.mark.parametrize('now_ns', [0, FIRST_TICK_NS])
@pytest.mark.parametrize('victim', [name for name in NODES if name != PLANT])
def test_a_node_that_dies_before_the_first_tick_ends_the_run_at_once(victim, now_ns):
    assert watched(victim, now_ns) == f'{victim} died of SIGKILL before the first tick'


@pytest.mark.parametrize('victim', [name for name in NODES if name != PLANT])
def test_a_node_that_dies_in_mid_run_may_be_restarted(victim):
    assert watched(victim, FIRST_TICK_NS + TICK_NS) == ''


def test_a_viewer_is_no_part_of_the_run():
    assert watched(VIEWER, 0) == ''


@pytest.mark.parametrize('now_ns', [0, FIRST_TICK_NS + TICK_NS])
def test_without_the_plant_there_is_no_run(now_ns):
    assert watched(PLANT, now_ns) == 'plant_sim died of SIGKILL'
