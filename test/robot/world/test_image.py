"""Map images: valid ones, and the errors for refused ones."""

import io
import struct
import tempfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st
from laws import given, is_read_or_refused_in_one_line, refusal
from PIL import Image

from ballbot_ros.errors import WorldError
from ballbot_ros.robot.world.floor_map import FLOOR, LINE, WALL
from ballbot_ros.robot.world.image import read_map

CELLS = np.array([[FLOOR, WALL, LINE], [WALL, WALL, FLOOR]], dtype=np.uint8)
VALUES = np.array([FLOOR, WALL, LINE], dtype=np.uint8)


def rgb(gray):
    return np.repeat(gray[..., None], 3, axis=2)


def picture(mode):
    image = Image.fromarray(rgb(CELLS))
    return image.quantize(3) if mode == 'P' else image.convert(mode)


@pytest.mark.parametrize('suffix', ['png', 'bmp'])
@pytest.mark.parametrize('mode', ['L', 'P', 'RGB', 'RGBA'])
def test_gray_palette_and_colour_images_are_the_same_map(tmp_path, mode, suffix):
    path = tmp_path / f'map.{suffix}'
    picture(mode).save(path)
    np.testing.assert_array_equal(read_map(path).cells, CELLS)


def test_an_image_of_one_bit_a_pixel_is_floor_and_lines(tmp_path):
    path = tmp_path / 'map.png'
    Image.fromarray(np.array([[0, 255]], dtype=np.uint8)).convert('1').save(path)
    np.testing.assert_array_equal(read_map(path).cells, [[LINE, FLOOR]])


@given(st.integers(1, 30), st.integers(1, 30), st.integers(0, 2**32 - 1))
def test_every_map_comes_back_as_it_was_saved(rows, columns, seed):
    cells = np.random.default_rng(seed).choice(VALUES, (rows, columns))
    for form in ('PNG', 'BMP'):
        np.testing.assert_array_equal(read_saved(Image.fromarray(cells), form), cells)


def read_saved(image, form):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'map'
        image.save(path, form)
        return read_map(path).cells


def png(data=b'', width=1, height=1, depth=8, colour_type=0):
    """Return a PNG file of hand-made chunks."""

    def chunk(kind, content):
        crc = zlib.crc32(kind + content)
        return struct.pack('>I', len(content)) + kind + content + struct.pack('>I', crc)

    header = struct.pack('>IIBBBBB', width, height, depth, colour_type, 0, 0, 0)
    body = chunk(b'IHDR', header) + chunk(b'IDAT', zlib.compress(data)) + chunk(b'IEND', b'')
    return b'\x89PNG\r\n\x1a\n' + body


def encoded(image, form='PNG', **options):
    stream = io.BytesIO()
    image.save(stream, form, **options)
    return stream.getvalue()


def with_pixel(value, mode='RGB'):
    image = Image.fromarray(rgb(np.full((4, 6), FLOOR, np.uint8))).convert(mode)
    for place in ((5, 3), (4, 2)):
        image.putpixel(place, value)
    return encoded(image)


def animation():
    frames = [Image.new('L', (3, 3), gray) for gray in (FLOOR, WALL)]
    return encoded(frames[0], save_all=True, append_images=frames[1:])


BAD = {
    'empty': (b'', 'empty'),
    'text': (b'hello, this is no image', 'not a PNG or BMP image'),
    'jpeg': (encoded(picture('RGB'), 'JPEG'), 'JPEG alters colours'),
    'gif': (encoded(picture('P'), 'GIF'), 'not a PNG or BMP image'),
    'half a png': (encoded(Image.effect_noise((64, 64), 99.0))[:800], 'damaged'),
    'half a bmp': (encoded(picture('RGB').resize((64, 64)), 'BMP')[:800], 'damaged'),
    'too wide': (png(width=4001), '4001 × 1 pixels'),
    'too high': (png(height=4001), 'at most 4000'),
    'bomb': (png(width=10**5, height=10**5), 'at most 4000'),
    'nearly a bomb': (png(width=10**4, height=10**4), 'at most 4000'),
    'no pixel': (png(width=0), 'not a PNG'),
    '16-bit gray': (png(b'\0\xff\xff', depth=16), '16 bits'),
    '16-bit colour': (png(b'\0' + b'\xff' * 6, depth=16, colour_type=2), '16 bits'),
    'red': (with_pixel((255, 0, 0)), 'column 4, row 2 (from 0 at the top left) is of colour (255'),
    'gray 127': (with_pixel((127, 127, 127)), 'column 4, row 2'),
    'nearly white': (with_pixel((255, 255, 254)), '(255, 255, 254); allowed are white (255)'),
    'transparent': (with_pixel((255, 255, 255, 254), 'RGBA'), 'is transparent (alpha 254)'),
    'frames': (animation(), '2 frames'),
}  # fmt: skip


def test_an_invalid_map_is_refused_in_one_line_with_the_reason(tmp_path):
    path = tmp_path / 'map.png'
    for name, (data, hint) in BAD.items():
        path.write_bytes(data)
        text = refusal(WorldError, read_map, path)
        assert text.startswith(f'{path}: '), name
        assert hint in text, name


def test_a_palette_with_a_transparent_colour_is_refused(tmp_path):
    path = tmp_path / 'map.png'
    image = Image.new('P', (2, 1))
    image.putpalette([255, 255, 255, 0, 0, 0])
    image.putdata([1, 0])
    image.save(path, transparency=0)
    with pytest.raises(WorldError, match=r'column 1, row 0 .* is transparent'):
        read_map(path)


def test_a_missing_or_irregular_file_is_one_line(tmp_path):
    for path in (tmp_path / 'no.png', tmp_path):
        with pytest.raises(WorldError, match=f'^{path}: '):
            read_map(path)
    with pytest.raises(WorldError, match='null'):
        read_map('a\0b/map.png')


def test_the_largest_map_is_read(tmp_path):
    path = tmp_path / 'map.png'
    Image.new('1', (4000, 1), 1).save(path)
    assert read_map(path).columns == 4000


@given(st.binary(max_size=300), st.sampled_from([b'', b'BM', png()[:40], png()[:60], b'\x89PNG']))
def test_arbitrary_bytes_are_refused_in_one_line(data, beginning):
    with tempfile.NamedTemporaryFile() as file:
        file.write(beginning + data)
        file.flush()
        assert is_read_or_refused_in_one_line(read_map, file.name)


@given(st.sampled_from(['PNG', 'BMP']), st.integers(0, 10**6), st.integers(0, 255))
def test_an_image_with_a_wrong_byte_is_read_or_refused_in_one_line(form, place, value):
    data = bytearray(encoded(picture('P'), form))
    data[place % len(data)] = value
    with tempfile.NamedTemporaryFile() as file:
        file.write(data)
        file.flush()
        assert is_read_or_refused_in_one_line(read_map, file.name)
