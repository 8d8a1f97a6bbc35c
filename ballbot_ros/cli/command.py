"""The `ballbot` command."""

from __future__ import annotations

import click

from ballbot_ros import __version__
from ballbot_ros.cli import commands, recording_commands


class _RunByDefault(click.Group):
    """A word that is no command is a scenario: `ballbot stationary` is `ballbot run stationary`."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in self.commands and not args[0].startswith('-'):
            args = ['run', *args]
        return super().resolve_command(ctx, args)


@click.group(
    cls=_RunByDefault,
    context_settings={'help_option_names': ['-h', '--help'], 'max_content_width': 100},
)
@click.version_option(__version__, prog_name='ballbot')
def ballbot() -> None:
    """Simulate, measure and record the LEGO NXT Ballbot."""


for command in (
    commands.run,
    commands.drive,
    commands.scenarios,
    recording_commands.report,
    recording_commands.compare,
    recording_commands.view,
    recording_commands.render,
    recording_commands.replay,
    recording_commands.info,
    recording_commands.play,
    recording_commands.export,
    recording_commands.repair,
    recording_commands.log2csv,
    commands.map_command,
    commands.design,
    commands.codegen,
    commands.doctor,
):
    ballbot.add_command(command)
