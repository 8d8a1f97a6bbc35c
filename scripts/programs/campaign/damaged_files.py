"""Damaged and hostile recordings, and invalid scenarios and arguments."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ballbot_ros.parameters import NODES, PLANT, parameters_of
from campaign.fault import Verdict
from campaign.run import NAME, SCENARIO, judge_printed, write_scenario
from campaign.site import BALLBOT, Program, Site

COMMAND_BOUND_S = 60.0
RECORDED_S = 1.2
STATUSES = (0, 1, 2)
FILES = 30
"""Hostile recordings in a trial."""

Damage = Callable[[random.Random, bytes], bytes]


def cut(generator: random.Random, data: bytes) -> bytes:
    """Cut off the end."""
    return data[: generator.randrange(len(data))]


def flip(generator: random.Random, data: bytes) -> bytes:
    """Flip some bits."""
    damaged = bytearray(data)
    for _ in range(generator.choice((1, 1, 3, 30))):
        damaged[generator.randrange(len(damaged))] ^= 1 << generator.randrange(8)
    return bytes(damaged)


def blank(generator: random.Random, data: bytes) -> bytes:
    """Overwrite a part with zeros, as a file system does after a power cut."""
    begin = generator.randrange(len(data))
    length = min(generator.choice((16, 512, 4096, 65536)), len(data) - begin)
    return data[:begin] + bytes(length) + data[begin + length :]


def repeat(generator: random.Random, data: bytes) -> bytes:
    """Duplicate a part."""
    begin, end = sorted(generator.randrange(len(data)) for _ in range(2))
    return data[:end] + data[begin:]


DAMAGES: tuple[Damage, ...] = (cut, flip, blank, repeat)


@dataclass(frozen=True)
class DamagedRecording:
    """A damaged recording, passed to every command that reads one.

    Attributes
    ----------
    damage : callable
    seed : int
        Seed of the random choices.
    """

    damage: Damage
    seed: int

    def __str__(self) -> str:
        return f'{(self.damage.__doc__ or "").rstrip(".").lower()}, drawn with seed {self.seed}'

    @classmethod
    def draw(cls, generator: random.Random, index: int) -> DamagedRecording:
        """Draw a damaged recording; the kinds of damage alternate."""
        return cls(DAMAGES[index % len(DAMAGES)], generator.getrandbits(32))

    def carry_out(self, site: Site) -> Verdict:
        """Record, damage, read."""
        folder = site.folder / 'whole'
        scenario = write_scenario(site.folder)
        recorder = site.start(
            'run', *BALLBOT, 'run', scenario, '--processes=none', '--output', folder,
            '--set', f'{PLANT}.duration={RECORDED_S}',
        )  # fmt: skip
        site.await_end(recorder, COMMAND_BOUND_S)
        data = (folder / f'{NAME}.mcap').read_bytes()
        damaged = site.folder / 'damaged.mcap'
        damaged.write_bytes(self.damage(random.Random(self.seed), data))
        return run_commands(
            site,
            {
                'info': ('info', damaged),
                'repair': ('repair', damaged, '--output', site.folder / 'repaired.mcap'),
                'replay': ('replay', damaged),
                'report': ('report', damaged, '--output', site.folder / 'report'),
                'export': ('export', damaged, '--to', 'csv', '--output', site.folder / 'tables'),
            },
        )


@dataclass(frozen=True)
class HostileRecordings:
    """Recordings with valid checksums and hostile content, read in one process.

    Attributes
    ----------
    seed : int
        Seed of the files.
    """

    seed: int

    def __str__(self) -> str:
        return f'{FILES} files, drawn with seed {self.seed}'

    @classmethod
    def draw(cls, generator: random.Random, index: int) -> HostileRecordings:
        """Draw a seed."""
        return cls(generator.getrandbits(32))

    def carry_out(self, site: Site) -> Verdict:
        """Write and read the files."""
        words = ('campaign.hostile_reading', '--seed', self.seed, '--count', FILES)
        program = site.start('hostile', *words)
        end = site.await_end(program, COMMAND_BOUND_S)
        failures = [line for line in program.text.splitlines() if line.startswith('file ')]
        if end.status != 0 and not failures:
            failures = judge_command(program, end.status) or [f'status {end.status}']
        return Verdict(tuple(failures), end.took_s, COMMAND_BOUND_S)


@dataclass(frozen=True)
class FuzzedInput:
    """A scenario with errors in its text, and parameters with arbitrary values.

    Attributes
    ----------
    scenario : bytes
    assignments : sequence of str
    """

    scenario: bytes
    assignments: Sequence[str]

    def __str__(self) -> str:
        return f'scenario {self.scenario!r}, --set {" --set ".join(self.assignments)}'

    @classmethod
    def draw(cls, generator: random.Random, index: int) -> FuzzedInput:
        """Draw a scenario and one or two assignments."""
        text = SCENARIO.encode()
        for _ in range(generator.randint(1, 2)):
            # Mostly replace a value: after other changes the text is rarely still a scenario.
            text = generator.choice((swap, swap, swap, *DAMAGES))(generator, text) or b' '
        assignments = []
        for value in generator.choices(VALUES, k=generator.randint(1, 2)):
            node, name = generator.choice(PARAMETERS)
            assignments.append(f'{node}.{name}={value}')
        return cls(text, assignments)

    def carry_out(self, site: Site) -> Verdict:
        """Run scenario and parameters without ROS: errors must be found before anything starts."""
        scenario = site.folder / 'fuzzed.yaml'
        scenario.write_bytes(self.scenario)
        whole = write_scenario(site.folder)
        words = ['--processes=none', '--no-record']
        # These settings come last, so that they override the drawn ones and keep the run short.
        short = ['--real-time-factor=0', '--set', f'{PLANT}.duration=0.1']
        sets = [word for each in self.assignments for word in ('--set', each)]
        return run_commands(
            site,
            {
                'scenario': ('run', scenario, *words, *short),
                'parameters': ('run', whole, *words, *sets, *short),
            },
        )


PARAMETERS = [(node, name) for node in NODES for name in parameters_of(node)]
VALUES = (
    'nan', 'inf', '-inf', '-1', '0', '1e308', '1e-320', '10' * 200, '', ' ', '[', '{}', '[1, 2]',
    'true', 'null', '~', '"', "'", '\\', '%s', '🤖', '0x10', '1_000', '2026-01-01', '&a [*a]',
    '!!python/name:x', '../nowhere/file', '/dev/null', 'track',
)  # fmt: skip


def swap(generator: random.Random, data: bytes) -> bytes:
    """Replace a value with another one."""
    lines = data.split(b'\n')
    number = generator.randrange(len(lines))
    key, colon, _ = lines[number].partition(b':')
    lines[number] = key + colon + b' ' + generator.choice(VALUES).encode()
    return b'\n'.join(lines)


def run_commands(site: Site, commands: dict[str, tuple[str | Path, ...]]) -> Verdict:
    """Run commands one after the other; each must end in time, with a status and no crash."""
    failures = []
    longest_s = 0.0
    for name, words in commands.items():
        program = site.start(name, *BALLBOT, *words)
        end = site.await_end(program, COMMAND_BOUND_S)
        longest_s = max(longest_s, end.took_s)
        failures += [f'{name}: {each}' for each in judge_command(program, end.status)]
    return Verdict(tuple(failures), longest_s, COMMAND_BOUND_S)


def judge_command(program: Program, status: int | None) -> list[str]:
    """Return the broken guarantees of a command that received nonsense."""
    if status is None:
        return [f'still running after {COMMAND_BOUND_S:.0f} s']
    failures = judge_printed(program.text)
    if status not in STATUSES:
        failures.append(f'status {status}')
    return failures
