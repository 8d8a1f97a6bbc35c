"""Judge answers to the tasks of the lessons, by simulating or computing with them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import control
import numpy as np
import yaml
from scipy.signal import periodogram
from scipy.stats import binomtest

import ballbot_ros as bb

Verdict = tuple[bool, str]
DEAD_TIME = 'plant_sim.actuator_delay'


def _gains(name: str) -> dict[str, Any]:
    """Return gains of `config/gains`, and the filter of the speed; others matter for driving."""
    path = Path(__file__).parents[2] / f'config/gains/{name}.yaml'
    gains = yaml.safe_load(path.read_text())['/**/controller']['ros__parameters']
    return {each: gains[each] for each in ('k_f', 'k_i', 'a_d')}


_DOCUMENT = _gains('document')
DOCUMENT, QUIET = (
    {f'controller.{name}': value for name, value in gains.items()}
    for gains in (_DOCUMENT, _gains('quiet'))
)
NO_TIME = {'plant_sim.kernel': False, 'plant_sim.link': False}
"""The brick computes in no time, and its gyros and motors are up to date."""
STUDY: dict[str, Any] = {  # that of lesson 4, with the gain of its task
    'scenario': 'hardware_standing',
    'parameters': {
        'plant_sim': {'duration': 10.0, 'kernel': False, 'link': False},
        'controller': {**_DOCUMENT, 'pwm_gain': 0.85},
    },
    'vary': {
        'plant_sim.body_mass': {'uniform': [0.5, 0.9]},
        'plant_sim.body_height': {'uniform': [0.12, 0.22]},
        'gyro_driver.noise': {'uniform': [0.0, 2.0]},
    },
    'expectations': {'peak_pitch_deg': {'max': 3.0}, 'duty_rms_percent': {'max': 20.0}},
}


def check(lesson: int, answer: Any) -> None:
    """Print whether the answer to the task of a lesson is right, and how it was judged."""
    if answer is None:
        print(f'lesson {lesson}: no answer yet')
    else:
        right, explanation = judge(lesson, answer)
        print(f'lesson {lesson}: {"right" if right else "wrong"}: {explanation}')


def judge(lesson: int, answer: Any) -> Verdict:
    """Return whether an answer is right, and how that was judged; for example to grade it."""
    try:
        return JUDGES[lesson](answer)
    except (bb.BallbotError, TypeError, ValueError) as error:
        return False, f'{answer!r} cannot be judged: {error}'


def _largest_pitch(answer: float) -> Verdict:
    for pitch, expected in (answer - 0.5, True), (answer + 0.5, False):
        run = bb.simulate(parameters={'plant_sim.start_pitch_x': float(np.radians(pitch))})
        if (run.metrics['settling_time_s'] < np.inf) != expected:
            does = 'does not recover' if expected else 'still recovers'
            return False, f'a robot that starts at {pitch:g}° {does}'
    return True, f'it recovers from {answer - 0.5:g}°, and not from {answer + 0.5:g}°'


def _ringing_frequency(answer: float) -> Verdict:
    frame = bb.simulate(parameters={DEAD_TIME: 4}).frame()
    frequency, power = periodogram(frame['duty_x_percent'].loc[1.0:], fs=250.0, window='hann')
    error = answer - frequency[power.argmax()]
    how = 'the largest peak of a run with 4 ms of dead time, from 1 s on'
    if abs(error) <= 2.0:
        return True, f'within 2 Hz of {how}'
    return False, f'{answer:g} Hz is too {"high" if error > 0 else "low"} for {how}'


def _calm_gains(answer: Mapping[str, object]) -> Verdict:
    if others := sorted(set(answer) - {'controller.k_f', 'controller.pwm_gain'}):
        return False, f'change only k_f and pwm_gain, not {others[0]}'
    for delay in range(6):
        loop = control.feedback(bb.sampled_loop({**answer, DEAD_TIME: delay}))
        if abs(loop.poles()).max() >= 1.0:
            return False, f'the sampled loop is unstable with {delay} ms of dead time'
    runs = {name: bb.simulate(name, parameters=answer) for name in ('stationary', 'push')}
    for name, run in runs.items():
        if not run.passed:
            return False, f'{name} does not pass: {run.reason}'
    if (duty := runs['stationary'].metrics['duty_rms_percent']) > 13.0:
        return False, f'the duty RMS in stationary is {duty:.1f} %, more than 13 %'
    return True, 'stable with 0 to 5 ms of dead time, a calm duty, both scenarios pass'


@cache
def _passed_share() -> tuple[float, float]:
    """Return the interval of the share that passes the study of lesson 4 [%], of other robots."""
    passed = bb.study(STUDY, runs=2000, seed=1001)['passed']
    low, high = binomtest(int(passed.sum()), len(passed)).proportion_ci(method='wilson')
    return 100.0 * low, 100.0 * high


def _share_of_robots(answer: tuple[float, float]) -> Verdict:
    low, high = answer
    if not 0.0 < high - low <= 4.0:
        return False, f'{low:g} to {high:g} is not an interval of at most 4 points'
    own_low, own_high = _passed_share()
    if low > own_high or high < own_low:
        side = 'high' if low > own_high else 'low'
        return False, f'too {side}: it does not meet the interval of 2000 other robots'
    return True, f'it meets that of 2000 other robots, {own_low:.1f} to {own_high:.1f} %'


def _largest_dead_time(answer: float) -> Verdict:
    for delay, expected in (max(0, round(answer) - 4), True), (round(answer) + 4, False):
        parameters = QUIET | {DEAD_TIME: delay, 'plant_sim.duration': 15.0}
        runs = [bb.simulate('hardware_standing', seed=i, parameters=parameters) for i in range(3)]
        if all(run.passed for run in runs) != expected:
            share = 'not all' if expected else 'all'
            return False, f'with {delay} ms {share} of seeds 0, 1 and 2 pass'
    return True, f'all three seeds pass with 4 ms less, and not with {delay} ms'


JUDGES: dict[int, Callable[[Any], Verdict]] = {
    1: _largest_pitch, 2: _ringing_frequency, 3: _calm_gains,
    4: _share_of_robots, 5: _largest_dead_time,
}  # fmt: skip
