import contextlib
import os
import signal
import sys
import time

import pytest
from graph import Node, Run, free_domain

from ballbot_ros.cli.main import main
from ballbot_ros.nodes.middleware import prepare_middleware
from ballbot_ros.nodes.shared_memory import SETTLED_S, find_leftovers, sweep
from ballbot_ros.viewer.browser import browser_program
from ballbot_ros.viewer.errors import ViewerError

# The graphs under test are no business of other machines on the network, and what tests make of
# ROS themselves is to be found as soon as the nodes are.
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
prepare_middleware()

# A suite that a shell runs in the background ignores SIGINT, one under nohup SIGHUP, and so would
# all that it starts.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_sessionfinish(session):
    """Leave shared memory without what the processes that tests kill leave there."""
    is_last = not hasattr(session.config, 'workerinput')  # pytest-xdist's workers have ended
    if is_last and find_leftovers(older_than_s=0):
        time.sleep(SETTLED_S)  # what is young may be another graph's that is just beginning
        sweep()


@pytest.fixture(scope='session')
def needs_browser():
    pytest.importorskip('viser', reason='the extra viewer is not installed')
    pytest.importorskip('playwright')
    try:
        browser_program()
    except ViewerError as error:
        pytest.skip(str(error))


@pytest.fixture
def command(monkeypatch, capsys):
    """Run the command in this process; return exit status, standard output and standard error."""

    def run(*arguments):
        monkeypatch.setattr(sys, 'argv', ['ballbot', *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def domain():
    with free_domain() as number:
        yield number


@pytest.fixture
def start_run(domain):
    """Start `ballbot run`; whatever is left of it is ended after the test."""
    with contextlib.ExitStack() as stack:

        def start(*arguments, **popen):
            run = Run(domain, *arguments, **popen)
            stack.callback(run.kill)
            return run

        yield start


@pytest.fixture
def start_node(domain):
    """Start a node on its own; it is ended after the test."""
    with contextlib.ExitStack() as stack:

        def start(name, **parameters):
            node = Node(domain, name, **parameters)
            stack.callback(node.kill)
            return node

        yield start
