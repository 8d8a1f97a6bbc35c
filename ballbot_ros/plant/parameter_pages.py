"""The documents that are made from the parameter table: default file and reference page."""

from __future__ import annotations

import yaml

from ballbot_ros.parameters.parameter import Acts, Parameter, Value
from ballbot_ros.parameters.plant import PlantParameters
from ballbot_ros.parameters.table import ALL_NODES, TABLE
from ballbot_ros.plant.model import PhysicalParameters

DERIVED = {
    'ratio': ('k = Rs/Rw', '1', '3.2'),
    'ball_inertia': ('Js = 2 Ms Rs²/3', 'kg·m²', '3.1'),
    'wheel_inertia': ('Jw = Mw Lw²/2', 'kg·m²', '3.1'),
    'body_inertia': ('Jψ = Mb L²/3', 'kg·m²', '3.1'),
    'alpha': ('α = Kt/Rm', 'N·m/V', '(3.19)'),
    'beta': ('β = k (Kt Kb/Rm + fm)', 'N·m·s/rad', '(3.19)'),
}


def default_file() -> str:
    """Return the text of ``config/ballbot.yaml``: every parameter with its default."""
    lines = [
        '# Every parameter with its default, the profile "ideal". Made from the parameter table by',
        '# scripts/generate; copy what you want to change into a file of your own.',
    ]
    for key in dict.fromkeys(_key(nodes) for nodes in _groups()):
        lines += ['', f'{key}:', '  ros__parameters:']
        for row in (row for row in TABLE if _key(row.nodes) == key):
            unit = f' [{row.unit}]' if row.unit else ''
            lines += [f'    # {row.description}{unit}', f'    {row.name}: {_text(row.default)}']
    return '\n'.join(lines) + '\n'


_NOTES = {Acts.AT_ONCE: ' (*at once*)', Acts.NEVER: ' (*read-only*)'}


def reference_page() -> str:
    """Return the text of ``docs/parameters.md``."""
    lines = [
        '# Parameters',
        '',
        'Made from `ballbot_ros/parameters` by `scripts/generate`. Sections and equations are',
        "those of the document; *facts* are the devices' and the author's figures that it does not",
        'give, *project* is what this simulator adds. A value that is given to a running node',
        '(`ros2 param set`) acts from the next run on, which `plant_sim/reset` begins, unless the',
        'parameter acts *at once* or is *read-only*.',
    ]
    for nodes in _groups():
        lines += [
            '',
            f'## {", ".join(nodes)}',
            '',
            '| parameter | default | unit | allowed | meaning | source |',
            '|---|---|---|---|---|---|',
        ]
        for row in _rows_of(nodes):
            note = _NOTES.get(row.acts, '')
            lines.append(
                f'| `{row.name}` | {_text(row.default)} | {row.unit} | {_allowed(row)} '
                f'| {row.description}{note} | {row.source} |'
            )
    physical = PhysicalParameters.from_parameters(PlantParameters())
    lines += [
        '',
        '## Derived',
        '',
        'They follow from the parameters above and are not set.',
        '',
        '| quantity | value | unit | source |',
        '|---|---|---|---|',
    ]
    for name, (formula, unit, source) in DERIVED.items():
        lines.append(f'| {formula} | {getattr(physical, name):.6g} | {unit} | {source} |')
    return '\n'.join(lines) + '\n'


def _groups() -> list[tuple[str, ...]]:
    """Return the sets of nodes that share parameters, most shared first, then node by node."""
    return sorted({row.nodes for row in TABLE}, key=lambda nodes: (-len(nodes), _order(nodes)))


def _order(nodes: tuple[str, ...]) -> list[int]:
    return [ALL_NODES.index(node) for node in nodes]


def _rows_of(nodes: tuple[str, ...]) -> list[Parameter]:
    return [row for row in TABLE if row.nodes == nodes]


def _key(nodes: tuple[str, ...]) -> str:
    return f'/**/{nodes[0]}' if len(nodes) == 1 else '/**'


def _text(value: Value) -> str:
    if isinstance(value, tuple):
        return f'[{", ".join(map(_text, value))}]'
    text = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True)
    return text.removesuffix('\n').removesuffix('\n...').strip()


def _allowed(row: Parameter) -> str:
    if row.choices:
        return row.choices_text
    if row.bounds:
        return row.bounds_text
    return 'true, false' if isinstance(row.default, bool) else 'any text'
