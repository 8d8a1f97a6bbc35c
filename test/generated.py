"""Applications generated and built for tests, and their parameters."""

import json
import random
import shutil
import subprocess
from pathlib import Path

import pytest
from parts import values_of

from ballbot_ros.controllers.codegen.application import read_tasks, write_application
from ballbot_ros.controllers.codegen.implementation import compose_controller
from ballbot_ros.controllers.codegen.programs import program_of
from ballbot_ros.controllers.codegen.toolchain import TARGETS, build, missing_tool
from ballbot_ros.parameters import CONTROLLER, ControllerParameters, ParameterSet


class Built:
    """The application for some parameters, built for a target."""

    def __init__(self, parameters, target, folder, flags=()):
        self.parameters = parameters
        self.folder, self.scratch = folder / 'application', folder / 'build'
        write_application(self.folder, parameters)
        self.tasks = read_tasks(self.folder)
        self.command = build(self.folder, TARGETS[target], self.scratch, flags)

    def program(self):
        return program_of(self.parameters).start(self.command, self.tasks, self.parameters)


def commissioning(**user):
    """Return controller parameters for the commissioning program, with some of its own."""
    parameters = ParameterSet()
    parameters.set(CONTROLLER, 'implementation', 'commissioning')
    for name, value in user.items():
        parameters.set(CONTROLLER, f'user.{name}', value)
    compose_controller(parameters)
    return parameters.of(ControllerParameters)


SHORT = {
    'pause_time': 0.02, 'rest_time': 0.1, 'port_time': 0.024, 'step_time': 0.004,
    'play_time': 0.012, 'play_pulses': 9, 'tilt_time': 0.04,
}  # fmt: skip
"""Durations of a commissioning program that ends soon, after 2.1 s."""


def branch_counts(made, source):
    """Return the execution count of each branch of a source, by line and number."""
    done = subprocess.run(
        ['gcov', '--json-format', '--stdout', '-b', source.replace('.c', '.o')],
        cwd=made.scratch, capture_output=True, text=True, check=True,
    )  # fmt: skip
    files = json.loads(done.stdout)['files']
    [file] = [file for file in files if Path(file['file']).name == source]
    return {
        (source, line['line_number'], number): branch['count']
        for line in file['lines']
        for number, branch in enumerate(line['branches'])
    }


def need(target):
    if reason := missing_tool(TARGETS[target]):
        pytest.skip(reason)


def need_command(command, package):
    if shutil.which(command) is None:
        pytest.skip(f'{command} not found: install it with `apt install {package}`')


def random_values(seed):
    """Return random controller parameters over their full ranges, but with short times."""
    draw = random.Random(seed)
    coefficient = lambda: draw.choice((0.0, 1.0, draw.random()))  # noqa: E731
    return values_of(
        CONTROLLER,
        mode=draw.choice(('remote', 'autonomous')),
        k_f=[draw.gauss(0.0, scale) for scale in (0.02, 2.0, 0.03, 0.3)],
        k_i=draw.gauss(0.0, 0.01),
        k_thetadot=draw.uniform(0.0, 1000.0),
        **{name: coefficient() for name in ('a_b', 'a_d', 'a_r', 'a_gc', 'a_gd')},
        pwm_gain=draw.choice((0.0, 1.0, draw.uniform(0.0, 100.0))),
        pwm_offset=draw.choice((0.0, draw.uniform(0.0, 20.0))),
        dst_thr=draw.choice((-1, 0, 30, 255)),
        sonar_hold=draw.choice((0, 40, 60000)),
        gp_max=draw.choice((1, 100, 127)),
        time_start=draw.choice((0, 20, 100)),
        time_auto=draw.choice((0, 100, 2**32 - 1)),
        time_stop=draw.choice((0, 100, 100, 400, 2**32 - 1)),
        theta_diff_thr=draw.choice((100.0, 600.0, 1e6)),
        psi_diff_thr=draw.choice((5.0, 15.0, 180.0)),
        sound_freq=draw.randint(31, 14080),
        sound_dur=draw.choice((0, 100, 65535)),
        sound_volume=draw.randint(0, 100),
        tone_gain=draw.choice((0, 1, 55)),
        log_count=draw.choice((1, 2, 25, 255)),
        log_content=('pitch', 'duties', 'duties_and_gyros')[seed % 3],
        ts2_period=draw.choice((20, 20, 4, 100)),
        ts3_period=draw.choice((100, 100, 4, 20)),
        lsb=draw.choice((2.0**-10, 1e-9, 1e3)),
        wheel_radius=draw.uniform(0.001, 1.0),
        ball_radius=draw.uniform(0.001, 1.0),
    )
