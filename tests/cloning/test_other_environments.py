"""Episodes of environments that are not ours."""

import gymnasium
import numpy as np
import pytest
import torch as th

import tests.toys  # noqa: F401  # registers them
from sb3_guide.cloning import Demonstrations, load_demonstrations, mission_seeds, play, save_demonstrations
from sb3_guide.cloning.bc import episode_bc
from sb3_guide.cloning.demonstrations import pool
from sb3_guide.cloning.episodes import concatenate
from sb3_guide.envs import HistoryWrapper, spaces_of
from sb3_guide.policies import LearnerPolicy, RecurrentGuidePolicy
from sb3_guide.policies.memory import scene_of
from tests.cloning.helpers import make_demonstrations
from tests.toys import Signal

SEEDS = mission_seeds("train", 70)


class Told(gymnasium.Wrapper):
    """Says that the episodes with an even target succeed, whatever they were worth."""

    def step(self, action):
        *seen, terminated, truncated, _ = self.env.step(action)
        return *seen, terminated, truncated, {"is_success": self.unwrapped.right % 2 == 0}


@pytest.fixture(scope="module", autouse=True)
def registered():
    gymnasium.register("SignalHistory-v0", lambda: HistoryWrapper(Signal(), 2))
    gymnasium.register("SignalPixels-v0", lambda: Told(Signal("pixels", words=5)))
    yield
    for env_id in ("SignalHistory-v0", "SignalPixels-v0"):
        del gymnasium.registry[env_id]


def make(policy_class, env_id, **kwargs):
    th.manual_seed(0)
    return policy_class(*spaces_of(env_id), lambda _: 1e-3, **kwargs)


def test_side_by_side_equals_one_by_one():
    policy = make(RecurrentGuidePolicy, "Signal-v0")
    episodes = play(policy, "Signal-v0", SEEDS)
    assert episodes.missions.shape == (70, 1)
    assert not episodes.missions.any()
    for row in (0, 1, 69):
        frames = slice(*episodes.offsets[row : row + 2])
        env = gymnasium.make("Signal-v0")
        obs, state, done, total = env.reset(seed=int(SEEDS[row]))[0], None, False, 0.0
        for image, action in zip(episodes.images[frames], episodes.actions[frames], strict=True):
            assert not done
            assert np.array_equal(image, obs["image"])
            chosen, state = policy.predict(obs, state, deterministic=True)
            assert chosen == action
            obs, reward, terminated, truncated, _ = env.step(action)
            done, total = terminated or truncated, total + reward
        assert done
        assert episodes.returns[row] == total
        assert episodes.successes[row] == (total > 0)


def test_windows_are_what_a_policy_with_window_memory_sees():
    """The first image is blank, which the policy doesn't tell from the time before the episode."""
    th.manual_seed(1)
    env = gymnasium.make("SignalHistory-v0")
    policy = LearnerPolicy(env.observation_space, env.action_space, lambda _: 1e-3)
    episodes = play(policy, "SignalHistory-v0", SEEDS)
    seen = episodes.windows(2)
    with th.no_grad():
        memory = policy.network.recall(seen)
        latent = policy.network.latent(memory, scene_of(memory, th.ones(len(memory), dtype=th.long)))
        actions = policy.action_distribution(latent).get_actions(deterministic=True).numpy()
    assert np.array_equal(actions, episodes.actions)
    assert seen.lengths[: episodes.lengths[0]].tolist() == [1, 1, 2, 3][: episodes.lengths[0]]


def test_an_agent_with_carried_memory_plays_where_there_is_a_history_too():
    policy = make(RecurrentGuidePolicy, "SignalHistory-v0")
    assert policy.observation_space.spaces.keys() == {"image"}
    one, other = (play(policy, env_id, SEEDS[:5]) for env_id in ("Signal-v0", "SignalHistory-v0"))
    assert all(np.array_equal(array, other.arrays()[name]) for name, array in one.arrays().items())


def test_success_is_what_the_environment_says(tmp_path):
    episodes = play(make(RecurrentGuidePolicy, "SignalPixels-v0"), "SignalPixels-v0", SEEDS)
    assert episodes.images.shape[1:] == (3, 36, 48)
    told = (episodes.missions[:, 0] - 1) % 2 == 0
    assert np.array_equal(episodes.successes, told)
    chosen = episodes.select(np.flatnonzero(told))
    assert chosen.successes.all()
    assert np.array_equal(concatenate([episodes, chosen]).successes, [*told, *chosen.successes])
    save_demonstrations(Demonstrations(chosen, "SignalPixels-v0", {}), tmp_path / "train.safetensors")
    assert load_demonstrations(tmp_path / "train.safetensors").episodes.successes.all()


def test_pictures_are_cloned():
    policy = make(RecurrentGuidePolicy, "SignalPixels-v0")
    episodes = play(policy, "SignalPixels-v0", SEEDS)
    demonstrations = Demonstrations(episodes.select(np.flatnonzero(episodes.successes)), "SignalPixels-v0", {})
    before = policy.network.speaker.film.vision.stem[0].weight.clone()
    algorithm, _ = episode_bc(policy, demonstrations, batch_size=8, learning_rate=1e-3, ent_weight=0.0, seed=0)
    algorithm.train(n_epochs=1, progress_bar=False)
    assert not th.equal(before, policy.network.speaker.film.vision.stem[0].weight)


def test_demonstrations_of_different_images_are_not_pooled():
    episodes = play(make(RecurrentGuidePolicy, "SignalPixels-v0"), "SignalPixels-v0", SEEDS)
    other = Demonstrations(episodes.select(np.flatnonzero(episodes.successes)), "SignalPixels-v0", {})
    with pytest.raises(ValueError, match=r"demonstrations of different images can't be pooled: .*'GoToObj': \(7, 7, 3\)"):
        pool([make_demonstrations([3]), other])


def test_an_agent_that_sees_something_else():
    with pytest.raises(ValueError, match="the agent's observation space is not Pick-v0's"):
        play(make(RecurrentGuidePolicy, "Signal-v0"), "Pick-v0", SEEDS)
