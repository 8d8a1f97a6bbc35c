"""Applications generated and built for tests, and their parameters."""

import random
import shutil

import pytest
from parts import values_of

from ballbot_ros.controllers.codegen.application import read_tasks, write_application
from ballbot_ros.controllers.codegen.compiled_program import BrickProcess, CompiledProgram
from ballbot_ros.controllers.codegen.toolchain import TARGETS, build, missing_tool
from ballbot_ros.parameters import CONTROLLER


class Built:
    """The application for some parameters, built for a target."""

    def __init__(self, parameters, target, folder, flags=()):
        self.parameters = parameters
        self.folder, self.scratch = folder / 'application', folder / 'build'
        write_application(self.folder, parameters)
        self.tasks = read_tasks(self.folder)
        self.command = build(self.folder, TARGETS[target], self.scratch, flags)

    def program(self):
        machine = BrickProcess(self.command)
        return CompiledProgram(machine.exchange, self.tasks, self.parameters.mode == 'autonomous')


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
