"""Learn to balance by PPO of stable-baselines3, in a minute or two.

Both planes share a network, so each robot is two agents. One call moves all robots.

pip install stable-baselines3
python docs/examples/ppo_stable_baselines3.py --output network.yaml
"""

import argparse
import time
from pathlib import Path

import gymnasium
import numpy as np
import torch
from network_policy import ESTIMATES, SIZES, estimate
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from ballbot_ros.parameters import PlantParameters
from ballbot_ros.robot.plant.model import PhysicalParameters

WHEEL_PER_BALL = 1.0 / PhysicalParameters.from_parameters(PlantParameters()).ratio
ROBOTS = 64
# The robot's way back to its place takes seconds, so rewards count for four (1000 steps).
GAMMA = 0.999


class Planes(VecEnv):
    """The planes of many robots, each of them an agent that observes estimated features."""

    def __init__(self):
        self.robots = gymnasium.make_vec(
            'ballbot_ros.environments:ballbot_ros/Balance-v0',
            num_envs=ROBOTS,
            profile='hardware',
            duration=6.0,
            parameters={'plant_sim.fall_angle': 0.3},  # the episode of a falling robot ends early
            autoreset_mode='SameStep',
        )
        self.estimates = np.zeros((ESTIMATES, ROBOTS, 2))
        features = gymnasium.spaces.Box(-5.0, 5.0, (SIZES[0],), np.float32)
        super().__init__(2 * ROBOTS, features, gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32))

    def reset(self):
        """Begin an episode of each robot."""
        observations, _ = self.robots.reset(seed=self._seeds[0])
        self.estimates[:] = 0.0
        return self.observe(observations)

    def step_async(self, actions):
        """Take the actions of all planes."""
        self.actions = actions.reshape(ROBOTS, 2).astype(float)

    def step_wait(self):
        """Move all robots; a robot whose episode has ended begins the next one."""
        observations, _, terminated, truncated, info = self.robots.step(self.actions)
        ended = terminated | truncated
        state, duty = info['state'].copy(), info['duty_percent'].copy()
        infos = [{} for _ in range(self.num_envs)]
        if ended.any():
            final, last = info['final_info'], observations.copy()
            state[ended], duty[ended] = final['state'][ended], final['duty_percent'][ended]
            last[ended] = np.stack(info['final_obs'][ended])
            features = self.observe(last, keep=False)
            for plane in np.flatnonzero(np.repeat(ended, 2)):
                infos[plane]['terminal_observation'] = features[plane]
                infos[plane]['TimeLimit.truncated'] = not terminated[plane // 2]
            self.estimates[:, ended] = 0.0
        features = self.observe(observations)
        return features, reward(state, duty), np.repeat(ended, 2), infos

    def observe(self, observations, keep=True):
        """Return the features of all planes; `keep` the new estimates for the next ones."""
        estimates, features = estimate(self.estimates, observations, WHEEL_PER_BALL)
        if keep:
            self.estimates = estimates
        return features.reshape(self.num_envs, -1).astype(np.float32)

    def close(self):
        """Close the environment of the robots."""
        self.robots.close()

    def get_attr(self, attr_name, indices=None):
        """Return None for each: the planes are no environments of their own."""
        return [None] * self.num_envs

    def env_is_wrapped(self, wrapper_class, indices=None):
        """Return that no plane has a wrapper."""
        return [False] * self.num_envs

    def set_attr(self, attr_name, value, indices=None):
        """Raise AttributeError: there is nothing to set."""
        raise AttributeError(attr_name)

    def env_method(self, method_name, *method_args, indices=None, **method_kwargs):
        """Raise AttributeError: there is nothing to call."""
        raise AttributeError(method_name)


def reward(state, duty):
    """Return the reward of each plane: as in the environment, but with 2 cm instead of 5 cm.

    The duty counts half as much as there. Rewards are scaled so that an episode adds up to about 1:
    the length of the gradient is limited, and with large rewards it is mostly that of the value
    function.
    """
    position, pitch = state[:, 0:2], state[:, 4:6]
    upright = 1.0 / (1.0 + (pitch / 0.035) ** 2)
    near = 1.0 / (1.0 + (position / 0.02) ** 2)
    calm = 1.0 / (1.0 + (duty / 30.0) ** 2)
    rewards = (1.0 - GAMMA) * (0.4 * upright + 0.4 * near + 0.1 * calm)
    return rewards.ravel().astype(np.float32)


def main():
    """Learn, and write the parameter file."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--output', type=Path, default=Path('network.yaml'))
    parser.add_argument('--steps', type=int, default=6_000_000, help='of all planes together')
    parser.add_argument('--seed', type=int, default=3)
    options = parser.parse_args()
    torch.set_num_threads(1)
    begun = time.monotonic()
    model = PPO(
        'MlpPolicy', VecMonitor(Planes()), seed=options.seed, device='cpu', verbose=1,
        n_steps=512, batch_size=4096, n_epochs=6, gamma=GAMMA, gae_lambda=0.99, ent_coef=0.003,
        learning_rate=lambda remaining: 1e-3 * remaining,
        policy_kwargs={'net_arch': {'pi': SIZES[1:-1], 'vf': [64, 64]}, 'log_std_init': -1.0},
    )  # fmt: skip
    model.learn(options.steps, log_interval=10)
    policy = model.policy
    layers = [each for each in policy.mlp_extractor.policy_net if isinstance(each, torch.nn.Linear)]
    weights = [
        value
        for layer in (*layers, policy.action_net)
        for tensor in (layer.weight, layer.bias)
        for value in tensor.detach().flatten().tolist()
    ]
    text = f'/**/controller:\n  ros__parameters:\n    user.weights: {weights}\n'
    options.output.write_text(text, encoding='utf-8')
    print(f'{options.output}: {len(weights)} weights after {time.monotonic() - begun:.0f} s')


if __name__ == '__main__':
    main()
