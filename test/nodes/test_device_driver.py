"""The driver of a device, without the graph."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message
from stubs import bare

from ballbot_ros.lockstep.lockstep import GivenAnswers
from ballbot_ros.nodes.device_driver import DeviceDriver, messages_of
from ballbot_ros.parameters import SONAR, SonarParameters
from ballbot_ros.parameters.timing import FIRST_TICK_NS, TICK_NS
from ballbot_ros.recording.messages.conversions import fill_time
from ballbot_ros.recording.messages.topics import PLANT_SLOW_ODOM, PLANT_STEPS, SONAR_RANGE


def test_only_the_sampling_times_of_its_run_are_answered():
    published, counted, ignored = [], [], []
    driver = bare(
        DeviceDriver,
        _source=messages_of(SonarParameters).source(SonarParameters(), FIRST_TICK_NS),
        _answers=GivenAnswers(),
        _period_ns=5 * TICK_NS,
        _participation=SimpleNamespace(includes=lambda now_ns: now_ns >= FIRST_TICK_NS),
        _read=lambda measured, now_ns: 7,
        _encode=lambda now_ns, reading: (now_ns, reading),
        _output=SimpleNamespace(publish=published.append),
        now_ns=0,
        count_sample=lambda now_ns: counted.append(now_ns) or vars(driver).update(now_ns=now_ns),
        warn_malformed=lambda topic, error: ignored.append(topic),
    )
    truth = PLANT_SLOW_ODOM.message_class()
    first, second = FIRST_TICK_NS, FIRST_TICK_NS + 5 * TICK_NS
    for stamp_ns in (first - 5 * TICK_NS, first, first + TICK_NS, second, first):
        fill_time(truth.header.stamp, stamp_ns)
        DeviceDriver._on_truth(driver, PLANT_SLOW_ODOM, serialize_message(truth))
    DeviceDriver._on_truth(driver, PLANT_SLOW_ODOM, b'')
    DeviceDriver._on_truth(driver, PLANT_STEPS, serialize_message(truth))
    assert published == [(first, 7), (second, 7), (first, 7)]
    assert counted == [first, second, second], 'it announces the newest as answered'
    assert ignored == [PLANT_SLOW_ODOM]


def test_a_driver_is_a_program_of_its_own_name():
    assert DeviceDriver.program.fget(SimpleNamespace(role=SONAR)) == 'SonarDriver'


def test_it_waits_until_its_last_sample_has_reached_the_recorder():
    """The recorder may be the last to get what the others have answered."""
    flushed = []
    driver = bare(DeviceDriver, _messages=messages_of(SonarParameters), flush=flushed.append)
    driver.close()
    assert flushed == [SONAR_RANGE]
