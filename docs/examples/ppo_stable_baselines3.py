"""Learn to balance by PPO of stable-baselines3, with many robots at once.

pip install stable-baselines3
python docs/examples/ppo_stable_baselines3.py --output network.yaml
"""

import argparse
import time
from pathlib import Path

import gymnasium
import numpy as np
import torch
from network_policy import FEATURES, Plane, estimated, features
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from ballbot_ros.parameters import PlantParameters
from ballbot_ros.robot.plant.model import PhysicalParameters

WHEEL_PER_BALL = 1.0 / PhysicalParameters.from_parameters(PlantParameters()).ratio
UNITS = 16
GAMMA = 0.99


class Planes(VecEnv):
    """The planes of all robots, first x of each, then y: one network balances them all."""

    def __init__(self, robots, duration):
        self.robots = gymnasium.make_vec(
            'ballbot_ros.environments:ballbot_ros/Balance-v0',
            num_envs=robots,
            step_ms=20,
            profile='hardware',
            duration=duration,
            parameters={'plant_sim.fall_angle': 0.3},  # the episode of a falling robot ends early
            autoreset_mode='SameStep',
        )
        inputs = gymnasium.spaces.Box(-np.inf, np.inf, (FEATURES,), np.float32)
        super().__init__(2 * robots, inputs, gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32))

    def reset(self):
        """Begin the first episodes."""
        observations, _ = self.robots.reset(seed=self._seeds[0])
        self.planes = estimate(Plane(), observations)
        return inputs_of(self.planes)

    def step_async(self, actions):
        """Keep the actions."""
        self.actions = actions.reshape(2, -1).T

    def step_wait(self):
        """Move the robots; those whose episode ends begin another one."""
        observations, rewards, terminated, truncated, infos = self.robots.step(self.actions)
        over, lasts = terminated | truncated, observations.copy()
        if over.any():
            lasts[over] = np.stack(infos['final_obs'][over])
        planes, begun = estimate(self.planes, lasts), estimate(Plane(), observations)
        over, truncated = np.tile(over, 2), np.tile(truncated & ~terminated, 2)
        notes, last_inputs = [{} for _ in over], inputs_of(planes)
        for at in np.flatnonzero(over):
            notes[at]['terminal_observation'] = last_inputs[at]
            notes[at]['TimeLimit.truncated'] = bool(truncated[at])
        pairs = zip(begun, planes, strict=True)
        self.planes = Plane(*(np.where(over, new, old) for new, old in pairs))
        return inputs_of(self.planes), np.tile(rewards, 2).astype(np.float32), over, notes

    def close(self):
        """Close the environment of the robots."""
        self.robots.close()

    def get_attr(self, attr_name, indices=None):
        """Return an attribute of each plane."""
        return [getattr(self.robots, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name, value, indices=None):
        """Refuse: the planes have no attributes of their own."""
        raise NotImplementedError

    def env_method(self, method_name, *arguments, indices=None, **options):
        """Refuse: the planes have no methods of their own."""
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class, indices=None):
        """Return that no plane is in a wrapper."""
        return [False for _ in self._get_indices(indices)]


def estimate(planes, observations):
    """Return the estimates of all planes after an observation of each robot."""
    rates, encoders = observations[:, 0:2].T.ravel(), observations[:, 2:4].T.ravel()
    return estimated(planes, WHEEL_PER_BALL, rates, encoders)


def inputs_of(planes):
    """Return the inputs of the network for each plane."""
    return np.stack(features(planes), axis=1).astype(np.float32)


def main():
    """Learn, and write the parameter file."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--output', type=Path, default=Path('network.yaml'))
    parser.add_argument('--steps', type=int, default=6_000_000, help='of all planes')
    parser.add_argument('--robots', type=int, default=64)
    parser.add_argument('--duration', type=float, default=20.0, help='of an episode [s]')
    parser.add_argument('--seed', type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(1)
    begun = time.monotonic()
    # Rewards of a common size: the losses of policy and value share a limit of the gradient.
    planes = VecNormalize(Planes(options.robots, options.duration), norm_obs=False, gamma=GAMMA)
    model = PPO(
        'MlpPolicy', planes, seed=options.seed, device='cpu', verbose=1,
        n_steps=32, batch_size=512, n_epochs=8, gamma=GAMMA,
        learning_rate=lambda remaining: 2e-3 * remaining,
        policy_kwargs={
            'net_arch': {'pi': [UNITS], 'vf': [64, 64]},
            'activation_fn': torch.nn.Softsign, 'log_std_init': -1.0,
        },
    )  # fmt: skip
    model.learn(options.steps, log_interval=50)
    weights = [
        value
        for layer in (model.policy.mlp_extractor.policy_net[0], model.policy.action_net)
        for tensor in (layer.weight, layer.bias)
        for value in tensor.detach().double().flatten().tolist()
    ]
    text = f'/**/controller:\n  ros__parameters:\n    user.weights: {weights}\n'
    options.output.write_text(text, encoding='utf-8')
    print(f'{options.output}: {len(weights)} weights after {time.monotonic() - begun:.0f} s')


if __name__ == '__main__':
    main()
