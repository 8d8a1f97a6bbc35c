"""`ballbot drive`: the graph in real time, driven by hand."""

from __future__ import annotations

from pathlib import Path

import click

from ballbot_ros.cli.options import (
    controller_option,
    device_option,
    folder_option,
    no_browser_option,
    no_keyboard_option,
    no_wait_option,
    page_options,
    set_option,
)
from ballbot_ros.cli.progress import Progress
from ballbot_ros.cli.web_page import PageObserver, PageOpening
from ballbot_ros.files import next_steps
from ballbot_ros.nodes.teleop.terminal import can_read_keys, keyboard_unavailable_reason
from ballbot_ros.run.observer import RunObserver
from ballbot_ros.run.requirements import require_rclpy


@click.command('drive')
@click.option('--map', 'map_name', help='Map to drive in, by name or file.')
@click.option(
    '--start', nargs=2, type=float, metavar='X Y', help='Start position in the frame map [m].'
)
@click.option('--profile', help='Device profile, such as hardware, or a file.  [default: ideal]')
@device_option
@no_keyboard_option
@folder_option('the recording.  [default: runs/<date>_drive]')
@click.option('--no-record', is_flag=True, help='Write no recording.')
@set_option
@controller_option
@click.option(
    '--viewer',
    is_flag=True,
    help='Show the robot in a browser; prints the address. The drive begins when the page is open.',
)
@no_browser_option
@no_wait_option
@click.option('--list-devices', is_flag=True, help='List the gamepads, show their input, and end.')
def command(
    map_name: str | None,
    start: tuple[float, float] | None,
    profile: str | None,
    device: str | None,
    no_keyboard: bool,
    output: Path | None,
    no_record: bool,
    assignments: tuple[str, ...],
    controller: str | None,
    viewer: bool,
    no_browser: bool,
    no_wait: bool,
    list_devices: bool,
) -> int:
    """Drive the robot by hand: gamepad, keyboard, or the topics joy and cmd_vel.

    Runs in real time until q, Ctrl-C or SIGTERM.
    """
    if list_devices:
        from ballbot_ros.nodes.teleop import gamepad as device_list

        device_list.list_devices()
        return 0
    page = page_options(viewer=viewer, no_browser=no_browser, no_wait=no_wait)
    require_rclpy()
    from ballbot_ros.run.drive import NAME, drive, drive_spec

    spec = drive_spec(
        map_name=map_name,
        start=start,
        profile=profile,
        device=device,
        assignments=assignments,
        controller=controller,
        output=output,
        record=not no_record,
    )
    obstacle = '--no-keyboard' if no_keyboard else keyboard_unavailable_reason()
    with Progress(NAME, 0.0, bar=bool(obstacle)) as progress:
        observer: RunObserver = progress
        if page:
            opening = PageOpening(page, progress.notice, can_press_key=can_read_keys())
            observer = PageObserver(progress, opening)
        result = drive(
            spec,
            observer,
            no_keyboard=obstacle,
            viewer=viewer,
            starts_paused=page is not None and page.waits,
        )
    if result.recording:
        click.echo('\n'.join([f'recording  {result.recording}', *next_steps(result.recording)]))
    return result.exit_status
