"""The shipped maps, and maps from the user's files."""

from __future__ import annotations

from pathlib import Path

from ballbot_ros.files import read_bytes
from ballbot_ros.share import share_directory
from ballbot_ros.suggestions import did_you_mean
from ballbot_ros.world.errors import WorldError
from ballbot_ros.world.floor_map import FloorMap

MAP_SUFFIXES = ('.png', '.bmp')


def map_names() -> list[str]:
    """Return the names of the shipped maps."""
    return sorted(path.stem for path in _folder().glob('*.png'))


def is_file_name(name_or_file: str) -> bool:
    """Return whether a map is given by the path of its image instead of its name."""
    return '/' in name_or_file or name_or_file.lower().endswith(MAP_SUFFIXES)


def map_path(name_or_file: str) -> Path:
    """Return the image of a shipped map or the given path; raise WorldError for an unknown name."""
    if is_file_name(name_or_file):
        return Path(name_or_file)
    if name_or_file in map_names():
        return _folder() / f'{name_or_file}.png'
    raise WorldError(
        f'unknown map {name_or_file!r}{did_you_mean(name_or_file, map_names())}; '
        f'shipped: {", ".join(map_names())} '
        '(for your own map, give the path of its file, ending in .png or .bmp)'
    )


def read_map_file(name_or_file: str) -> bytes:
    """Read the image file of a map unchanged; raise WorldError if it does not exist."""
    path = map_path(name_or_file)
    try:
        return read_bytes(path)
    except OSError as error:
        raise WorldError(f'{path}: {error.strerror}') from None


def load_map(name_or_file: str) -> FloorMap:
    """Load a shipped map by its name, or an image by its path; raise WorldError if it is no map."""
    # Imported here, so that nodes without a map start faster.
    from ballbot_ros.world.image import read_map

    return read_map(map_path(name_or_file))


def image_suffix(data: bytes) -> str:
    """Return the file name ending that matches the content of a map image."""
    return '.png' if data.startswith(b'\x89PNG') else '.bmp'


def _folder() -> Path:
    return share_directory() / 'config/maps'
