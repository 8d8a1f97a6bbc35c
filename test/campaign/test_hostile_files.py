"""Hostile recordings, read with every command: special ones, and a sample of the drawn ones."""

import struct
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.records import Attachment, Metadata

from ballbot_ros.recording.reader import RecordingReader
from campaign.hostile_files import Content, hostile_file
from campaign.hostile_reading import FILE, read_file, read_files, record_base

RULE = '\n' + '=' * 80 + '\nMSG: '
DOUBLING = RULE.join(f'a/T{n}\na/T{n + 1} x\na/T{n + 1} y' for n in range(40))
CONTROL = '\0\x1b[31m\n'


@pytest.fixture(scope='module')
def base(tmp_path_factory):
    return record_base(tmp_path_factory.mktemp('base'))


def redefine(text):
    def change(content):
        content.schemas = [replace(each, data=text.encode()) for each in content.schemas]

    return change


def rename(content):
    content.header = replace(content.header, library=CONTROL)
    content.channels = [replace(each, topic=each.topic + CONTROL) for each in content.channels]
    content.attachments.append(Attachment(0, 0, f'../{CONTROL}', CONTROL, b''))
    content.metadata.append(Metadata('ballbot_incomplete', {'reason': CONTROL}))


def set_apart(content):
    """Let the last message of each topic come ten years later."""
    for number in {each.channel_id for each in content.messages}:
        own = [each for each in content.messages if each.channel_id == number]
        stamp = struct.pack('<II', 315_360_000, 0)
        later = replace(own[-1], data=own[-1].data[:4] + stamp + own[-1].data[12:])
        content.messages.append(later)


def leave_time(content):
    stamp = struct.pack('<II', 2**31 - 1, 2**32 - 1)
    content.messages = [
        replace(each, data=each.data[:4] + stamp + each.data[12:]) for each in content.messages
    ]


def start_between_ticks(content):
    """Let each stamp be a nanosecond late, so that no device has a sample at the first tick."""
    stamped = [struct.unpack_from('<II', each.data.ljust(12), 4) for each in content.messages]
    content.messages = [
        replace(each, data=each.data[:4] + struct.pack('<II', sec, ns + 1) + each.data[12:])
        if len(each.data) >= 12 and sec < 100 and ns % 1_000_000 == 0
        else each
        for each, (sec, ns) in zip(content.messages, stamped, strict=True)
    ]


def attach(name, text):
    def change(content):
        content.attachments.append(Attachment(0, 0, name, '', text.encode()))

    return change


CASES = {
    'a type that contains itself': redefine('Vector3Stamped x\nstd_msgs/Header header'),
    'other fields': redefine('float64 other'),
    'a list of itself': redefine(f'a/B x{RULE}a/B\na/B[] y'),
    '2**40 fields': redefine(f'a/T0 x{RULE}{DOUBLING}{RULE}a/T40\nfloat64 x'),
    'nested 1500 times': redefine(
        f'a/T0 x{RULE}' + RULE.join(f'a/T{n}\na/T{n + 1} x' for n in range(1500))
    ),
    'control characters': rename,
    'ten years': set_apart,
    'beyond the end of time': leave_time,
    'between the ticks': start_between_ticks,
    'deep YAML': attach('versions.yaml', '[' * 100_000),
    'a date as a key': attach('versions.yaml', '2026-01-01: 2026-01-01'),
    'no mappings': attach('parameters.yaml', 'controller: {ros__parameters: seed}'),
    'a map without a name': attach(
        'parameters.yaml', 'plant_sim: {ros__parameters: {map: "x/.\\0"}}'
    ),
}


@pytest.mark.parametrize('case', CASES)
def test_a_hostile_file_ends_no_command_with_a_traceback(base, tmp_path, monkeypatch, case):
    monkeypatch.chdir(tmp_path)
    content = base.copy()
    CASES[case](content)
    Path(FILE).write_bytes(content.encode())
    assert list(read_file(1)) == []


def test_a_sample_of_drawn_files(base, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert list(read_files(base, seed=0, first=1, count=9)) == []


def test_the_files_have_valid_checksums_and_depend_only_on_the_seed(base, tmp_path):
    path = tmp_path / 'run.mcap'
    path.write_bytes(base.encode())
    with RecordingReader(path) as reader:
        assert reader.complete
        assert len(list(reader.raw_messages())) == len(base.messages)
    assert Content.of_file(path).messages == base.messages
    first, again, other = (hostile_file(base, seed) for seed in ('1 2', '1 2', '1 3'))
    assert first == again
    assert first != other
