"""The order of the trials, and the table of their results."""

import io
import random

from rich.console import Console

from campaign.fault import Fault, Verdict
from campaign.schedule import Schedule, table_of

HELD, SLOW = Verdict((), 2.0, 10.0), Verdict((), 9.0, 60.0)
FAILED = Verdict(('hung',), 11.0, 10.0)


def fault(name, lasts_s=10.0, **kind):
    return Fault(name, lambda generator, number: None, lasts_s, **kind)


A, B, ALONE = fault('a'), fault('b', 20.0), fault('alone', alone=True)


def test_faults_take_turns():
    schedule = Schedule([A, B], 100.0)
    trials = [schedule.next(0.0, []) for _ in range(5)]
    assert [(trial.fault.name, trial.number) for trial in trials] == [
        ('a', 0), ('b', 0), ('a', 1), ('b', 1), ('a', 2),
    ]  # fmt: skip


def test_a_trial_begins_only_if_it_is_expected_to_end_in_time():
    schedule = Schedule([B, A], 100.0)
    assert schedule.next(85.0, []).fault is A
    assert schedule.has_more(90.0)
    assert schedule.next(91.0, []) is None
    assert not schedule.has_more(91.0)


def test_a_slow_trial_raises_the_expected_duration():
    schedule = Schedule([A], 100.0)
    schedule.took(A, 40.0)
    schedule.took(A, 12.0)
    assert schedule.next(60.0, []).fault is A
    assert schedule.next(61.0, []) is None


def test_a_trial_that_keeps_the_machine_busy_is_alone():
    schedule = Schedule([A, ALONE], 100.0)
    assert schedule.next(0.0, []).fault is A
    assert schedule.next(0.0, [A]) is None
    assert schedule.has_more(0.0)
    assert schedule.next(0.0, []).fault is ALONE
    assert schedule.next(0.0, [ALONE]) is None


def test_attempts_are_drawn_from_seed_fault_and_number():
    drawing = Fault('x', lambda generator, index: (generator.random(), index), 1.0)
    (first, index), (second, next_index) = drawing.attempt(1, 2), drawing.attempt(1, 3)
    assert first == random.Random('1 x 2').random() != second
    assert next_index == index + 1


def test_the_table_shows_trials_passes_and_the_worst_time():
    console = Console(width=80, file=io.StringIO())
    faults = [A, B, fault('c'), fault('d')]
    verdicts = {'a': [HELD, FAILED], 'b': [SLOW, HELD]}
    console.print(table_of(faults, verdicts, impossible=['d']))
    rows = [
        [cell.strip() for cell in line.strip('| ').split('|')]
        for line in console.file.getvalue().splitlines()
        if '|' in line
    ]
    assert rows[0] == ['fault', 'tried', 'held', 'worst']
    assert rows[2:] == [
        ['a', '2', '1', '11.0 s of 10 s'],
        ['b', '2', '2', '2.0 s of 10 s'],
        ['c', '0', '0', 'no time left'],
        ['d', '0', '0', 'not possible here'],
    ]
