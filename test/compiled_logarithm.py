"""A small function that another process can compile, for tests."""

from ballbot_ros.engine.compilation import compiled_and_kept
from ballbot_ros.robot.arithmetic import natural_log


def compile_logarithm():
    compiled_and_kept(natural_log)(2.0)
