"""Driving from a terminal; test/cli/test_drive.py tests what the user sees."""

import subprocess
import sys
from pathlib import Path

import pytest
from graph import LAST_RESORT_S

pytest.importorskip('prompt_toolkit')


def test_a_terminal_that_vanishes_in_the_middle_of_a_line_is_detected():
    program = Path(__file__).with_name('vanishing_terminal.py')
    done = subprocess.run(
        [sys.executable, program],
        start_new_session=True,  # the program gets another controlling terminal
        timeout=LAST_RESORT_S,
        check=True,
        stdout=subprocess.PIPE,
    )
    assert done.stdout == b'gone\n'
