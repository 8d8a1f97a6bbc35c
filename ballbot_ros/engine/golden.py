"""Golden results, which every machine must reproduce to the bit."""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass

import numpy as np
import yaml

from ballbot_ros.engine.closed_loop import ClosedLoop
from ballbot_ros.engine.scenario.scenario import Scenario
from ballbot_ros.engine.trajectory import TrajectoryLog
from ballbot_ros.errors import BallbotError
from ballbot_ros.files import share_directory
from ballbot_ros.parameters import PlantParameters
from ballbot_ros.robot.arithmetic import natural_log, sine_cosine
from ballbot_ros.robot.plant.integration import zero_order_hold
from ballbot_ros.robot.random_numbers import bits_53, normal, philox4x32, uniform

GOLDEN_FILE = 'config/golden.yaml'
_DRAWS, _SYSTEMS = 5000, 20


@dataclass(frozen=True)
class Golden:
    """Results of :func:`arithmetic_sha256`, and :func:`duty_sha256` of each shipped scenario."""

    arithmetic: str
    scenarios: dict[str, str]


def load_golden() -> Golden:
    """Read the golden results; BallbotError if the file is missing or damaged."""
    path = share_directory() / GOLDEN_FILE
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
        return Golden(str(content['arithmetic']), dict(content['scenarios']))
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError):
        raise BallbotError(f'{path}: missing or damaged') from None


def duty_sha256(scenario: Scenario) -> str:
    """Run a scenario in this process and return its ``duty_sha256``."""
    loop, log = ClosedLoop(scenario.parameters, scenario), TrajectoryLog(keep=False)
    for tick in loop.ticks(scenario.parameters.of(PlantParameters).duration):
        log.add(tick.truth, *tick.outputs.duty)
    return log.duty_sha256


def arithmetic_sha256() -> str:
    """Return a hash of every bit that ``ballbot_ros.robot.arithmetic`` computes from random inputs.

    The control loop damps differences in the last bit, and duties are whole numbers, so the hash
    of a scenario can miss such a difference.
    """
    counters, zero = np.arange(_DRAWS, dtype=np.uint64), np.uint64(0)
    words = philox4x32(counters, zero, zero, zero, zero, zero)
    digest = hashlib.sha256(np.array(words, dtype='<u8').tobytes())
    for bits in bits_53(words.w0, words.w1).tolist():
        number = uniform(bits)
        values = (
            number,
            normal(bits),
            # Smaller numbers, too: most quantiles need no logarithm, only the extreme ones do.
            normal(bits >> (bits % 50)),
            *sine_cosine(4.0 * number - 2.0),
            *sine_cosine(2000.0 * number - 1000.0),
            natural_log(number + 1e-9),
        )
        digest.update(struct.pack('<8d', *values))
    entries = np.array([uniform(bits) - 0.5 for bits in bits_53(words.w2, words.w3).tolist()])
    for number, system in enumerate(entries[: _SYSTEMS * 28].reshape(_SYSTEMS, 4, 7)):
        for matrix in zero_order_hold(system[:, :4] * (number + 1), system[:, 4:], 0.5):
            digest.update(np.ascontiguousarray(matrix, dtype='<f8').tobytes())
    return digest.hexdigest()
