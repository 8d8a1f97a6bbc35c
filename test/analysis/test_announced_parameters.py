"""The parameters of a run, as its participants announce them; invalid values."""

import dataclasses
import hashlib

import pytest

from ballbot_ros.analysis.recorded_runs import AnnouncedParameters
from ballbot_ros.lockstep.participants import MAP_HASH, Announcement, Membership, Participant
from ballbot_ros.lockstep.run_recording import RunStatus
from ballbot_ros.parameters import CONTROLLER, GYRO, PLANT, SONAR, ParameterSet
from ballbot_ros.recording.messages.run_reports import (
    encode_announcement,
    encode_run_status,
    membership_text,
)
from ballbot_ros.recording.messages.topics import PARTICIPANTS, RUN_STATUS
from ballbot_ros.recording.reader import AttachedFile

RUN = '1 abc'
FILES = {'map.png': AttachedFile('image/png', b'a map')}


def a(role, sha, **values):
    return Participant(role, f'/{role}', 'here', 1, sha, 'ours', sha * 12, parameters=values)


def told(*participants, members=None, run=RUN):
    told = AnnouncedParameters()
    for each in participants:
        told.add(PARTICIPANTS, encode_announcement(Announcement(each, run)))
    joined = {
        each.role: membership_text(Membership(each, 0), 0) for each in members or participants
    }
    told.add(RUN_STATUS, encode_run_status(RunStatus(run, True, (), joined)))
    return told


SIMULATED = [
    a(PLANT, 'c', ball_radius=0.03),
    a(GYRO, 'd', seed=4),
    a(SONAR, 'e', seed=4),
    a('encoder_driver', 'a', delay=0),
    a(CONTROLLER, 'f', k_i=-0.5),
]


def values(told, role, attached=None, run=RUN):
    return told.of(run, attached or ParameterSet(), FILES).of_node(role)


def test_announced_parameters_override_attached_ones():
    attached = ParameterSet()
    attached.set(CONTROLLER, 'k_i', -0.1)
    attached.set(CONTROLLER, 'a_d', 0.7)
    found = values(told(*SIMULATED), CONTROLLER, attached)
    assert (found.k_i, found.a_d, found.ball_radius) == (-0.5, 0.7, 0.03)
    assert values(told(*SIMULATED), CONTROLLER, attached, run='2 abc').k_i == -0.1


@pytest.mark.parametrize('without', range(5))
def test_a_run_is_announced_only_if_all_nodes_needed_for_a_replay_are(without):
    assert told(*SIMULATED).has_parameters(RUN)
    assert not told(*SIMULATED).has_parameters('2 abc')
    some = [each for number, each in enumerate(SIMULATED) if number != without]
    assert not told(*some).has_parameters(RUN)


@pytest.mark.parametrize('order', [1, -1])
def test_the_parameters_are_those_of_the_participants(order):
    member, stranger = a(GYRO, 'a', noise=0.5), a(GYRO, 'b', noise=9.0)
    both = [member, stranger][::order]
    assert values(told(*both, members=[member]), GYRO).noise == 0.5


@pytest.mark.parametrize('value', [None, 5, [1], {'a': 1}, True])
def test_invalid_values_are_ignored(value):
    assert values(told(a(PLANT, 'a', map=value, gravity='much', wings=2)), PLANT).map == ''


def test_an_attached_map_file_is_used_if_its_hash_matches():
    sha = hashlib.sha256(b'a map').hexdigest()
    same = told(a(PLANT, 'a', map='hall.png', **{MAP_HASH: sha}))
    assert values(same, PLANT).map == 'map.png'
    other = told(a(PLANT, 'a', map='hall.png', **{MAP_HASH: sha[::-1]}))
    assert values(other, PLANT).map == 'hall.png'


def test_a_different_scenario_is_detected():
    runs = AnnouncedParameters()
    for run, scenario in (('1 x', 'push'), ('2 x', 'push'), ('3 x', 'square')):
        plant = a(PLANT, 'a', scenario=scenario, gravity=9.0)
        runs.add(PARTICIPANTS, encode_announcement(Announcement(plant, run)))
        joined = {PLANT: membership_text(Membership(plant, 0), 0)}
        runs.add(RUN_STATUS, encode_run_status(RunStatus(run, True, (), joined)))
    assert [runs.is_of_another_scenario(f'{n} x') for n in (1, 2, 3)] == [False, False, True]


def test_malformed_announcements_are_ignored():
    runs = AnnouncedParameters()
    runs.add(PARTICIPANTS, b'')
    runs.add(RUN_STATUS, b'\x00' * 20)
    assert not runs.has_parameters('')


def test_the_controller_of_a_run_is_known_even_without_its_parameters():
    stranger, other = a(CONTROLLER, 'f'), a(CONTROLLER, 'b', k_i=-0.1)
    found = told(other, *SIMULATED[:-1], stranger, members=[*SIMULATED[:-1], stranger])
    assert found.participant(RUN, CONTROLLER) == stranger
    assert found.participant('2 abc', CONTROLLER) is None
    assert found.foreign(RUN)[CONTROLLER] == stranger
    assert found.foreign('2 abc') == {}
    assert not found.has_parameters(RUN)


def test_the_last_faults_of_each_participant_count():
    early, late = (a(GYRO, 'd', faults=text) for text in ('', 'gyro_x off time=3'))
    successor = a(GYRO, 'd', faults='gyro_y off')
    successor = dataclasses.replace(successor, instance='another')
    assert values(told(*SIMULATED, early, late, successor), GYRO).faults == 'gyro_x off time=3'


@pytest.mark.parametrize(
    ('plant', 'controller', 'both'),
    [
        ('', '', ''),
        ('task_ts1 slow; motor_x off', 'task_ts1 slow; motor_x off', 'task_ts1 slow; motor_x off'),
        ('task_ts1 slow; motor_x off time=3', 'task_ts1 slow duration=2',
         'motor_x off time=3; task_ts1 slow duration=2'),
        ('motor_x off', 'no fault', 'no fault'),
    ],
)  # fmt: skip
def test_plant_and_controller_tell_the_faults_that_they_carry_out(plant, controller, both):
    found = told(
        *SIMULATED[1:4], a(PLANT, 'c', faults=plant), a(CONTROLLER, 'f', faults=controller)
    )
    for role in (PLANT, CONTROLLER):
        assert values(found, role).faults == both
