"""The actions of a trial depend on seed and number only."""

import random

import pytest

from ballbot_ros.parameters import NODES
from campaign.damaged_files import DAMAGES, FuzzedInput
from campaign.faults import FAULTS
from campaign.restarts import DRIVERS
from campaign.strangers import LOOP_TOPICS, OPEN_TOPICS

NAMES = [fault.name for fault in FAULTS]
OF_NODES = [fault for fault in FAULTS if ' of a node ' in fault.name or ' to a node ' in fault.name]


def test_each_fault_has_a_unique_name():
    assert len(set(NAMES)) == len(NAMES)


def test_the_same_seed_and_number_draw_the_same_attempt():
    for fault in FAULTS:
        first, second = ([fault.attempt(3, number) for number in range(5)] for _ in range(2))
        assert first == second, fault.name


def test_another_seed_and_another_number_draw_another_attempt():
    for fault in FAULTS[:-1]:
        assert len({str(fault.attempt(seed, 0)) for seed in range(5)}) > 2, fault.name
        assert len({str(fault.attempt(0, number)) for number in range(5)}) > 2, fault.name


@pytest.mark.parametrize('fault', OF_NODES, ids=lambda fault: fault.name)
def test_in_seven_consecutive_trials_each_node_is_the_victim_once(fault):
    victims = [fault.attempt(9, number).victim for number in range(10, 17)]
    assert sorted(victims) == sorted(NODES)


def test_every_topic_and_driver_is_tried():
    attempts = {fault.name: fault.attempt for fault in FAULTS}
    for name, topics in (
        ('nonsense on open topics', OPEN_TOPICS),
        ('a stranger in the loop', LOOP_TOPICS),
    ):
        first = {attempts[name](1, number).sends[0].topic for number in range(len(topics))}
        assert first == set(topics)
    restarts = attempts['drivers killed and started again']
    first = {restarts(1, number).restarts[0].driver for number in range(len(DRIVERS))}
    assert first == set(DRIVERS)


@pytest.mark.parametrize('damage', DAMAGES, ids=lambda damage: damage.__name__)
def test_data_of_any_length_can_be_damaged(damage):
    whole = random.Random(1).randbytes(300)
    for length in (2, 300):
        done = {damage(random.Random(seed), whole[:length]) for seed in range(20)}
        assert done - {whole[:length]}


def test_fuzzed_arguments_can_be_passed_to_a_process():
    for number in range(200):
        attempt = FuzzedInput.draw(random.Random(number), number)
        assert not any('\0' in word for word in attempt.assignments)
        assert attempt.scenario
