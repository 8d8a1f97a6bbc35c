"""What a recorded run has attached, and what kind of file an attachment is."""

from pathlib import PurePath

SCENARIO, PARAMETERS, VERSIONS = 'scenario.yaml', 'parameters.yaml', 'versions.yaml'

MAPS = ('map.png', 'map.bmp')
"""The map's image, in the format that it has; none where the floor is free."""

_MEDIA_TYPES = {'.yaml': 'application/yaml', '.png': 'image/png', '.bmp': 'image/bmp'}


def media_type(name: str) -> str:
    """Return the media type of a file by the ending of its name."""
    return _MEDIA_TYPES.get(PurePath(name).suffix.lower(), 'application/octet-stream')
