"""A recorded run with all that one can have, for tests of its branches."""

from ballbot_ros.run.observer import LogObserver
from ballbot_ros.run.offline import run_offline
from ballbot_ros.run.requirements import Processes
from ballbot_ros.run.spec import RunOptions, RunSpec

EVENTFUL = """
purpose: has all that a recorded run can have
duration: 4.5
seed: 3
profile: hardware
sticks:
  vertical:
    - {name: forward, from: 1.5, to: 2.3, value: -100}
    - {name: ramp, points: [[2.6, -77], [3.4, 31], [3.4, 50], [4, 0]]}
  horizontal:
    - {name: right, from: 1.21, value: 41.5}
pushes:
  - {time: 2, duration: 0.1, force: 0.5, direction: 33}
  - {time: 3, duration: 0.05, force: [0.3, -0.2], torque: [0.01, 0]}
changes:
  - {time: 1.7, controller.k_thetadot: 300}
  - {time: 3.3, controller.k_i: -0.008, controller.dst_thr: 40}
"""


def run(spec, recording):
    return run_offline(spec, recording, LogObserver())


def recorded(folder, text, name='parent'):
    path = folder / f'{name}.yaml'
    path.write_text(text)
    recording = folder / f'{name}.mcap'
    run(RunSpec.of_scenario(str(path), RunOptions(processes=Processes.NONE)), recording)
    return recording
