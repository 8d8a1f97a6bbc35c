"""Learn to balance by the cross-entropy method, on two cores in about a minute.

Each generation draws weights from a normal distribution, lets each of them balance for an episode,
and fits the distribution to those with the largest returns. It starts from weights around zero.

python docs/examples/cross_entropy.py --output policy.yaml
"""

import argparse
import multiprocessing
import time
from dataclasses import astuple, fields
from pathlib import Path

import gymnasium
import numpy as np
from learned_policy import LearnedPolicy, Weights

PROCESSES = 2
NAMES = [each.name for each in fields(Weights)]


def episode_return(weights, seed, profile, duration):
    """Return the sum of the rewards of an episode."""
    name = 'ballbot_ros.environments:ballbot_ros/Balance-v0'
    env = gymnasium.make(name, profile=profile, duration=duration)
    policy = LearnedPolicy(Weights(*weights)).make_policy()
    observation, _ = env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        observation, reward, terminated, truncated, _ = env.step(policy(observation.tolist()))
        total += reward
        over = terminated or truncated
    return total


def learn(generations, population, profile, duration, seed):
    """Return the weights after some generations; the same seed gives the same weights."""
    generator, elite, stands = np.random.default_rng(seed), population // 5, False
    mean, deviation = np.zeros(len(NAMES)), np.full(len(NAMES), 0.3)
    # A new process imports this file again, and inherits no thread of the parent.
    with multiprocessing.get_context('spawn').Pool(PROCESSES) as pool:
        for generation in range(1, generations + 1):
            # As long as nearly all fall, episodes are short: try more of them.
            count = population if stands else 4 * population
            candidates = generator.normal(mean, deviation, (count, len(NAMES)))
            tasks = [(each.tolist(), seed + generation, profile, duration) for each in candidates]
            returns = np.array(pool.starmap(episode_return, tasks, chunksize=1))
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
