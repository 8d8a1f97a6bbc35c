"""The choice of the control program for a replay, and its reason."""

import pytest

from ballbot_ros import __version__
from ballbot_ros.analysis.recorded_controller import ReplayedController, choose_controller
from ballbot_ros.lockstep.participants import Participant
from ballbot_ros.parameters import CONTROLLER

NO_GCC = 'gcc not found: install it with `apt install gcc`'


def announced(program=f'ballbot_ros {__version__} Controller', **parameters):
    return Participant(
        CONTROLLER, '/controller', 'here', 1, 'a', program, 'b' * 64, parameters=parameters
    )


def chosen(participant=None, attached='python', requested=None, missing=''):
    return choose_controller(
        participant, attached, requested, lambda name: '' if name == 'python' else missing
    )


@pytest.mark.parametrize('name', ['python', 'c', 'arm'])
def test_the_recorded_implementation_is_used_for_the_replay(name):
    same = ReplayedController(name, name)
    assert chosen(attached=name) == same
    assert chosen(announced(implementation=name), attached='python') == same
    assert chosen(announced(), attached=name) == same


def test_python_replaces_an_implementation_that_can_not_run_here():
    found = chosen(attached='c', missing=NO_GCC)
    assert (found.recorded, found.replayed) == ('c', 'python')
    assert NO_GCC in found.reason
    assert chosen(attached='python', missing=NO_GCC).reason == ''


def test_an_implementation_of_a_newer_version_is_named():
    found = chosen(announced('ballbot_ros 99.0 Controller', implementation='rust'))
    assert (found.recorded, found.replayed) == ('rust', 'python')
    assert "does not know its controller 'rust'" in found.reason


@pytest.mark.parametrize('program', ['acme 2.1 Balancer', 'ballbot_ros_fork 1', ''])
def test_a_foreign_controller_is_named(program):
    found = chosen(announced(program, implementation='c'))
    assert (found.recorded, found.replayed) == (program, 'python')
    assert repr(program) in found.reason


def test_a_requested_implementation_needs_no_reason():
    assert chosen(attached='arm', requested='c') == ReplayedController('arm', 'c')
    assert chosen(announced('acme 2.1'), requested='c') == ReplayedController('acme 2.1', 'c')
    assert chosen(attached='arm', requested='python', missing=NO_GCC).reason == ''
