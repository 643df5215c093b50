"""Measure the vectorised environment, and train PPO of stable-baselines3 on it for one minute.

``python tests/benchmarks/unknown_grid/learner.py [--seconds 60]`` prints the steps per second of the environment beside
a ``SyncVectorEnv`` of single environments, and then the share of targets reached by the learner before and after the
training. It needs gymnasium, stable-baselines3 and PyTorch.
"""

import argparse
import time

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from crosstrack.instances.unknown_grid import draw_scenes
from crosstrack.solvers.unknown_grid.registration import ID, register


class Adapted(VecEnv):
    """Interface of stable-baselines3 to the vectorised environment, with the map around the vehicle as numbers."""

    def __init__(self, model, count):
        self.env = gymnasium.make_vec(ID, num_envs=count, model=model, autoreset_mode="SameStep")
        self.reach = int(max(model.shape)) - 1
        side = 2 * self.reach + 1
        space = gymnasium.spaces.Box(-1, 2, (side * side + 2,), np.float32)
        super().__init__(count, space, gymnasium.spaces.Discrete(4))

    def _flat(self, seen):
        maps = seen["map"].astype(np.float32)
        around = np.pad(maps, ((0, 0), (self.reach,) * 2, (self.reach,) * 2), constant_values=1)
        windows = np.lib.stride_tricks.sliding_window_view(
            around, (2 * self.reach + 1,) * 2, axis=(1, 2)
        )
        rows, columns = seen["position"].T
        flat = windows[np.arange(len(maps)), rows, columns].reshape(len(maps), -1)
        away = (seen["target"] - seen["position"]) / self.reach
        return np.concatenate([flat, away], axis=1).astype(np.float32)

    def reset(self):
        return self._flat(self.env.reset(seed=0)[0])

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        seen, rewards, terminated, truncated, told = self.env.step(self.actions)
        infos = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(terminated | truncated):
            final = {name: array[None] for name, array in told["final_obs"][row].items()}
            infos[row] = {
                "terminal_observation": self._flat(final)[0],
                "TimeLimit.truncated": bool(truncated[row]),
            }
        return self._flat(seen), rewards, terminated | truncated, infos

    def close(self):
        self.env.close()

    def get_attr(self, name, indices=None):
        return [getattr(self.env, name, None)] * self.num_envs

    def set_attr(self, name, value, indices=None):
        setattr(self.env, name, value)

    def env_method(self, name, *args, indices=None, **kwargs):
        return [getattr(self.env, name)(*args, **kwargs)] * self.num_envs

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False] * self.num_envs


class Until(BaseCallback):
    """Callback that stops the training after some seconds."""

    def __init__(self, seconds):
        super().__init__()
        self.end = time.perf_counter() + seconds

    def _on_step(self):
        return time.perf_counter() < self.end


def rate(model, count, mode, steps):
    """Return the steps per second of random actions."""
    env = gymnasium.make_vec(ID, num_envs=count, vectorization_mode=mode, model=model)
    env.reset(seed=0)
    generator = np.random.default_rng(0)
    begin = time.process_time()
    for _ in range(steps):
        env.step(generator.integers(0, 4, count))
    return count * steps / (time.process_time() - begin)


def success(model, learner, episodes=400):
    """Return the share of targets reached, percent."""
    env = Adapted(model, 100)
    seen, reached, ended = env.reset(), 0, 0
    while ended < episodes:
        actions = learner.predict(seen, deterministic=False)[0]
        seen, _, done, infos = env.step(actions)
        ended += int(done.sum())
        reached += sum(done[k] and not infos[k]["TimeLimit.truncated"] for k in range(100))
    return 100.0 * reached / ended


def main():
    """Print the rates and the success of the learner."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    register()
    scenes = draw_scenes("walls", shape=(17, 17), obstacles=3, scenes=400, seed=1, view=(5, 5))
    for count in (1, 64, 1000):
        steps = max(40, 2000 // count)
        native = rate(scenes, count, None, steps)
        single = rate(scenes, count, "sync", max(steps // 10, 4))
        print(
            f"{count:5} environments: {native:9.0f} steps per CPU second, sync {single:7.0f}, "
            f"ratio {native / single:.1f}",
            flush=True,
        )
    training, test = (
        draw_scenes(
            "walls", shape=(9, 9), obstacles=(0, 2), scenes=400, seed=seed, view=(5, 5), steps=30
        )
        for seed in (1, 2)
    )
    learner = PPO(
        "MlpPolicy", Adapted(training, 64), n_steps=64, batch_size=1024, seed=0, device="cpu"
    )
    before = success(test, learner)
    learner.learn(10**9, callback=Until(seconds))
    print(
        f"PPO, {learner.num_timesteps} steps in {seconds:g} s: targets reached in test scenes "
        f"{before:.1f} % before, {success(test, learner):.1f} % after"
    )


if __name__ == "__main__":
    main()
