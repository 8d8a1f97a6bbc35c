"""What runs were made with, and what was changed from one to another."""

from __future__ import annotations

import hashlib
import reprlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from ballbot_ros.analysis.parent import Parent
from ballbot_ros.analysis.run_data import RunData
from ballbot_ros.errors import printable
from ballbot_ros.parameters import CONTROLLER, NODES, parameters_of, value_text
from ballbot_ros.recording.rosbag2 import PARAMETERS, PARENT, SCENARIO, VERSIONS

ABSENT = '–'
"""Stands for what a run does not have."""

_HASH_DIGITS = 8
_MAX_NAMED = 2
"""Maximum number of changes that a label names."""


@dataclass(frozen=True)
class RecordedSetup:
    """What a run was made with.

    Attributes
    ----------
    parameters : mapping of str to str or None
        The value of each parameter, as text by node and name; None if they are unknown.
    others : mapping of str to str
        Scenario, controller of another package, seed, versions and so on.
    """

    parameters: Mapping[str, str] | None
    others: Mapping[str, str]

    @classmethod
    def of(cls, run: RunData) -> RecordedSetup:
        """Return what a run was made with."""
        rows = parameter_rows(run)
        parameters = {f'{each.node}.{each.name}': each.value for each in rows}
        return cls(parameters or None, dict(_others(run)))


@dataclass(frozen=True)
class SetupChange:
    """Something that differs between runs: its name, and its value in each run as text."""

    name: str
    values: tuple[str, ...]

    @property
    def short_name(self) -> str:
        """The name without the node."""
        return self.name.rpartition('.')[2]

    def text(self, letters: Sequence[str]) -> str:
        """Return the values of the runs with these letters."""
        if len(self.values) == 2:
            return ' → '.join(self.values)
        having: defaultdict[str, list[str]] = defaultdict(list)
        for letter, value in zip(letters, self.values, strict=True):
            having[value].append(letter)
        return '; '.join(f'{", ".join(some)}: {value}' for value, some in having.items())


class ParameterRow(NamedTuple):
    """A parameter of a run as text; `default`, `unit` and `meaning` may be empty."""

    node: str
    name: str
    value: str
    default: str
    unit: str
    meaning: str
    is_changed: bool


def parameter_rows(run: RunData) -> Iterator[ParameterRow]:
    """Yield the parameters of a run, of a real robot its program's; nothing if unknown."""
    attached = run.attached
    if not attached.has_parameters:
        return
    for node in (CONTROLLER,) if run.is_real else NODES:
        values = attached.parameters.of_node(node)
        for name, row in parameters_of(node).items():
            value, default = getattr(values, name), value_text(row.default)
            unit, is_changed = '' if row.unit == '1' else row.unit, value != row.default
            meaning = row.description
            yield ParameterRow(node, name, value_text(value), default, unit, meaning, is_changed)
    for name, own in attached.parameters.undeclared.items():
        meaning = "of the controller's class"
        yield ParameterRow(CONTROLLER, name, reprlib.repr(own), '', '', meaning, True)


def _others(run: RunData) -> Iterator[tuple[str, str]]:
    attached = run.attached
    if attached.scenario:
        name, text = attached.scenario.purpose, attached.scenario.text
        yield 'scenario', f'{printable(name)} ({_hash(text.encode())})'
    for role, program in attached.external.items():
        yield f'external {role}', program
    for name, file in sorted(attached.files.items()):
        if name not in (PARAMETERS, PARENT, SCENARIO, VERSIONS):
            yield f'file {printable(name)}', _hash(file.data)
    if parent := Parent.decode(attached.files):
        yield 'branch of', str(parent)
    for name, version in attached.versions.items():
        yield f'version of {name}', version
    if external := [push for push in run.pushes if push.is_external]:
        told = (f'{push.strength} at {push.start:.3f} s' for push in external)
        yield 'outside pushes', '; '.join(told)
    if run.parameter_changes:
        yield 'changes during the run', '; '.join(map(str, run.parameter_changes))


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:_HASH_DIGITS]


def setup_changes(setups: Sequence[RecordedSetup]) -> list[SetupChange]:
    """Return what differs between runs, each once.

    Parameters are compared if those of all runs are known.
    """
    known = [each.parameters for each in setups if each.parameters is not None]
    changes = _differences([each.others for each in setups])
    if len(known) == len(setups):
        return _merged(_differences(known)) + changes
    told = ['unknown' if each.parameters is None else 'known' for each in setups]
    return changes if not known else [SetupChange('parameters', tuple(told)), *changes]


def _merged(changes: Sequence[SetupChange]) -> list[SetupChange]:
    """Return the changes, with one for a parameter that several nodes share and that changed alike.

    It has the name of the controller's, or else the name without a node, such as ``seed``.
    """
    groups: defaultdict[SetupChange, list[SetupChange]] = defaultdict(list)
    for each in changes:
        groups[SetupChange(each.short_name, each.values)].append(each)
    merged = []
    for common, same in groups.items():
        own = [each for each in same if each.name.startswith(f'{CONTROLLER}.')]
        merged.append((own or same)[0] if own or len(same) == 1 else common)
    return merged


def _differences(values: Sequence[Mapping[str, str]]) -> list[SetupChange]:
    names = dict.fromkeys(name for each in values for name in each)
    rows = (SetupChange(n, tuple(each.get(n, ABSENT) for each in values)) for n in names)
    return [row for row in rows if len(set(row.values)) > 1]


def names_of(paths: Sequence[Path]) -> list[str]:
    """Return a name for each recording: its own, or its folders as far as they tell it apart.

    A file that is given twice has one name.
    """
    parts = [path.absolute().with_suffix('').parts for path in paths]
    different = len(set(parts))
    deepest = max(map(len, parts))
    depth = next(n for n in range(1, deepest + 1) if len({p[-n:] for p in parts}) == different)
    names = ['/'.join(each[-depth:]) for each in parts]
    # `ballbot run` names a file like the end of its folder.
    short = [
        '/'.join(each[-depth:-1]) if _repeats(each[-depth:]) else name
        for each, name in zip(parts, names, strict=True)
    ]
    return short if len(set(short)) == different else names


def _repeats(parts: Sequence[str]) -> bool:
    return len(parts) > 1 and parts[-2].endswith(parts[-1])


def labels_of(names: Sequence[str], changes: Sequence[SetupChange]) -> list[str]:
    """Return a label for each run: its letter, its name and what differs from the first run."""
    return [
        f'{chr(ord("A") + index)} {name}{_change_text(index, changes)}'
        for index, name in enumerate(names)
    ]


def _change_text(index: int, changes: Sequence[SetupChange]) -> str:
    own = [each for each in changes if each.values[index] != each.values[0]]
    if not own:
        return ''
    if len(own) > _MAX_NAMED or any(len(each.values[index]) > 20 for each in own):
        return f' ({len(own)} change{"s"[: len(own) > 1]})'
    return f' ({", ".join(f"{each.short_name} {each.values[index]}" for each in own)})'
