"""The plant's report in the diagnostics."""

import pytest

pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message

from ballbot_ros.parameters import CONTROLLER, PLANT
from ballbot_ros.recording.messages.run_reports import PlantReport, decode_plant_report


def encoded(values, *, level=DiagnosticStatus.OK, message='OK', role=PLANT):
    pairs = [KeyValue(key=key, value=value) for key, value in {'role': role, **values}.items()]
    status = DiagnosticStatus(level=level, name=PLANT, message=message, values=pairs)
    return bytes(serialize_message(DiagnosticArray(status=[status])))


@pytest.mark.parametrize(
    ('values', 'expected'),
    [
        ({}, {}),
        ({'run name': '2 abc'}, {'run': '2 abc'}),
        ({'paused': 'True', 'awaits start': 'False'}, {'is_paused': True}),
        ({'paused': 'True', 'awaits start': 'True'}, {'is_paused': True, 'awaits_start': True}),
        ({'pace': '0.5'}, {'pace': 0.5}),
        ({'pace': 'fast'}, {'pace': 1.0}),
        ({'missing': 'controller recorder'}, {'missing': ('controller', 'recorder')}),
        ({'missing': ''}, {}),
        ({'outcome': 'completed'}, {'outcome': 'completed'}),
    ],
)
def test_a_report_is_read_from_its_entries(values, expected):
    assert decode_plant_report(encoded(values)) == PlantReport(**expected)


def test_a_problem_is_a_warning_or_an_error():
    for level, problem in (
        (DiagnosticStatus.OK, ''),
        (DiagnosticStatus.WARN, 'slow'),
        (DiagnosticStatus.ERROR, 'slow'),
    ):
        assert decode_plant_report(encoded({}, level=level, message='slow')).problem == problem


def test_what_is_not_the_report_of_a_plant_is_skipped():
    assert decode_plant_report(encoded({}, role=CONTROLLER)) is None
    assert decode_plant_report(b'') is None
    assert decode_plant_report(encoded({})[:60]) is None
