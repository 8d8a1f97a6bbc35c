import contextlib
import math
import os
import signal
import threading

# As in the command, and before numpy is imported: on matrices as small as these, more threads only
# cost processor time, which the other tests need.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import pytest
from graph import Node, Run, call, free_domain

from ballbot_ros.cli import progress
from ballbot_ros.controllers import controller_program
from ballbot_ros.engine.compilation import NO_BACKGROUND, can_compile, has_kept_code
from ballbot_ros.errors import ViewerError
from ballbot_ros.files import COMMAND_ENV
from ballbot_ros.nodes.middleware import prepare_middleware
from ballbot_ros.run.node_process import ForkClient
from ballbot_ros.viewer.browser import browser_program

# Keep graphs under test off the network, and let the tests' own ROS nodes be discovered as fast as
# those of the graph.
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
prepare_middleware()

# The name of the command in its output does not depend on PATH or on how the tests were started.
os.environ[COMMAND_ENV] = 'ballbot'

# A test compiles what it needs.
os.environ[NO_BACKGROUND] = '1'

# What a command prints must not depend on the speed of the machine.
progress.LINE_PERIOD_S = threading.TIMEOUT_MAX
_NOTABLE = controller_program.NOTABLE_SHARE, controller_program.NOTABLE_MS
controller_program.NOTABLE_SHARE, controller_program.NOTABLE_MS = 1.0, math.inf

# Restore both signals: a suite in a shell's background job ignores SIGINT, one under nohup ignores
# SIGHUP, and all processes that it starts would inherit this.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_report_header():
    ready = (
        'ready'
        if can_compile() and has_kept_code()
        else 'the first tests compile it, in about a minute'
    )
    return f'compiled code: {ready}'


@pytest.fixture
def slow_ticks_are_told(monkeypatch):
    """Let this process tell of slow ticks, as outside the tests."""
    for name, value in zip(('NOTABLE_SHARE', 'NOTABLE_MS'), _NOTABLE, strict=True):
        monkeypatch.setattr(controller_program, name, value)


@pytest.fixture(scope='session')
def needs_browser():
    """Skip without a browser; end the one that the tests share."""
    pytest.importorskip('viser', reason='the extra viewer is not installed')
    pytest.importorskip('playwright')
    try:
        browser_program()
    except ViewerError as error:
        pytest.skip(str(error))
    yield
    from browsing import close_shared_browser

    close_shared_browser()


@pytest.fixture
def command():
    """Run the command in this process; return exit status, standard output and standard error."""

    def run(*arguments):
        done = call(*arguments)
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.fixture
def domain():
    with free_domain() as number:
        yield number


@pytest.fixture
def start_run(domain):
    """Start `ballbot run`; its remaining processes are ended after the test."""
    with contextlib.ExitStack() as stack:

        def start(*arguments, **popen):
            run = Run(domain, *arguments, **popen)
            stack.callback(run.kill)
            return run

        yield start


@pytest.fixture(scope='session')
def fork_client():
    with ForkClient() as client:
        yield client


@pytest.fixture
def start_node(domain, fork_client):
    """Start a node alone, as a fork; it is ended after the test."""
    with contextlib.ExitStack() as stack:

        def start(name, **values):
            node = Node.fork(fork_client, domain, name, **values)
            stack.callback(node.kill)
            return node

        yield start


@pytest.fixture
def run_node(domain):
    """Start a node alone, as `ros2 run` does; it is ended after the test."""
    with contextlib.ExitStack() as stack:

        def run(name, **values):
            node = Node.run(domain, name, **values)
            stack.callback(node.kill)
            return node

        yield run
