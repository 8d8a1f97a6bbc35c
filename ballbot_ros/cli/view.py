"""`ballbot view`: recorded runs in a browser."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path

import click

from ballbot_ros.analysis.recorded_runs import is_real_robot
from ballbot_ros.cli.options import RECORDING, code_option, no_browser_option, trust_option
from ballbot_ros.cli.web_page import open_browser
from ballbot_ros.files import temporary_folder
from ballbot_ros.process import DeferredSignals, StopRequest
from ballbot_ros.recording.messages.recording_files import open_recording
from ballbot_ros.viewer.address import NEXT_FREE, address_line, network_warning, require_viser


@click.command('view')
@click.argument('recording', type=RECORDING)
@click.argument('other', required=False, type=RECORDING)
@click.option(
    '--host',
    default='127.0.0.1',
    show_default=True,
    help='Address that serves the page. Everybody who reaches it can watch; everybody who has '
    'the printed address with its token can steer.',
)
@click.option(
    '--port',
    type=click.IntRange(NEXT_FREE, 65535),
    default=NEXT_FREE,
    help='Its port; 0: a free one.  [default: 8080, or the next free one]',
)
@code_option
@trust_option
@no_browser_option
def command(
    recording: Path,
    other: Path | None,
    host: str,
    port: int,
    code: str | None,
    *,
    trust_attached_code: bool,
    no_browser: bool,
) -> int:
    """Show the last run of RECORDING in a browser, and that of OTHER as its ghost.

    "Live", or a drag of the robot, lets a simulated robot go on from the present moment: push it,
    drive it, tune it, choose a fault. The recorded run goes on as its ghost. "Keep" writes the
    recording.

    Serves the page until Ctrl-C or SIGTERM. The page has the keys of `ballbot play`: space pauses,
    → and ← skip 5 s, . goes one tick on, Home goes to the start, End pauses at the end, l restarts
    at the end, + and - change the speed.
    """
    # Imported only here: it takes half a second.
    from ballbot_ros.cli.recordings import read_playback_runs

    require_viser()
    runs = read_playback_runs(recording, other)
    # Imported only here: viser takes a second.
    with DeferredSignals():
        from ballbot_ros.run.branch import read_past
        from ballbot_ros.run.continued_page import ContinuedPage
        from ballbot_ros.run.continued_run import ContinuedRun
        from ballbot_ros.viewer.page import UPDATE_S, Page
        from ballbot_ros.viewer.recording_page import RecordingPage

    page = Page(runs[0].dimensions, ' and '.join(run.name for run in runs), host, port)
    if warning := network_warning(host):
        click.echo(f'warning: {warning}', err=True)
    click.echo(address_line(page.address, port))
    if not no_browser:
        open_browser(page.address)
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(temporary_folder()))
        reader = stack.enter_context(open_recording(recording))

        def make() -> ContinuedRun:
            past = read_past(
                reader, runs[0].number, scratch, code, trust_attached_code=trust_attached_code
            )
            return ContinuedRun(past, scratch)

        shown: RecordingPage
        if is_real_robot(reader):
            shown = RecordingPage(page, runs)  # nobody knows how to go on from there
        else:
            live = ContinuedPage(page, runs, make, lambda kept: click.echo(f'kept {kept}'))
            stack.callback(live.close)
            shown = live
        stop = stack.enter_context(StopRequest())
        last = time.monotonic()
        while not stop.signal:
            time.sleep(UPDATE_S)
            now = time.monotonic()
            if page.has_clients:
                shown.update(now - last)
            last = now
    page.stop()
    return 0
