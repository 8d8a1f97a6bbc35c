"""Each device has one entry in each table, and the tables agree."""

from collections import defaultdict

import parts
import pytest
from parts import make_plant, run_plant

from ballbot_ros import parameters
from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.devices import ALL_DEVICES
from ballbot_ros.parameters import DRIVERS, GAMEPAD, ParameterSet
from ballbot_ros.parameters.timing import FIRST_TICK_NS, SLOW_PERIOD_NS
from ballbot_ros.recording.messages.devices import DEVICE_MESSAGES, INPUT_READERS, encode_steps
from ballbot_ros.recording.messages.run_messages import PlantMessages
from ballbot_ros.recording.messages.topics import (
    CLOCK,
    PLANT_STEPS,
    REPLAYED_TOPICS,
    TOPICS,
    periodic_topics,
)
from ballbot_ros.robot.brick.brick import NUMBERS_OF, DeviceInputs, Inputs

each_device = pytest.mark.parametrize(
    'messages', DEVICE_MESSAGES, ids=lambda each: each.device.parameters.node
)


def test_the_tables_have_the_same_devices_in_one_order():
    assert tuple(each.parameters for each in ALL_DEVICES) == parameters.DEVICES
    assert tuple(each.device for each in DEVICE_MESSAGES) == ALL_DEVICES
    assert (*(each.parameters.node for each in ALL_DEVICES), GAMEPAD) == DRIVERS


def test_each_field_of_the_brick_has_one_topic():
    fields = [each.device.field for each in DEVICE_MESSAGES]
    assert sorted([*fields, 'battery_mv', 'sticks']) == sorted(DeviceInputs._fields)
    assert len(INPUT_READERS) == len(DeviceInputs._fields)


def test_each_field_of_a_device_has_its_numbers():
    assert list(NUMBERS_OF) == [each.field for each in ALL_DEVICES]
    numbers = [name for names in NUMBERS_OF.values() for name in names]
    assert sorted([*numbers, 'battery_mv', 'vertical', 'horizontal']) == sorted(Inputs._fields)


def test_a_replay_compares_every_input_of_the_controller():
    assert set(INPUT_READERS) <= set(REPLAYED_TOPICS)


@each_device
def test_a_driver_publishes_its_samples_and_nothing_else_in_lockstep(messages):
    driver = messages.device.parameters
    assert periodic_topics(driver.node) == (messages.sample,)
    assert messages.sample in TOPICS
    assert messages.sample.period_ns == driver.period_ns


@each_device
def test_a_driver_answers_the_steps_if_its_samples_have_a_dead_time(messages):
    kind = messages.device.parameters
    plant = make_plant(start_pitch_x=0.02)
    plant.keep_steps(200)
    truth = run_plant(plant, [(40, -20)] * 70)[-1]
    assert messages.source(kind(), FIRST_TICK_NS).topic is messages.truth
    for delay, jitter in ((1, 0), (0, 1), (37, 0), (100, 100)):
        parameters = kind(delay=delay, delay_jitter=jitter)
        topic, measured = messages.source(parameters, FIRST_TICK_NS)
        assert topic is PLANT_STEPS
        found = measured(encode_steps(truth), truth.stamp_ns)
        assert found == parts.sampled(messages.device, parameters)(truth)


@pytest.fixture(scope='module')
def sent():
    """The stamps of the plant's messages of 0.2 s, by their topics."""
    stamps = defaultdict(list)
    loop = ClosedLoop(ParameterSet())
    messages = PlantMessages(lambda topic: lambda stamp_ns, data: stamps[topic].append(stamp_ns))
    for tick in loop.ticks(0.2):
        messages.truth(tick.truth, wall_hit=tick.wall_hit)
        messages.send_unrecorded(tick.truth)
    return stamps


@each_device
def test_a_driver_gets_a_truth_at_each_of_its_sampling_times_and_a_slow_one_only_every_20_ms(
    messages, sent
):
    period_ns = min(messages.sample.period_ns, SLOW_PERIOD_NS)
    assert messages.sample.period_ns % period_ns == 0
    assert sent[messages.truth] == [n for n in sent[CLOCK] if n % period_ns == 0]
    assert len(sent[CLOCK]) == 50
