"""What a recorded run has attached, what kind of file that is, and what tells of its end."""

from pathlib import PurePath

SCENARIO, PARAMETERS, VERSIONS = 'scenario.yaml', 'parameters.yaml', 'versions.yaml'

OUTCOME_KEYS = ('outcome', 'reason', 'ticks', 'duty_sha256')
"""What an account of a run's end has."""

MAPS = ('map.png', 'map.bmp')
"""The map's image, in the format that it has; none where the floor is free."""

_MEDIA_TYPES = {'.yaml': 'application/yaml', '.png': 'image/png', '.bmp': 'image/bmp'}


def media_type(name: str) -> str:
    """Return the media type of a file by the ending of its name."""
    return _MEDIA_TYPES.get(PurePath(name).suffix.lower(), 'application/octet-stream')
