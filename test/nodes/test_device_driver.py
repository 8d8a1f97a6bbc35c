"""The driver of a device, without the graph."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message

from ballbot_ros.messages.conversions import fill_time
from ballbot_ros.messages.topics import PLANT_ODOM, PLANT_STEPS
from ballbot_ros.nodes.device_driver import DeviceDriver, messages_of
from ballbot_ros.parameters import SONAR, SonarParameters
from ballbot_ros.timing import FIRST_TICK_NS, TICK_NS


def test_only_the_sampling_times_of_its_run_are_answered():
    published, counted, ignored = [], [], []
    driver = SimpleNamespace(
        _source=messages_of(SonarParameters).source(SonarParameters()),
        _period_ns=5 * TICK_NS,
        _participation=SimpleNamespace(includes=lambda now_ns: now_ns >= FIRST_TICK_NS),
        _read=lambda measured, now_ns: 7,
        _encode=lambda now_ns, reading: (now_ns, reading),
        _output=SimpleNamespace(publish=published.append),
        count_sample=counted.append,
        warn_malformed=lambda topic, error: ignored.append(topic),
    )
    truth = PLANT_ODOM.message_class()
    for stamp_ns in (FIRST_TICK_NS - 5 * TICK_NS, FIRST_TICK_NS, FIRST_TICK_NS + TICK_NS):
        fill_time(truth.header.stamp, stamp_ns)
        DeviceDriver._on_truth(driver, PLANT_ODOM, serialize_message(truth))
    DeviceDriver._on_truth(driver, PLANT_ODOM, b'')
    DeviceDriver._on_truth(driver, PLANT_STEPS, serialize_message(truth))
    assert published == [(FIRST_TICK_NS, 7)]
    assert counted == [FIRST_TICK_NS]
    assert ignored == [PLANT_ODOM]


def test_a_driver_is_a_program_of_its_own_name():
    assert DeviceDriver.program.fget(SimpleNamespace(role=SONAR)) == 'SonarDriver'
