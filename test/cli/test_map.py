"""`ballbot map` as a user types it."""

import resource
import subprocess

import pytest
from graph import BALLBOT, call
from maps import drawn, save


def ballbot_map(*arguments, **options):
    if not options:
        return call('map', *arguments)
    return subprocess.run(
        [*BALLBOT, 'map', *map(str, arguments)],
        capture_output=True, text=True, check=False, **options,
    )  # fmt: skip


def assert_one_line(done, *hints):
    assert done.returncode == 2
    assert done.stdout == ''
    assert len(done.stderr.splitlines()) == 1, done.stderr
    for hint in hints:
        assert str(hint) in done.stderr


def test_a_map_is_described(tmp_path):
    path = save(drawn('.....', '.##-.', '.....'), tmp_path / 'map.bmp')
    done = ballbot_map(path)
    assert done.returncode == 0
    assert done.stderr == ''
    for words in (path, '5 × 3 cm', ' 15 ', '0.0013 m²', 'wall cells', ' 2 ', 'black line cells'):
        assert str(words) in done.stdout
    assert list(tmp_path.iterdir()) == [path]


def test_a_shipped_map_is_written(tmp_path):
    done = ballbot_map('track', '--wrl', tmp_path / 'a.wrl', '--yaml', tmp_path / 'b.yaml')
    assert done.returncode == 0
    assert {path.name for path in tmp_path.iterdir()} == {'a.wrl', 'b.yaml', 'b.pgm'}
    for path in tmp_path.iterdir():
        assert f'wrote  {path}\n' in done.stdout


def test_the_robot_stands_on_the_map_when_asked_for(tmp_path):
    done = ballbot_map('corridor', '--wrl', tmp_path / 'a.wrl', '--robot')
    assert (done.returncode, done.stderr) == (0, '')
    text = (tmp_path / 'a.wrl').read_text()
    assert text.count('Viewpoint {') == 5
    assert 'DEF base_footprint Transform' in text


def test_the_robot_needs_a_file(tmp_path):
    for arguments in ((), ('--yaml', tmp_path / 'a.yaml'), ('--check',)):
        assert_one_line(ballbot_map('track', '--robot', *arguments), '--robot needs --wrl FILE')
    assert list(tmp_path.iterdir()) == []


def test_check_prints_one_line_and_writes_nothing():
    done = ballbot_map('track', '--check')
    assert (done.returncode, done.stdout, done.stderr) == (0, 'track: OK, 200 × 200 cm\n', '')


def test_a_file_that_is_not_a_map_is_one_line(tmp_path):
    """The reasons are in test/robot/world/test_image.py."""
    text = tmp_path / 'map.png'
    text.write_text('hello')
    for floor_map, hint in ((text, 'not a PNG or BMP'), ('nosuch', 'shipped: corridor, track')):
        assert_one_line(ballbot_map(floor_map, '--check'), floor_map, hint)


def test_check_and_writing_exclude_each_other(tmp_path):
    assert_one_line(ballbot_map('track', '--check', '--wrl', tmp_path / 'a.wrl'), '--check')
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_is_left_alone(tmp_path):
    (tmp_path / 'a.wrl').write_text('mine')
    assert_one_line(ballbot_map('track', '--wrl', tmp_path / 'a.wrl'), 'a.wrl: already exists')
    assert (tmp_path / 'a.wrl').read_text() == 'mine'


def test_a_file_that_can_not_be_written_is_one_line(tmp_path):
    assert_one_line(ballbot_map('track', '--wrl', tmp_path / 'no/a.wrl'), 'No such file')


@pytest.mark.parametrize('option', ['--wrl', '--yaml'])
def test_a_folder_can_not_be_the_file_to_write(tmp_path, option):
    done = ballbot_map('track', option, f'{tmp_path}/x/')
    assert_one_line(done, option, f'{tmp_path}/x/: is a folder; name a file')
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path):
    def fill_disk():
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))

    done = ballbot_map('track', '--wrl', tmp_path / 'a.wrl', preexec_fn=fill_disk)
    assert_one_line(done, 'a.wrl', 'File too large')
    assert list(tmp_path.iterdir()) == []
