"""`ballbot scenarios`: the shipped scenarios."""

from __future__ import annotations

import click

from ballbot_ros.engine.scenario.reader import load_scenario, scenario_names


@click.command('scenarios')
def command() -> None:
    """List the shipped scenarios."""
    names = scenario_names()
    width = max(map(len, names))
    for name in names:
        click.echo(f'{name:<{width}}  {load_scenario(name).purpose}')
