"""Entry points of the nodes, which a signal ends quietly even during their imports.

Each node of :mod:`ballbot_ros.nodes.registry` is a function of this module.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from functools import partial

from ballbot_ros.process import StopRequest, open_standard_streams


def start(node: str | None) -> None:
    """Import a node and run it; a signal during the import ends the program afterwards."""
    open_standard_streams()
    with StopRequest() as stop:
        from ballbot_ros.nodes.registry import REGISTRY

        if node not in REGISTRY:
            problem = 'no node given' if node is None else f'unknown node {node!r}'
            print(f'error: {problem}; known: {", ".join(REGISTRY)}', file=sys.stderr)
            sys.exit(2)
        main = REGISTRY[node].main
        if not stop.signal:
            try:
                sys.exit(main())
            finally:
                # Leave all objects to the system: collecting those of the modules takes 0.3 s.
                gc.freeze()


def __getattr__(name: str) -> Callable[[], None]:
    # Accept every name here: `start` checks it, because the check needs an import, which a signal
    # must be able to end quietly, too.
    if name.startswith('_'):
        raise AttributeError(name)
    return partial(start, name)


def main() -> None:
    """Run the node named by the first argument."""
    start(sys.argv.pop(1) if len(sys.argv) > 1 else None)
