"""What the progress of a command prints, on a terminal and elsewhere."""

import io
import itertools
import threading
from contextlib import nullcontext
from types import SimpleNamespace

from rich.console import Console

from ballbot_ros.cli import progress
from ballbot_ros.cli.progress import Progress, ProgressLines

WHY = 'controller: own.py:4: RuntimeError: no'


def console(*, is_terminal=False):
    return Console(
        file=io.StringIO(), force_terminal=is_terminal, width=80, highlight=False, markup=False
    )


class Clock:
    """Passes 10 s at a time, whenever the test lets it."""

    def __init__(self):
        self.waits, self._go, self.asked = [], threading.Semaphore(0), threading.Semaphore(0)
        self._ended = False

    def wait(self, seconds):
        self.waits.append(seconds)
        self.asked.release()
        self._go.acquire()
        return self._ended

    def pass_period(self):
        self._go.release()
        self.asked.acquire()

    def end(self):
        self._ended = True
        self._go.release()


def test_without_a_terminal_a_line_says_every_ten_seconds_how_far_the_work_is(monkeypatch):
    monkeypatch.setattr(progress, 'LINE_PERIOD_S', 10.0)
    out, clock = console(), Clock()
    with ProgressLines('identifying', out, clock.wait) as lines:
        clock.asked.acquire()
        assert out.file.getvalue() == ''
        clock.pass_period()
        lines.text = '40%'
        clock.pass_period()
        clock.end()
    assert clock.waits == [10.0] * 3
    assert out.file.getvalue().splitlines() == [
        'identifying, 10 s so far', 'identifying: 40%, 20 s so far',
    ]  # fmt: skip


def test_a_file_with_more_messages_than_it_says_is_read_to_the_end(monkeypatch):
    shown = nullcontext(SimpleNamespace())
    monkeypatch.setattr(progress, 'ProgressLines', lambda name, console: shown)
    with progress.file_progress('run.mcap') as advance:
        advance(30, 10)
    assert shown.enter_result.text == '100%'


def test_a_terminal_has_a_bar_and_no_lines():
    waited = []
    with ProgressLines('identifying', console(is_terminal=True), waited.append):
        pass
    assert waited == []


def test_short_work_prints_no_line():
    out = console()
    with ProgressLines('identifying', out):
        pass
    assert out.file.getvalue() == ''


def test_what_the_result_says_is_not_printed_before_it(monkeypatch):
    now_s = itertools.chain([0.0, 100.0, 106.0], itertools.repeat(110.0))
    monkeypatch.setattr(progress, 'time', SimpleNamespace(monotonic=lambda: next(now_s)))
    out = console()
    with Progress('own', 0.0, console=out) as shown:
        shown.notice('controller: slow')
        shown.update(0.1)  # it has not ended the run
        assert out.file.getvalue().splitlines() == ['controller: slow']
        for text in (WHY, f'plant_sim: {WHY}', 'controller: 2 of 9 ticks', 'gyro_driver: noisy'):
            shown.notice(text)
        shown.update(0.5)  # the last sim time may be told after the reason
        shown.release(WHY)
    assert out.file.getvalue().splitlines()[1:] == [
        'gyro_driver: noisy',
        'controller: 2 of 9 ticks',
    ]


def test_what_no_result_says_is_printed():
    out = console()
    with Progress('own', 0.0, console=out) as shown:
        shown.notice(WHY)
    assert out.file.getvalue().splitlines() == [WHY]
