"""Announcements and run statuses decode as they were encoded; malformed ones are a ValueError."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ballbot_ros.lockstep.participants import Announcement, Membership, Objection, Participant
from ballbot_ros.lockstep.run_recording import RunStatus
from ballbot_ros.parameters import NODES
from ballbot_ros.recording.messages.conversions import encode_motors
from ballbot_ros.recording.messages.raw import same_content
from ballbot_ros.recording.messages.run_reports import (
    decode_announcement,
    decode_run_status,
    encode_announcement,
    encode_run_status,
    membership_json,
    membership_text,
)
from ballbot_ros.recording.messages.topics import (
    LOCKSTEP_PUBLISHERS,
    PARTICIPANTS,
    PLANT_JOINT_STATES,
    TOPICS,
)
from ballbot_ros.recording.rosbag2 import OUTCOME_KEYS
from ballbot_ros.recording.schemas import encoder, new_message
from ballbot_ros.robot.plant.ground_truth import GroundTruth

text = st.text(st.characters(exclude_categories=('Cs', 'Cc')))
word = st.text(st.characters(categories=('L', 'N')), min_size=1)
count = st.integers(0, 2**62)
participants = st.builds(
    Participant,
    role=st.sampled_from(NODES),
    node=text,
    host=text,
    process=count,
    instance=text,
    implementation=text,
    parameters_sha256=text,
    guid_prefix=text,
    topics=st.lists(word).map(tuple),
    parameters=st.dictionaries(word, st.booleans() | count | text | st.lists(st.floats(-1, 1))),
)
announcements = st.builds(
    Announcement,
    participant=participants,
    run=text,
    answered_ns=count,
    objection=st.none() | st.builds(Objection, text, text, count),
    awaits=st.dictionaries(word, st.none() | count),
)
statuses = st.builds(
    RunStatus,
    run=text,
    is_lockstep=st.booleans(),
    periodic_topics=st.lists(word).map(tuple),
    participants=st.dictionaries(word, text),
    result=st.just({}) | st.fixed_dictionaries(dict.fromkeys(OUTCOME_KEYS, text)),
)

RUNNING = [('run', '1'), ('lockstep', 'true'), ('periodic topics', '')]
GYRO = Participant('gyro_driver', '/lab/gyro', 'here', 7, 'x', 'ours', '0123456789abcdef')


@given(announcements)
def test_an_announcement_comes_back(announcement):
    assert decode_announcement(encode_announcement(announcement)) == announcement


@given(statuses)
def test_the_status_of_a_run_comes_back(status):
    assert decode_run_status(encode_run_status(status)) == status


def status_message(*pairs, level=0):
    message = new_message(PARTICIPANTS.type_name)
    message.level, message.name = level, '/forger'
    for key, value in pairs:
        pair = new_message('diagnostic_msgs/msg/KeyValue')
        pair.key, pair.value = key, value
        message.values.append(pair)
    return encoder(PARTICIPANTS.type_name)(message)


@pytest.mark.parametrize('pairs', [(), [('role', 'gyro_driver')], [('process', 'many')]])
def test_a_malformed_announcement_is_a_value_error(pairs):
    with pytest.raises(ValueError, match=r'/forger|many'):
        decode_announcement(status_message(*pairs))


@pytest.mark.parametrize('awaits', ['gyro', '[1]', '{"gyro": "1"}', '{"gyro": true}', '[' * 9999])
def test_awaited_samples_are_stamps_by_topic(awaits):
    pairs = [(key, '1') for key in ('role', 'process', 'instance', 'run', 'implementation')]
    pairs += [('parameters sha256', ''), ('topics', ''), ('answered [ns]', '0')]
    assert decode_announcement(status_message(*pairs)).awaits == {}
    with pytest.raises(ValueError):  # noqa: PT011  a JSON error is one, too
        decode_announcement(status_message(*pairs, ('awaits', awaits)))


@pytest.mark.parametrize('pairs', [(), [('run', '1')], [*RUNNING, ('outcome', 'completed')]])
def test_a_malformed_run_status_is_a_value_error(pairs):
    with pytest.raises(ValueError, match='has no'):
        decode_run_status(status_message(*pairs))


def test_an_announcement_needs_no_prefix():
    announcement = Announcement(dataclasses.replace(GYRO, guid_prefix=''), '1 abc')
    assert decode_announcement(encode_announcement(announcement)) == announcement


def test_the_verdict_describes_a_participant():
    start_ns = 1_000_000_000
    first, later = Membership(GYRO, 0), Membership(GYRO, 1_500_000_000, is_successor=True)
    assert membership_json(first, start_ns) == {
        'role': 'gyro_driver',
        'node': '/lab/gyro',
        'namespace': '/lab',
        'host': 'here',
        'process': 7,
        'implementation': 'ours',
        'parameters_sha256': '0123456789abcdef',
        'since_s': 0.0,
        'successor': False,
    }
    assert membership_json(later, start_ns)['since_s'] == 0.5
    root = Membership(dataclasses.replace(GYRO, node='/gyro'), 0)
    assert membership_json(root, start_ns)['namespace'] == '/'
    assert membership_text(first, start_ns) == (
        '/lab/gyro (process 7 on here), ours, parameters 0123456789ab'
    )
    assert 'since 0.500 s' in membership_text(later, start_ns)
    bare = Membership(dataclasses.replace(GYRO, parameters_sha256=''), 0)
    assert membership_text(bare, start_ns) == '/lab/gyro (process 7 on here), ours'


def test_alignment_padding_is_ignored():
    data = bytearray(encode_motors(GroundTruth(5, *[(1.0, 2.0)] * 7, battery_voltage=8.0)))
    is_same = same_content(PLANT_JOINT_STATES.type_name)
    # The frame, an empty string, ends one byte after its length; the next number is aligned.
    gap = 4 + 8 + 4 + 1
    assert data[gap : gap + 3] == b'\0\0\0'
    other = bytearray(data)
    other[gap] = 7
    assert is_same(bytes(data), bytes(other))
    other[-1] ^= 1
    assert not is_same(bytes(data), bytes(other))


def test_the_lockstep_topics_are_those_of_periodic_samples_and_the_run():
    names = {topic.name for topic in LOCKSTEP_PUBLISHERS}
    assert {topic.name for topic in TOPICS if topic.period_ns} <= names
    assert {'plant/run', 'plant/roll_call', 'recorder/ack', 'participants'} <= names
    assert not {'joy', 'cmd_vel', 'plant/push', '/diagnostics'} & names
    assert set(NODES) == set(LOCKSTEP_PUBLISHERS[PARTICIPANTS])
