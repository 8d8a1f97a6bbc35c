"""Films: the times of their frames, what each frame shows, their files, and the messages."""

import os
from itertools import pairwise

import numpy as np
import PIL.Image
import pytest
from browsing import shared_page

from ballbot_ros.cli.render import parse_view
from ballbot_ros.errors import ViewerError
from ballbot_ros.files import replacing
from ballbot_ros.viewer import render
from ballbot_ros.viewer.playback_run import PlaybackRun
from ballbot_ros.viewer.render import FORMATS, Rendering, frame_times, with_time_stamp, write_film
from ballbot_ros.viewer.views import FreeView

SIZE = (320, 176)


@pytest.fixture(scope='module')
def run(recording):
    return PlaybackRun(recording)


@pytest.fixture
def frames(needs_browser, monkeypatch):
    """Render in the browser that tests share; test_pictures renders in that of the product."""
    monkeypatch.setattr('ballbot_ros.viewer.offscreen.browser_page', shared_page)
    return render.frames


def moved(a, b):
    """Return the number of pixels that clearly differ."""
    return int((np.abs(a.astype(int) - b).max(axis=-1) > 8).sum())


@pytest.mark.slow
def test_each_frame_of_a_film_shows_its_own_time(run, frames):
    """The front of the robot includes its display, whose pictures load in the background."""
    times = [6.0, 6.2, 6.4, 9.0, 9.04, 2.0]
    assert len({run.snapshot(time).lcd for time in times}) > 2
    shots = [('chaser2', time) for time in times]
    film = list(frames(run, shots, size=SIZE))
    for before, after in pairwise(film):
        assert moved(before, after) > 50
    # In the reverse order every frame has another one before it, and the last one none.
    reverse = list(frames(run, shots[::-1], size=SIZE))
    for shot, frame, other in zip(shots, film, reverse[::-1], strict=True):
        assert moved(other, frame) == 0, shot


@pytest.mark.slow
def test_a_page_that_connects_before_it_has_drawn_has_its_shadows(run, frames, monkeypatch):
    def client_without_a_frame(browser, server):
        while not server.get_clients():
            browser.wait_for_timeout(10)
        return server.get_clients()[0]

    monkeypatch.setattr('ballbot_ros.viewer.offscreen._client', client_without_a_frame)
    first, second = frames(run, [('chaser2', 6.0)] * 2, size=SIZE)
    assert moved(first, second) == 0


@pytest.mark.slow
def test_a_ghost_and_a_camera_of_ones_own_are_seen(run, frames, tmp_path, command):
    above = FreeView((0.0, 0.0, 4.0), (0.0, 0.0, 0.0))
    alone, top = frames(run, [(above, 9.0), ('top', 9.0)], size=SIZE)
    assert moved(alone, top) > 1000
    words = ['--processes=none', '--set=plant_sim.duration=2', '--output', tmp_path / 'other']
    command('run', 'stationary', *words)
    other = PlaybackRun(tmp_path / 'other/stationary.mcap')
    (both,) = frames(run, [(above, 9.0)], ghost=other, size=SIZE)
    assert 20 < moved(alone, both) < 2000


@pytest.mark.parametrize(
    ('start', 'end', 'fps', 'rate', 'last', 'number'),
    [
        (0.0, 10.0, 10, 1.0, 9.9, 100),
        (2.0, 5.0, 20, 1.0, 4.95, 60),
        (1.0, 2.0, 20, 0.25, 1.9875, 80),
        (0.0, 9.0, 3, 3.0, 8.0, 9),
        (1.0, 1.001, 20, 1.0, 1.0, 1),
    ],
)
def test_the_times_of_a_film_are_evenly_spaced(start, end, fps, rate, last, number):
    times = frame_times(start, end, fps, rate)
    assert (times[0], len(times)) == (start, number)
    assert times[-1] == pytest.approx(last)
    assert np.allclose(np.diff(times), rate / fps)


def test_the_time_stamp_changes_only_its_corner():
    blank = np.full((200, 400, 3), 255, np.uint8)
    stamped = [with_time_stamp(blank, time) for time in (1.0, 2.5)]
    assert moved(*stamped) > 5
    for image in stamped:
        assert (image[: len(image) * 3 // 4] == 255).all()
        assert (image[:, 200:] == 255).all()
    assert (blank == 255).all()


@pytest.mark.parametrize('suffix', FORMATS)
def test_a_film_has_its_frames_size_and_duration(suffix, tmp_path):
    noise = np.random.default_rng(1).integers(0, 255, (6, 30, 42, 3), np.uint8)
    path = tmp_path / f'film{suffix}'
    write_film(path, iter(noise), 5)
    if suffix == '.mp4':
        import imageio_ffmpeg

        about = next(imageio_ffmpeg.read_frames(path))
        assert (about['size'], about['fps'], about['duration']) == ((42, 30), 5, 1.2)
        return
    with PIL.Image.open(path) as film:
        durations = []
        for frame in range(film.n_frames):
            film.seek(frame)
            film.load()
            durations.append(film.info['duration'])
        assert (film.size, durations, film.info['loop']) == ((42, 30), 6 * [200], 0)


def test_an_interrupted_film_leaves_the_existing_file(run, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        yield np.zeros((32, 32, 3), np.uint8)
        raise KeyboardInterrupt

    monkeypatch.setattr(render, 'frames', interrupted)
    output = tmp_path / 'run.gif'
    output.write_text('another')
    with pytest.raises(KeyboardInterrupt):
        Rendering(run).write_film(output, frame_times(0.0, 1.0, 10), 10)
    assert output.read_text() == 'another'
    assert list(tmp_path.iterdir()) == [output]


@pytest.mark.skipif(os.geteuid() == 0, reason='root may write anywhere')
def test_a_folder_without_permission_is_named(tmp_path):
    tmp_path.chmod(0o500)
    with (
        pytest.raises(ViewerError, match=r'x.gif: Permission denied$'),
        replacing(tmp_path / 'x.gif', ViewerError),
    ):
        pass


def test_a_missing_folder_is_named(tmp_path):
    expected = r'nowhere/run.gif: No such file or directory$'
    with (
        pytest.raises(ViewerError, match=expected),
        replacing(tmp_path / 'nowhere/run.gif', ViewerError),
    ):
        pass


def test_a_failed_encoder_is_one_line(tmp_path):
    with pytest.raises(ViewerError) as error, replacing(tmp_path / 'x.mp4', ViewerError) as path:
        write_film(path / 'not_a_folder.mp4', iter(np.zeros((2, 32, 32, 3), np.uint8)), 10)
    assert '\n' not in str(error.value)


def test_a_camera_is_two_points():
    assert parse_view(None, None, '1,-2,.5:0,0,1e-1') == FreeView((1.0, -2.0, 0.5), (0.0, 0.0, 0.1))
    assert parse_view(None, None, 'vista') == 'vista'


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        ('x.avi', 'x.avi: must end in one of .png, .mp4, .webp, .gif'),
        ('folder.png', 'is a folder; name a file'),
        ('x.gif --time 1', '--time requires a .png; for x.gif use --start and --end'),
        ('x.png --start 1', '--start requires a film; x.png is a picture'),
        ('x.png --fps 10', '--fps requires a film; x.png is a picture'),
        ('x.mp4 --fps 1000', '1000 is not in the range 1<=x<=60'),
        ('x.gif --fps 60', '--fps 60: a .gif has at most 50'),
        ('x.mp4 --size 321x200', '--size 321x200: width and height of a .mp4 must be even'),
        ('x.gif --size 0x0', '0x0: each side must have 64 to 4096 pixels'),
        ('x.gif --size big', "'big' is not a width and a height, such as 960x528"),
        ('x.gif --rate 0', '0.0 is not in the range'),
        ('x.gif --view above', "'above' is neither one of top, vista, chaser1"),
        ('x.gif --view nan,0,0:1,1,1', "'nan,0,0:1,1,1' is neither"),
        ('x.gif --view 1,1,1:1,1,1', 'the camera must not be where it looks'),
        ('x.png --time 10.5', '--time 10.5: the run ends at 9.996 s'),
        ('x.gif --end 11', '--end 11: the run ends at 9.996 s'),
        ('x.gif --start 5 --end 5', '--start 5: must be before the end of the film at 5 s'),
        ('x.gif --start 10', '--start 10: must be before the end of the film at 9.996 s'),
        ('x.gif --start -1', '-1.0 is not in the range x>=0'),
    ],
)
def test_a_mistake_is_one_line(words, told, recording, tmp_path, monkeypatch, command):
    monkeypatch.setattr('ballbot_ros.cli.render.browser_program', str)
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'folder.png').mkdir()
    status, _, error = command('render', str(recording), '--output', *words.split())
    assert status == 2
    assert told in error
    assert error.count('\n') == 1


def test_a_missing_or_damaged_ghost_is_named(recording, tmp_path, monkeypatch, command):
    monkeypatch.setattr('ballbot_ros.cli.render.browser_program', str)
    other = tmp_path / 'other.mcap'
    output = ['--output', str(tmp_path / 'x.png')]
    for content in (None, b'', recording.read_bytes()[:100]):
        if content is not None:
            other.write_bytes(content)
        status, _, error = command('render', str(recording), str(other), *output)
        assert status == 2
        assert str(other) in error
        assert error.count('\n') == 1
