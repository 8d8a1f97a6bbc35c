"""The LEGO NXT Ballbot as a ROS 2 node graph, and as a library: ``import ballbot_ros as bb``."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ballbot_ros.analysis.run import Run
    from ballbot_ros.errors import BallbotError
    from ballbot_ros.lab.studies.from_python import study
    from ballbot_ros.run.library import branch, linear_model, loop, sampled_loop, simulate
    from ballbot_ros.run.library import open as open  # noqa: A004

__version__ = '0.1.0'

# Without `open`, with which `from ballbot_ros import *` would replace Python's.
__all__ = [
    'BallbotError', 'Run', 'branch', 'linear_model', 'loop', 'sampled_loop', 'simulate', 'study',
]  # fmt: skip


def __getattr__(name: str) -> Any:
    # Imported at their first use, so that a node's start does not wait for them.
    if name not in (*__all__, 'open'):
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    module = 'lab.studies.from_python' if name == 'study' else 'run.library'
    return getattr(import_module(f'{__name__}.{module}'), name)


def __dir__() -> list[str]:
    return sorted([*__all__, 'open', '__version__'])
