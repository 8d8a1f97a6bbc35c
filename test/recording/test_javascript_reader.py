"""Foxglove's reader decodes recordings, also repaired ones."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from graph import record

from ballbot_ros.recording.reader import RecordingReader
from ballbot_ros.recording.repair import repair

PACKAGES = (
    '@mcap/core@2',
    '@foxglove/rosmsg@5',
    '@foxglove/rosmsg2-serialization@3',
    'fzstd@0.1',
)
SCRIPT = Path(__file__).with_name('read_recording.mjs')


@pytest.fixture(scope='module')
def read(tmp_path_factory):
    """Return a function that reads a file with npm packages; skip if they are not installed."""
    node, npm = shutil.which('node'), shutil.which('npm')
    if not node or not npm:
        pytest.skip('needs Node.js with npm')
    folder = tmp_path_factory.mktemp('npm')
    (folder / 'package.json').write_text('{}')
    command = [npm, 'install', '--no-audit', '--no-fund', '--ignore-scripts', '--fetch-retries=1']
    try:
        result = subprocess.run(
            [*command, *PACKAGES],
            cwd=folder,
            check=False,
            capture_output=True,
            text=True,
            timeout=60,
        )
    except subprocess.TimeoutExpired:
        pytest.skip('npm does not reach its registry')
    if result.returncode:
        pytest.skip(f'npm cannot install {PACKAGES[0]}: {result.stderr.strip()[-200:]}')

    def read(path):
        output = subprocess.run(
            [node, SCRIPT, folder, path], check=False, capture_output=True, text=True
        )
        assert output.returncode == 0, output.stderr
        return json.loads(output.stdout)

    return read


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Return the recording of a short run without nodes."""
    folder = tmp_path_factory.mktemp('run')
    return record(folder, 'stationary', '--set=plant_sim.duration=3.0')[0]


@pytest.mark.parametrize('repaired', [False, True])
def test_every_message_is_decoded(read, run, tmp_path, repaired):
    path = run
    if repaired:
        cut = tmp_path / 'cut.mcap'
        cut.write_bytes(run.read_bytes()[:-60_000])
        path = repair(cut).output
    seen = read(path)
    with RecordingReader(path) as reader:
        expected = {name: tuple(topic) for name, topic in reader.topics().items()}
        for _, last_ns, message in reader.messages(['/motor_duty']):
            last = [last_ns, message.vector.x, message.vector.y]
        assert set(seen['attachments']) == set(reader.attachments())
        assert set(seen['metadata']) == set(reader.metadata())
    assert seen['profile'] == 'ros2'
    assert {n: (t['type'], t['count']) for n, t in seen['topics'].items()} == expected
    assert all('reliability: reliable' in topic['qos'] for topic in seen['topics'].values())
    assert seen['last'] == last
