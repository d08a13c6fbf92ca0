"""
Frames per second of PPO, and where the time goes: `python -m benchmarks.ppo_speed --out speed.json`.

In one run: our policy in our worlds; the same policy in Minigrid's worlds, in SB3's DummyVecEnv and SubprocVecEnv;
sb3-contrib's RecurrentPPO with its own LSTM policy around our features extractor, and with ours. All of them with the
level's settings in zoo_configs/ppo.yml; what users type first, one world and SB3's own settings, is in benchmarks.speed.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch as th
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv
from tqdm import tqdm

from sb3_guide.envs import GuideGridVecEnv, level_of, observation_space
from sb3_guide.envs.spaces import DEFAULT_HISTORY
from sb3_guide.envs.vocabulary import encode
from sb3_guide.experiments.stages.configs import algorithm_arguments, load_config
from sb3_guide.files import write_json
from sb3_guide.policies import FiLMExtractor
from sb3_guide.policies.folder import package_versions
from sb3_guide.policies.sizes import size_of


class MinigridWorld(gymnasium.ObservationWrapper):
    """
    Minigrid's level with our observations.

    :param level: name of the level
    :param history: images before the present one
    """

    def __init__(self, level: str, history: int) -> None:
        super().__init__(gymnasium.make(f"BabyAI-{level}-v0", disable_env_checker=True))
        self.observation_space = observation_space(history)
        self.images: deque[np.ndarray] = deque(maxlen=history + 1)

    def reset(self, **kwargs: Any) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        self.images.extend([np.zeros((7, 7, 3), dtype=np.uint8)] * (self.images.maxlen or 1))
        return super().reset(**kwargs)

    def observation(self, observation: dict[str, Any]) -> dict[str, np.ndarray]:
        self.images.append(observation["image"])
        seen = {"image": observation["image"], "mission": encode(observation["mission"])}
        return {**seen, "history": np.stack(list(self.images)[:-1])} if len(self.images) > 1 else seen


def in_minigrid(vec_env_class: type[VecEnv], level: str, n_envs: int, history: int) -> VecEnv:
    """:return: so many of Minigrid's worlds"""

    def make() -> gymnasium.Env:
        import minigrid  # noqa: F401  registers the levels, in a worker too

        return MinigridWorld(level, history)

    start = {} if vec_env_class is DummyVecEnv else {"start_method": "fork"}
    return vec_env_class([make] * n_envs, **start)  # type: ignore[call-arg]


def competitors(level: str) -> dict[str, Callable[[], OnPolicyAlgorithm]]:
    """:return: what is compared, by name"""
    config = load_config("ppo", level)
    n_envs, arguments = config["n_envs"], algorithm_arguments(config)
    policy_kwargs = arguments.pop("policy_kwargs", {})
    history = config.get("env_kwargs", {}).get("history", DEFAULT_HISTORY)
    ours = {"policy_kwargs": policy_kwargs, "seed": 0, **arguments}
    stock = {
        **ours,
        "policy_kwargs": {"features_extractor_class": FiLMExtractor, "lstm_hidden_size": size_of("compact").memory},
    }

    def worlds(history: int) -> VecEnv:
        return GuideGridVecEnv(level_of(level).env_id, n_envs, history=history)

    return {
        "PPO, GuideGridVecEnv": lambda: PPO("LearnerPolicy", worlds(history), **ours),
        "PPO, Minigrid in DummyVecEnv": lambda: PPO("LearnerPolicy", in_minigrid(DummyVecEnv, level, n_envs, history), **ours),
        "PPO, Minigrid in SubprocVecEnv": lambda: PPO(
            "LearnerPolicy", in_minigrid(SubprocVecEnv, level, n_envs, history), **ours
        ),
        "RecurrentPPO, its own LSTM policy": lambda: RecurrentPPO("MultiInputLstmPolicy", worlds(0), **stock),
        "RecurrentPPO, LearnerPolicy": lambda: RecurrentPPO("LearnerPolicy", worlds(0), **ours),
    }


def measure(model: OnPolicyAlgorithm, rollouts: int) -> dict[str, float]:
    """
    :param model: not yet trained; its first rollout only warms it up
    :param rollouts: to collect and to train on
    :return: frames per second, and seconds of collecting and of training in a rollout
    """
    assert model.env is not None
    size = model.n_steps * model.n_envs
    model.learn(size)
    spent = {"collect": 0.0, "train": 0.0}

    def timed(name: str, method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            start = time.perf_counter()
            result = method(*args, **kwargs)
            spent[name] += time.perf_counter() - start
            return result

        return call

    model.collect_rollouts = timed("collect", model.collect_rollouts)  # type: ignore[method-assign]
    model.train = timed("train", model.train)  # type: ignore[method-assign]
    model.learn(rollouts * size)
    model.env.close()
    return {
        "frames_per_second": rollouts * size / sum(spent.values()),
        "collect": spent["collect"] / rollouts,
        "train": spent["train"] / rollouts,
    }


def main() -> None:
    """Measure everything on one level, one after the other."""
    parser = argparse.ArgumentParser(description="Frames per second of PPO in our worlds, in Minigrid's, and recurrent.")
    parser.add_argument("--level", default="GoToLocal", help="name of the level")
    parser.add_argument("--rollouts", type=int, default=4, help="to collect and train on")
    parser.add_argument("--threads", type=int, default=1, help="of torch")
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    arguments = parser.parse_args()
    th.set_num_threads(arguments.threads)
    rows = {}
    for name, build in tqdm(competitors(arguments.level).items()):
        rows[name] = measure(build(), arguments.rollouts)
        tqdm.write(f"{name:40} {json.dumps({key: round(value, 2) for key, value in rows[name].items()})}")
    if arguments.out:
        settings = {"level": arguments.level, "threads": arguments.threads, "rollouts": arguments.rollouts}
        write_json(arguments.out, {**settings, "versions": package_versions(), "speed": rows})


if __name__ == "__main__":
    main()
