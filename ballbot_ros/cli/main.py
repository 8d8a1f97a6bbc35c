"""Entry point of the `ballbot` command."""

from __future__ import annotations

import gc
import os
import sys

from ballbot_ros.process import DeferredSignals, ProgramEnd

# Use one thread: matrices of four rows need no more, and others would compete with the nodes.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')


def main() -> None:
    """Run the command, and end with its exit status."""
    with ProgramEnd():
        try:
            # Defer signals while modules load, so that they end the command as quietly as later.
            with DeferredSignals():
                from ballbot_ros.cli.command import ballbot, invoke
            status = invoke(ballbot, 'ballbot')
        except KeyboardInterrupt:
            status = 130
        # Leave all objects to the system: collecting those of the modules would take 0.3 s.
        gc.freeze()
        sys.exit(status)


if __name__ == '__main__':
    main()
