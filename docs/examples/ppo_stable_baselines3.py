"""Learn to balance by PPO of stable-baselines3.

pip install stable-baselines3
python docs/examples/ppo_stable_baselines3.py --output network.yaml
"""

import argparse
import time
from pathlib import Path

import gymnasium
import numpy as np
import torch
from network_policy import SIZES, Features
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from ballbot_ros.parameters import PlantParameters
from ballbot_ros.robot.plant.model import PhysicalParameters

RATIO = PhysicalParameters.from_parameters(PlantParameters()).ratio


class EstimatedFeatures(gymnasium.ObservationWrapper):
    """Observes the features that the controller estimates."""

    def __init__(self, env):
        super().__init__(env)
        self.observation_space = gymnasium.spaces.Box(-5.0, 5.0, (SIZES[0],), np.float32)

    def reset(self, **arguments):
        """Begin an episode with new estimates."""
        self.features = Features(RATIO)
        return super().reset(**arguments)

    def observation(self, observation):
        """Return the features."""
        return self.features.update(observation).astype(np.float32)


def make():
    """Return the environment of a worker."""
    return EstimatedFeatures(
        gymnasium.make(
            'ballbot_ros.environments:ballbot_ros/Balance-v0',
            step_ms=20,
            profile='hardware',
            parameters={'plant_sim.fall_angle': 0.3},  # the episode of a falling robot ends early
        )
    )


def main():
    """Learn, and write the parameter file."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--output', type=Path, default=Path('network.yaml'))
    parser.add_argument('--steps', type=int, default=400_000)
    parser.add_argument('--seed', type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(1)
    begun = time.monotonic()
    environments = make_vec_env(make, 4, seed=options.seed)
    model = PPO(
        'MlpPolicy', environments, seed=options.seed, device='cpu', verbose=1,
        n_steps=1024, batch_size=256, gamma=0.98, gae_lambda=0.9,
        learning_rate=lambda remaining: 1e-3 * remaining,
        policy_kwargs={'net_arch': list(SIZES[1:-1]), 'log_std_init': -1.0},
    )  # fmt: skip
    model.learn(options.steps)
    policy = model.policy
    layers = [each for each in policy.mlp_extractor.policy_net if isinstance(each, torch.nn.Linear)]
    weights = [
        value
        for layer in (*layers, policy.action_net)
        for tensor in (layer.weight, layer.bias)
        for value in tensor.detach().double().flatten().tolist()
    ]
    text = f'/**/controller:\n  ros__parameters:\n    user.weights: {weights}\n'
    options.output.write_text(text, encoding='utf-8')
    print(f'{options.output}: {len(weights)} weights after {time.monotonic() - begun:.0f} s')


if __name__ == '__main__':
    main()
