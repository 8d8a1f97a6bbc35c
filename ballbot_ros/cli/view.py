"""`ballbot view`: recorded runs in a browser."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import click

from ballbot_ros.cli.reading import read_shown_run
from ballbot_ros.stop_request import StopRequest, interrupted_later
from ballbot_ros.viewer.address import check_address, require_viser, warning_of


def view_recordings(paths: Sequence[Path], host: str, port: int) -> int:
    """Serve the page until told to stop; return the exit status."""
    require_viser()
    check_address(host, port)
    runs = [read_shown_run(path) for path in paths]
    # Only here: what viser brings with it takes a second to import.
    with interrupted_later():
        from ballbot_ros.viewer.page import UPDATE_S, Page
        from ballbot_ros.viewer.player import Player

    page = Page(runs[0].dimensions, ' and '.join(run.name for run in runs), host, port)
    player = Player(page, runs)
    if warning := warning_of(host):
        click.echo(f'warning: {warning}', err=True)
    click.echo(f'viewer  {page.address}')
    with StopRequest() as stop:
        last = time.monotonic()
        while not stop.signal:
            time.sleep(UPDATE_S)
            now = time.monotonic()
            if page.is_watched:
                player.update(now - last)
            last = now
    page.stop()
    return 0
