"""What must be the same on all workers of a cluster, so that rows are comparable."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version

import numpy as np
import scipy

import ballbot_ros
from ballbot_ros.engine.compilation import code_sha256


@cache
def worker_versions() -> dict[str, str]:
    """Return the versions that must be the same on all workers, by name.

    Python and numba may differ: the compiled code keeps the operations of IEEE arithmetic and their
    order, whoever compiles it.
    """
    return {
        'ballbot_ros': ballbot_ros.__version__,
        'code of ballbot_ros': f'SHA-256 {code_sha256()}',
        'numpy': np.__version__,
        'scipy': scipy.__version__,
        'distributed': _version('distributed'),
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ''
