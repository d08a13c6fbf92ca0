"""The native VecEnv keeps SB3's contract and equals the Gymnasium env, world by world."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from sb3_guide.envs import LEVELS, GuideGridEnv, GuideGridVecEnv, observation_space
from sb3_guide.envs.seeding import streams
from tests.envs.oracle import mixed_actions

LEVEL = "GuideGrid-GoToLocal-v0"
N = 5


def actions_of(steps: int, worlds: int = N) -> np.ndarray:
    """:return: (steps, worlds) actions"""
    return mixed_actions(np.random.default_rng(0), steps * worlds).reshape(steps, worlds)


def assert_same(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> None:
    """Check that two observations are equal."""
    assert set(a) == set(b)
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


@pytest.mark.parametrize("history", [0, 3])
def test_equals_dummy_vec_env(history: int) -> None:
    """Observations, rewards, dones and infos are those of N Gymnasium envs in SB3's DummyVecEnv."""
    dummy = DummyVecEnv([make_env(history) for _ in range(N)])
    ours = GuideGridVecEnv(LEVEL, N, seed=3, history=history)
    dummy.seed(3)
    assert_same(ours.reset(), dummy.reset())
    for actions in actions_of(200):
        observations, rewards, dones, infos = ours.step(actions)
        expected, expected_rewards, expected_dones, expected_infos = dummy.step(actions)
        assert_same(observations, expected)
        np.testing.assert_array_equal(rewards, expected_rewards)
        np.testing.assert_array_equal(dones, expected_dones)
        assert rewards.dtype == np.float32
        for info, wanted, done in zip(infos, expected_infos, dones, strict=True):
            assert bool(info) == done
            if done:
                assert_same(info.pop("terminal_observation"), wanted.pop("terminal_observation"))
                assert info == wanted


def make_env(history: int) -> Callable[[], gymnasium.Env]:
    """:return: a function that makes a Gymnasium env"""
    return lambda: GuideGridEnv("GoToLocal", history=history)


def test_history_is_the_images_before() -> None:
    """Oldest first, zeros before the episode began."""
    env = GuideGridVecEnv(LEVEL, N, seed=0, history=3)
    observation = env.reset()
    assert not observation["history"].any()
    images = [observation["image"]]
    for actions in actions_of(6):
        observation, _, dones, _ = env.step(actions)
        kept = ~dones
        before = ([np.zeros_like(images[0])] * 3 + images)[-3:]
        np.testing.assert_array_equal(observation["history"][kept], np.stack(before, axis=1)[kept])
        assert not observation["history"][dones].any()
        images = [np.where(dones[:, None, None, None], 0, image) for image in images] + [observation["image"]]


def test_returned_arrays_are_never_rewritten() -> None:
    """SB3 stores an observation after the next step."""
    env = GuideGridVecEnv(LEVEL, N, seed=0)
    kept = [env.reset()]
    copies = [{name: array.copy() for name, array in kept[0].items()}]
    for actions in actions_of(100):
        observation, rewards, dones, infos = env.step(actions)
        last = [info["terminal_observation"] for info in infos if info]
        kept += [observation, {"rewards": rewards, "dones": dones}, *last]
        copies += [{name: array.copy() for name, array in arrays.items()} for arrays in kept[len(copies) :]]
    for arrays, copy in zip(kept, copies, strict=True):
        assert_same(arrays, copy)


def test_threads_do_not_change_results() -> None:
    """The batch is only split."""
    one, two = (GuideGridVecEnv(LEVEL, N, seed=1, n_threads=n) for n in (1, 2))
    assert_same(one.reset(), two.reset())
    for actions in actions_of(100):
        assert_same(one.step(actions)[0], two.step(actions)[0])


def test_seeds() -> None:
    """World i has seed + i; only the first reset after seed() is seeded."""
    env = GuideGridVecEnv(LEVEL, 3, seed=7)
    first = env.reset()
    assert_same(first, env.reset_to(np.array([7, 8, 9])))
    second = env.reset()
    assert not np.array_equal(first["image"], second["image"])
    env.seed(7)
    assert_same(first, env.reset())
    assert_same(second, env.reset())


@pytest.mark.parametrize("seed", [0, 1, 2**32 - 1, 2**32, 2**63 + 12345])
def test_streams_are_numpys(seed: int) -> None:
    """Before anything is drawn, a world's generator is the one that Gymnasium makes of the seed."""
    expected = np.random.PCG64(np.random.SeedSequence(seed)).state["state"]
    state, increment = streams(np.array([0, seed], dtype=np.uint64))[1].reshape(2, 2).tolist()
    assert expected == {"state": state[0] << 64 | state[1], "inc": increment[0] << 64 | increment[1]}


def test_missions_of_chosen_seeds() -> None:
    """World k plays the mission of its seed."""
    env = GuideGridVecEnv(LEVEL, 3)
    env.reset_to(np.array([100, 5, 100]))
    single = GuideGridEnv("GoToLocal")
    expected = []
    for seed in (100, 5, 100):
        single.reset(seed=seed)
        expected.append(single.mission)
    assert env.missions == expected == env.get_attr("mission")


def test_unseeded_worlds_differ() -> None:
    """Without a seed, entropy comes from the system."""
    first, second = (GuideGridVecEnv(LEVEL, 4).reset() for _ in range(2))
    assert not np.array_equal(first["image"], second["image"])


def test_state_is_exact() -> None:
    """A restored state has the same future, through resets; pickling keeps it too."""
    env = GuideGridVecEnv(LEVEL, N, seed=0, n_threads=2)
    env.reset()
    for actions in actions_of(30):
        env.step(actions)
    state, copy = env.get_state(), pickle.loads(pickle.dumps(env))
    future = [env.step(actions) for actions in actions_of(80)]
    other = GuideGridVecEnv(LEVEL, N)
    other.set_state(state)
    for actions, (observation, rewards, _, _) in zip(actions_of(80), future, strict=True):
        for restored in (other, copy):
            again, rewards_again, _, _ = restored.step(actions)
            assert_same(again, observation)
            np.testing.assert_array_equal(rewards_again, rewards)


@pytest.mark.parametrize("spoil", ["name", "shape", "dtype"])
def test_foreign_state_is_refused(spoil: str) -> None:
    """The worlds stay as they are."""
    env = GuideGridVecEnv(LEVEL, N, seed=0)
    env.reset()
    before, state = env.get_state(), env.get_state()
    if spoil == "name":
        del state["steps"]
    elif spoil == "shape":
        state["steps"] = state["steps"][1:]
    else:
        state["steps"] = state["steps"].astype(np.float64)
    with pytest.raises(ValueError, match="the state's"):
        env.set_state(state)
    assert_same(env.get_state(), before)


@pytest.mark.parametrize(
    ("name", "value"),
    [("agent", 32 * 6), ("agent", 32_000), ("direction", 4), ("carrying", 0), ("position", 7), ("cells", 1), ("mission", 99)],
)
def test_impossible_state_is_refused(name: str, value: int) -> None:
    """The engine would leave its arrays."""
    env = GuideGridVecEnv(LEVEL, N, seed=0)
    env.reset()
    state = env.get_state()
    state[name][-1] = value
    with pytest.raises(ValueError, match="cannot be one of GoToLocal"):
        env.set_state(state)


def test_state_of_another_level_is_refused() -> None:
    """The arrays look alike, the walls do not."""
    maze = GuideGridVecEnv("GoTo", N, seed=0)
    maze.reset()
    with pytest.raises(ValueError, match="walls are not those of GoToLocal"):
        GuideGridVecEnv(LEVEL, N).set_state(maze.get_state())


@pytest.mark.parametrize("level", LEVELS)
def test_states_of_play_are_accepted(level: str) -> None:
    """Whatever happened: doors opened, boxes destroyed, objects carried."""
    env = GuideGridVecEnv(level, 20, seed=0)
    env.set_state(env.get_state())
    env.reset()
    for actions in actions_of(150, worlds=20):
        env.set_state(env.get_state())
        env.step(actions)


@pytest.mark.parametrize(
    "actions",
    [np.zeros(N - 1, dtype=int), np.zeros((N, 1), dtype=int), np.full(N, 7), np.full(N, -1), np.zeros(N)],
    ids=["too few", "two dimensions", "too high", "negative", "floats"],
)
def test_wrong_actions_are_refused(actions: np.ndarray) -> None:
    """The worlds stay as they are."""
    env = GuideGridVecEnv(LEVEL, N, seed=0)
    env.reset()
    before = env.get_state()
    with pytest.raises(ValueError, match="actions"):
        env.step(actions)
    assert_same(env.get_state(), before)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"n_envs": 0}, "n_envs=0"),
        ({"env_id": "GuideGrid-Nowhere-v0"}, "GuideGrid-Nowhere-v0.*GoToObj"),
        ({"seed": -1}, "seed=-1"),
        ({"seed": 2**64}, "at most 64 bits"),
        ({"history": -1}, "history=-1"),
        ({"n_threads": 0}, "n_threads=0"),
        ({"render_mode": "ansi"}, "ansi"),
        ({"render_mode": "human"}, "human"),
    ],
)
def test_wrong_arguments_are_refused(kwargs: dict[str, Any], message: str) -> None:
    """The error names the value."""
    with pytest.raises(ValueError, match=message):
        GuideGridVecEnv(**{"env_id": LEVEL, "n_envs": 2, **kwargs})


def test_step_before_reset_is_refused() -> None:
    """There is nothing to step in yet."""
    with pytest.raises(ValueError, match="reset"):
        GuideGridVecEnv(LEVEL, N).step(np.zeros(N, dtype=int))


@pytest.mark.parametrize("seeds", [np.array([1]), np.array([1, 2, -3]), np.array([1.0, 2.0, 3.0])])
def test_wrong_seeds_are_refused(seeds: np.ndarray) -> None:
    """One non-negative integer for every world."""
    with pytest.raises(ValueError, match="seeds"):
        GuideGridVecEnv(LEVEL, 3).reset_to(seeds)


def test_make_vec_env() -> None:
    """SB3's own maker takes `from_env_fns`; its Monitors become a VecMonitor."""
    venv = make_vec_env(LEVEL, 3, seed=5, env_kwargs={"history": 1}, vec_env_cls=GuideGridVecEnv.from_env_fns)
    assert isinstance(venv, VecMonitor)
    assert isinstance(venv.unwrapped, GuideGridVecEnv)
    assert venv.observation_space == observation_space(1)
    assert_same(venv.reset(), GuideGridVecEnv(LEVEL, 3, seed=5, history=1).reset())


def test_from_env_fns_refuses_what_it_cannot_keep() -> None:
    """Different envs, other wrappers, other envs."""
    with pytest.raises(ValueError, match="GoToObj"):
        GuideGridVecEnv.from_env_fns([make_env(0), lambda: GuideGridEnv("GoToObj")])
    with pytest.raises(ValueError, match="Clipped"):
        GuideGridVecEnv.from_env_fns([lambda: Clipped(GuideGridEnv("GoToObj"))])
    with pytest.raises(ValueError, match="CartPole"):
        GuideGridVecEnv.from_env_fns([lambda: Monitor(gymnasium.make("CartPole-v1"))])
    with pytest.raises(ValueError, match="what a Monitor writes cannot be kept"):
        GuideGridVecEnv.from_env_fns([lambda: Monitor(GuideGridEnv("GoToObj"), info_keywords=("is_success",))])
    with pytest.raises(ValueError, match="empty"):
        GuideGridVecEnv.from_env_fns([])


def test_attributes() -> None:
    """`get_attr`, `set_attr` and `env_method` work world by world."""
    env = GuideGridVecEnv(LEVEL, 3, seed=0, render_mode="rgb_array")
    env.reset()
    assert env.get_attr("render_mode") == ["rgb_array"] * 3
    assert env.get_attr("mission", 1) == [env.missions[1]]
    assert env.get_attr("observation_space", 0) == [env.observation_space]
    assert env.get_attr("action_space", 0) == [env.action_space]
    assert env.get_attr("spec")[2].id == LEVEL
    assert env.get_attr("level")[0].name == "GoToLocal"
    assert env.get_attr("history") == [3] * 3
    assert env.get_attr("unwrapped", 0)[0].mission == env.missions[0]
    env.set_attr("np_random", np.random.default_rng(42), indices=[0, 2])
    observation = env.reset()
    np.testing.assert_array_equal(observation["image"][0], observation["image"][2])
    assert env.env_is_wrapped(Monitor) == [False] * 3
    np.testing.assert_array_equal(env.env_method("render", indices=1)[0], env.get_images()[1])


def test_ppo_learns_from_it() -> None:
    """Stock PPO takes the VecEnv as it is."""
    env = VecMonitor(GuideGridVecEnv(LEVEL, 4, seed=0, history=0))
    PPO("MultiInputPolicy", env, n_steps=16, batch_size=32, n_epochs=1, device="cpu").learn(128)


class Clipped(gymnasium.Wrapper):
    """Any wrapper."""
