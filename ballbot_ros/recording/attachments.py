"""Names and media types of the files attached to a recorded run, and the keys of its outcome."""

from pathlib import PurePath

SCENARIO, PARAMETERS, VERSIONS = 'scenario.yaml', 'parameters.yaml', 'versions.yaml'

OUTCOME_KEYS = ('outcome', 'reason', 'ticks', 'duty_sha256')
"""Keys of the outcome of a run."""

MAPS = ('map.png', 'map.bmp')
"""Possible names of the attached map image, one per format; without a map there is none."""

CONTROLLER_INFO = 'controller.yaml'
"""Name of the file that identifies a controller other than the document's."""

CONTROLLER_SOURCES = ('controller.py', 'controller.zip')
"""Possible names of the attached code of a controller."""

_MEDIA_TYPES = {
    '.yaml': 'application/yaml', '.png': 'image/png', '.bmp': 'image/bmp',
    '.py': 'text/x-python', '.zip': 'application/zip',
}  # fmt: skip


def media_type(name: str) -> str:
    """Return the media type of a file from the ending of its name."""
    return _MEDIA_TYPES.get(PurePath(name).suffix.lower(), 'application/octet-stream')
