"""Signals that are noted instead of interrupting."""

import signal

import pytest

from ballbot_ros.stop_request import StopRequest, defer_sigint


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


def test_an_interruption_within_the_block_is_raised_after_it():
    def interrupted():
        with defer_sigint():
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                pytest.fail('not held back')

    with pytest.raises(KeyboardInterrupt):
        interrupted()
