"""STOP and RUN on the brick: task_init in a program that has run before."""

import parts
from generated import random_values
from hypothesis import strategies as st
from laws import given

from ballbot_ros.controllers.codegen.folder_check import random_steps
from ballbot_ros.controllers.codegen.programs import BALANCE
from ballbot_ros.controllers.document.program import INITIAL_STATE, ControlProgram

INPUTS = (
    'sonar_cm',
    'sonar_reply',
    'sonar_register',
    'battery_mv',
    'waiting_vertical',
    'connected',
)
PLATFORM = {name: getattr(INITIAL_STATE, name) for name in INPUTS}

seeds = st.integers(0, 2**32)


@given(seeds, seeds, seeds, st.integers(1, 150), st.booleans())
def test_a_restarted_program_equals_a_new_one(parameters, past, future, ticks, wild):
    values = random_values(parameters)
    used, fresh = ControlProgram(values), ControlProgram(values)
    for step in random_steps(past, ticks, out_of_range=wild):
        parts.tick(used, *step)
    # A restart clears the memory of the platform, but not that of the program.
    used.state = used.state._replace(**PLATFORM)
    for step in random_steps(future, 50, out_of_range=wild):
        assert parts.tick(used, *step) == parts.tick(fresh, *step)
        assert BALANCE.state_bytes(used) == BALANCE.state_bytes(fresh)
