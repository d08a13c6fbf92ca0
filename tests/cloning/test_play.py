"""Agents play missions."""

import numpy as np
import pytest
import torch as th
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed

from sb3_guide.cloning import mission_seeds, play
from sb3_guide.envs import GuideGridEnv
from sb3_guide.policies import LearnerPolicy, RecurrentGuidePolicy
from sb3_guide.policies.memory import scene_of
from sb3_guide.policies.sequences import history_of
from tests.policies.helpers import make_policy

SEEDS = mission_seeds("validation", 6)


@pytest.mark.parametrize("policy_class", [LearnerPolicy, RecurrentGuidePolicy])
def test_side_by_side_equals_one_by_one(policy_class):
    policy = make_policy(policy_class)
    episodes = play(policy, "GoToLocal", SEEDS)
    assert len(episodes) == len(SEEDS)
    for row, seed in enumerate(SEEDS):
        frames = slice(*episodes.offsets[row : row + 2])
        env = GuideGridEnv("GoToLocal", history=0 if policy.carries_memory else 3)
        obs, state, done, total = env.reset(seed=int(seed))[0], None, False, 0.0
        for image, action in zip(episodes.images[frames], episodes.actions[frames], strict=True):
            assert not done
            assert np.array_equal(image, obs["image"])
            chosen, state = policy.predict(obs, state, deterministic=True)
            assert chosen == action
            obs, reward, terminated, truncated, _ = env.step(action)
            done, total = terminated or truncated, total + reward
        assert done
        assert episodes.returns[row] == total


def test_missions_are_played_in_the_order_of_their_seeds(monkeypatch):
    policy = make_policy(RecurrentGuidePolicy)
    whole = play(policy, "GoToObj", SEEDS)
    monkeypatch.setattr("sb3_guide.cloning.episodes.WORLDS", 4)
    in_parts = play(policy, "GoToObj", SEEDS)
    assert all(np.array_equal(part, in_parts.arrays()[name]) for name, part in whole.arrays().items())
    assert np.array_equal(whole.seeds, SEEDS)


def test_progress_counts_every_episode():
    counts: list[int] = []
    play(make_policy(RecurrentGuidePolicy), "GoToObj", SEEDS, counts.append)
    assert sum(counts) == len(SEEDS)


def test_no_missions():
    with pytest.raises(ValueError, match="0 episodes were asked for"):
        play(make_policy(LearnerPolicy), "GoToObj", np.zeros(0, dtype=np.int64))


def test_a_policy_of_another_observation_space():
    policy = PPO("MlpPolicy", "CartPole-v1", n_steps=16, batch_size=16).policy
    with pytest.raises(ValueError, match="the agent's observation space is not GoToObj's"):
        play(policy, "GoToObj", SEEDS)


def test_windows_are_what_a_policy_with_window_memory_sees():
    policy = make_policy(LearnerPolicy)
    episodes = play(policy, "GoToObj", SEEDS)
    seen = episodes.windows(history_of(policy.observation_space))
    with th.no_grad():
        memory = policy.network.recall(seen)
        latent = policy.network.latent(memory, scene_of(memory, th.ones(len(memory), dtype=th.long)))
        actions = policy.action_distribution(latent).get_actions(deterministic=True).numpy()
    assert np.array_equal(actions, episodes.actions)
    assert seen.lengths[: episodes.lengths[0]].tolist()[:5] == [1, 2, 3, 4, 4][: episodes.lengths[0]]


def test_drawn_actions_are_a_function_of_torchs_generator():
    policy, drawn = make_policy(LearnerPolicy), []
    for seed in (0, 0, 1):
        set_random_seed(seed)
        drawn.append(play(policy, "GoToObj", SEEDS, deterministic=False).actions.tolist())
    assert drawn[0] == drawn[1] != drawn[2]
