"""What kind of file an attachment is."""

from pathlib import PurePath

_MEDIA_TYPES = {'.yaml': 'application/yaml', '.png': 'image/png', '.bmp': 'image/bmp'}


def media_type(name: str) -> str:
    """Return the media type of a file by the ending of its name."""
    return _MEDIA_TYPES.get(PurePath(name).suffix.lower(), 'application/octet-stream')
