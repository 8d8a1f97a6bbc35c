"""Which ticks are ended, on a machine that may be too busy to let them return."""

import signal
import threading
from types import SimpleNamespace

import parts
import pytest
from parts import AT_REST

from ballbot_ros.controllers.codegen.implementation import compose_controller, implementation_for
from ballbot_ros.errors import ControllerError
from ballbot_ros.lockstep.liveness import ThreadTime
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet, PlantParameters
from ballbot_ros.process import StopRequest
from ballbot_ros.run import tick_timer
from ballbot_ros.run.tick_timer import TickTimer

SLEEPS, COMPUTES, WAITS_FOR_A_PROCESSOR = (0.0, 0.0), (1.0, 0.0), (0.0, 1.0)
"""Parts of the time in which a tick has a processor, and waits for one."""


class Machine:
    """Lets the wall time of a tick pass, and with it the timer."""

    def __init__(self):
        self.now_s, self.thread = 0.0, ThreadTime(0.0, 0.0, False)
        self.way, self.wall_s = COMPUTES, 0.0

    def pass_tick(self):
        for _ in range(round(self.wall_s / 0.2)):
            self.now_s += 0.2
            cpu_s, queued_s = (0.2 * share for share in self.way)
            before = self.thread
            self.thread = ThreadTime(before.cpu_s + cpu_s, before.queued_s + queued_s, False)
            signal.raise_signal(signal.SIGALRM)


@pytest.fixture
def machine(monkeypatch):
    machine = Machine()
    # That of pytest-timeout, if any, must not see the time that passes.
    left_s, _ = signal.setitimer(signal.ITIMER_REAL, 0)
    monkeypatch.setattr(tick_timer, 'time', SimpleNamespace(monotonic=lambda: machine.now_s))
    monkeypatch.setattr(tick_timer, '_thread_time', lambda: machine.thread)
    yield machine
    signal.setitimer(signal.ITIMER_REAL, left_s)


@pytest.fixture
def ticks(tmp_path, monkeypatch, machine):
    """Return a function that runs ticks of these lengths; each passes the time in its line 6."""
    monkeypatch.chdir(tmp_path)

    def ticks(*walls_s, way=COMPUTES, stop=None, **plant):
        (tmp_path / 'mine.py').write_text(
            'from ballbot_ros.controllers import Controller\n\n\n'
            'class Mine(Controller):\n    def tick(self, readings):\n'
            '        self.model_of_time()\n        return 0, 0\n'
        )
        parameters = ParameterSet()
        parameters.set(CONTROLLER, 'implementation', 'mine.py:Mine')
        loaded = compose_controller(parameters)
        loaded.cls.model_of_time = lambda self: machine.pass_tick()
        program = implementation_for(parameters.of(ControllerParameters), loaded).make()
        machine.way = way
        with TickTimer(loaded, PlantParameters(**plant), stop):
            for tick, machine.wall_s in enumerate(walls_s):
                parts.tick(program, 4 * tick, 4 * tick, AT_REST)

    return ticks


@pytest.mark.parametrize('way', [SLEEPS, COMPUTES])
def test_a_tick_is_ended_after_its_time(ticks, way):
    ticks(1.8, 1.8, 1.8, way=way)
    with pytest.raises(
        ControllerError, match=r'^mine\.py:6: does not return within 2 s \(Mine\.tick at 0\.004 s'
    ):
        ticks(0.0, 2.8, way=way)


def test_the_first_tick_has_the_time_of_a_start(ticks):
    ticks(29.0)
    with pytest.raises(ControllerError, match=r'within 30 s \(Mine\.tick at 0\.000 s'):
        ticks(31.0)


def test_a_tick_that_waits_for_a_processor_is_not_ended(ticks):
    ticks(0.0, 1000.0, way=WAITS_FOR_A_PROCESSOR)
    ticks(0.0, 18.0, way=(0.1, 0.9))
    with pytest.raises(ControllerError, match='within 2 s'):
        ticks(0.0, 24.0, way=(0.1, 0.9))


def test_a_tick_that_may_wait_is_ended_only_by_a_request_to_stop(ticks):
    ticks(0.0, 1000.0, on_timeout='wait')
    with StopRequest() as stop:
        ticks(0.0, 0.0, on_timeout='wait', stop=stop)
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(ControllerError, match='does not return after a request to stop'):
            ticks(0.0, 1.0, on_timeout='wait', stop=stop)


def test_other_threads_have_no_timer(ticks, machine, monkeypatch):
    before = signal.getsignal(signal.SIGALRM)
    handlers = []
    monkeypatch.setattr(
        machine, 'pass_tick', lambda: handlers.append(signal.getsignal(signal.SIGALRM))
    )
    thread = threading.Thread(target=ticks, args=(0.0,))
    thread.start()
    thread.join()
    assert handlers == [before]
