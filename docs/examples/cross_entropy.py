"""Learn to balance by the cross-entropy method, in some seconds.

Each generation draws weights from a normal distribution, lets each of them balance for an episode,
and fits the distribution to those with the largest returns. It starts from weights around zero. One
call moves the robots of a whole generation.

python docs/examples/cross_entropy.py --output policy.yaml
"""

import argparse
import time
from dataclasses import astuple, fields
from pathlib import Path

import gymnasium
import numpy as np
from learned_policy import LearnedPolicy, Weights

NAMES = [each.name for each in fields(Weights)]


def returns_of(candidates, seed, profile, duration):
    """Return the sum of the rewards in an episode of each candidate; all have the same start."""
    name = 'ballbot_ros.environments:ballbot_ros/Balance-v0'
    count = len(candidates)
    robots = gymnasium.make_vec(name, num_envs=count, profile=profile, duration=duration)
    # The policy computes in columns, one number for each robot.
    policy = LearnedPolicy(Weights(*candidates.T)).make_policy()
    observations, _ = robots.reset(seed=[seed] * count)
    returns, is_on = np.zeros(count), np.ones(count, bool)
    while is_on.any():
        actions = np.stack(policy(observations.T), axis=1)
        observations, rewards, terminated, truncated, _ = robots.step(actions)
        returns += rewards * is_on
        is_on &= ~(terminated | truncated)
    return returns


def learn(generations, population, profile, duration, seed):
    """Return the weights after some generations; the same seed gives the same weights."""
    generator, elite, stands = np.random.default_rng(seed), population // 5, False
    mean, deviation = np.zeros(len(NAMES)), np.full(len(NAMES), 0.3)
    for generation in range(1, generations + 1):
        # As long as nearly all fall, episodes are short: try more of them.
        count = population if stands else 4 * population
        candidates = generator.normal(mean, deviation, (count, len(NAMES)))
        returns = returns_of(candidates, seed + generation, profile, duration)
        best = candidates[np.argsort(-returns, kind='stable')[:elite]]
        share = np.sort(returns)[::-1] / (250.0 * duration)
        mean = best.mean(axis=0)
        deviation = 0.7 * best.std(axis=0) + 0.3 * deviation
        stands = stands or share[elite - 1] > 0.5
        print(
            f'generation {generation:2}: mean reward {share[0]:.3f} best, '
            f'{share[elite - 1]:.3f} elite, {np.median(share):.3f} median',
            flush=True,
        )
    return Weights(*mean.tolist())


def parameter_text(weights):
    """Return a parameter file for `ballbot run --params`."""
    lines = [
        f'    user.{name}: {value!r}' for name, value in zip(NAMES, astuple(weights), strict=True)
    ]
    return '\n'.join(['/**/controller:', '  ros__parameters:', *lines, ''])


def main():
    """Learn, and write the parameter file."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--output', type=Path, default=Path('policy.yaml'))
    parser.add_argument('--generations', type=int, default=10)
    parser.add_argument('--population', type=int, default=40)
    parser.add_argument('--duration', type=float, default=6.0, help='of an episode [s]')
    parser.add_argument('--profile', default='hardware')
    parser.add_argument('--seed', type=int, default=1)
    options = parser.parse_args()
    begun = time.monotonic()
    weights = learn(
        options.generations, options.population, options.profile, options.duration, options.seed
    )
    options.output.write_text(parameter_text(weights), encoding='utf-8')
    print(f'{options.output}: {weights} after {time.monotonic() - begun:.0f} s')


if __name__ == '__main__':
    main()
