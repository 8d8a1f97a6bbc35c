"""Signals that are noted instead of interrupting."""

import signal
import subprocess
import sys

import pytest
from graph import LAST_RESORT_S, kept_handlers

from ballbot_ros.process import STOP_SIGNALS, DeferredSignals, ProgramEnd, StopRequest


def test_the_first_signal_is_noted():
    with StopRequest() as stop:
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
    assert stop.signal == signal.SIGTERM


def test_a_hangup_is_noted_unless_it_is_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        with StopRequest() as stop:
            signal.raise_signal(signal.SIGHUP)
        assert stop.signal == signal.SIGHUP
        signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
        with StopRequest() as stop:
            signal.raise_signal(signal.SIGHUP)
        assert stop.signal == 0
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_signal_noted_by_an_outer_block_counts_in_an_inner_one():
    with StopRequest() as outer:
        signal.raise_signal(signal.SIGINT)
        with StopRequest() as inner:
            assert inner.signal == outer.signal == signal.SIGINT


def test_the_previous_handlers_are_restored():
    before = signal.getsignal(signal.SIGTERM)
    with StopRequest():
        assert signal.getsignal(signal.SIGTERM) != before
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize(
    ('number', 'end'),
    [
        (signal.SIGINT, KeyboardInterrupt()),
        (signal.SIGTERM, SystemExit(143)),
        (signal.SIGHUP, SystemExit(129)),
    ],
)
def test_the_first_signal_ends_a_program_and_later_ones_do_not_disturb_its_end(number, end):
    events = []

    def program():
        with ProgramEnd():
            try:
                with DeferredSignals():
                    signal.raise_signal(number)
                    events.append('imported')
                events.append('not ended')
            finally:
                for each in STOP_SIGNALS:
                    signal.raise_signal(each)
                events.append('cleaned up')

    with kept_handlers():
        with pytest.raises(type(end)) as ended:
            program()
        assert ended.value.args == end.args
        assert events == ['imported', 'cleaned up']
        for each in STOP_SIGNALS:
            signal.raise_signal(each)  # while the interpreter ends


@pytest.mark.parametrize(('number', 'status'), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize('delay_s', [0.01, 0.0], ids=['later', 'still in the hook'])
def test_a_signal_in_the_callback_of_a_weak_reference_ends_a_program(number, status, delay_s):
    script = f"""
import signal, sys, time, weakref
from ballbot_ros import process
from ballbot_ros.process import ProgramEnd

process._AGAIN_S = {delay_s}

class Item:
    pass

with ProgramEnd():
    try:
        item = Item()
        callback = weakref.ref(item, lambda _: signal.raise_signal({int(number)}))
        del item
        while True:
            time.sleep(0.01)
    except KeyboardInterrupt:
        sys.exit(130)
"""
    done = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, timeout=LAST_RESORT_S,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (status, '')


def test_a_deferred_signal_has_its_usual_effect_afterwards():
    with StopRequest() as stop:
        with DeferredSignals():
            signal.raise_signal(signal.SIGTERM)
            assert stop.signal == 0
        assert stop.signal == signal.SIGTERM
