"""The Gymnasium env keeps Gymnasium's and SB3's contracts."""

from __future__ import annotations

import builtins
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env

import sb3_guide.envs
from sb3_guide.envs import ACTIONS, DEFAULT_HISTORY, LEVELS, GuideGridEnv, level_of, observation_space
from sb3_guide.envs.bot import twin
from tests.envs.oracle import mixed_actions, stream


@pytest.mark.parametrize("level", LEVELS)
def test_every_level_is_registered(level: str) -> None:
    """`gym.make` finds it, and all observe and do the same."""
    env = gymnasium.make(f"GuideGrid-{level}-v0")
    assert isinstance(env.unwrapped, GuideGridEnv)
    assert env.observation_space == observation_space(DEFAULT_HISTORY)
    assert env.action_space == gymnasium.spaces.Discrete(len(ACTIONS))
    observation, info = env.reset(seed=0)
    assert observation in env.observation_space
    assert info == {}
    assert env.spec is not None
    assert env.spec.max_episode_steps is None


@pytest.mark.filterwarnings("ignore")  # about the images' shape and bounds: expected
@pytest.mark.parametrize("check", [gymnasium_check_env, sb3_check_env])
@pytest.mark.parametrize("history", [0, 2])
def test_checkers_pass(check: Any, history: int) -> None:
    """Gymnasium's and SB3's."""
    check(gymnasium.make("GuideGrid-GoToLocal-v0", history=history, render_mode="rgb_array").unwrapped)


def test_make_vec() -> None:
    """Gymnasium's own vector envs take the levels."""
    venv = gymnasium.make_vec("GuideGrid-GoToObj-v0", num_envs=2, vectorization_mode="sync")
    observation, _ = venv.reset(seed=0)
    assert observation["image"].shape == (2, 7, 7, 3)
    assert venv.step(np.array([0, 1]))[0]["mission"].shape == (2, 72)
    venv.close()


def test_level_of_takes_names_and_ids() -> None:
    """Both name the same level."""
    assert level_of("GoToObj") is level_of("GuideGrid-GoToObj-v0") is LEVELS["GoToObj"]


@pytest.mark.parametrize("name", ["GoToNowhere", "GuideGrid-GoToObj", "GoToObj-v0", "BabyAI-GoToObj-v0", ""])
def test_unknown_levels_are_refused(name: str) -> None:
    """The error names the level and lists the known ones."""
    with pytest.raises(ValueError, match=f"{name!r}.*GoToObj, GoToRedBallGrey"):
        GuideGridEnv(name)


@pytest.mark.parametrize(
    ("kwargs", "message"), [({"history": -1}, "history=-1"), ({"render_mode": "ansi"}, "render_mode='ansi'")]
)
def test_wrong_arguments_are_refused(kwargs: dict[str, Any], message: str) -> None:
    """The error names the value."""
    with pytest.raises(ValueError, match=message):
        GuideGridEnv("GoToObj", **kwargs)


def test_wrong_use_is_refused() -> None:
    """Step and render before reset, a negative seed, an impossible action, a generator of another kind."""
    env = GuideGridEnv("GoToObj", render_mode="rgb_array")
    with pytest.raises(ValueError, match="before the first reset"):
        env.step(0)
    with pytest.raises(ValueError, match="before the first reset"):
        env.render()
    with pytest.raises(ValueError, match="seed=-1"):
        env.reset(seed=-1)
    env.reset()
    with pytest.raises(ValueError, match="7"):
        env.step(7)
    with pytest.raises(ValueError, match="float64"):
        env.step(1.0)
    with pytest.raises(ValueError, match=r"\(2,\)"):
        env.step(np.array([1, 2]))
    env.np_random = np.random.Generator(np.random.MT19937(0))
    with pytest.raises(ValueError, match="MT19937"):
        env.reset()


def test_np_random_is_the_engines_generator() -> None:
    """Draws and assignments of the user change the next episode as in Minigrid."""
    theirs, ours = twin("GoToLocal"), GuideGridEnv("GoToLocal")
    theirs.reset(seed=0)
    ours.reset(seed=0)
    for env in (theirs, ours):
        env.np_random.integers(3, size=5)
    np.testing.assert_array_equal(ours.reset()[0]["image"], theirs.reset()[0]["image"])
    for env in (theirs, ours):
        env.np_random = np.random.default_rng(5)
    np.testing.assert_array_equal(ours.reset()[0]["image"], theirs.reset()[0]["image"])
    assert stream(ours) == stream(theirs)


def test_success_is_told_on_the_last_step_only() -> None:
    """SB3 counts successes by `info["is_success"]`."""
    env = GuideGridEnv("GoToObj")
    env.reset(seed=0)
    told = []
    for action in mixed_actions(np.random.default_rng(0), 2000):
        _, reward, terminated, truncated, info = env.step(action)
        assert ("is_success" in info) == (terminated or truncated)
        if info:
            told.append(info["is_success"])
            assert info["is_success"] == terminated == (reward > 0)
            env.reset()
    assert {True, False} == set(told)


def test_pickle_keeps_the_future() -> None:
    """A pickled env goes on as the first one does."""
    env = GuideGridEnv("GoToLocal")
    env.reset(seed=3)
    copy = pickle.loads(pickle.dumps(env))
    for action in mixed_actions(np.random.default_rng(1), 50):
        (observation, *outcome), (again, *outcome_again) = env.step(action), copy.step(action)
        assert outcome_again == outcome
        for name, value in observation.items():
            np.testing.assert_array_equal(again[name], value)
    np.testing.assert_array_equal(copy.reset()[0]["image"], env.reset()[0]["image"])


def test_human_mode_without_pygame_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """pygame is an extra."""
    real_import = builtins.__import__

    def no_pygame(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == "pygame":
            raise ImportError(name)
        return real_import(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", no_pygame)
    with pytest.raises(ImportError, match=r"sb3-guide\[human\]"):
        GuideGridEnv("GoToObj", render_mode="human").reset(seed=0)


def test_human_mode_shows_a_window(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here on a display that nobody sees."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = GuideGridEnv("GoToObj", render_mode="human")
    env.reset(seed=0)
    env.step(2)
    env.close()


def test_importing_again_changes_nothing() -> None:
    """Registration is guarded."""
    ids = [name for name in gymnasium.registry if name.startswith("GuideGrid")]
    assert len(ids) == len(sb3_guide.envs.LEVELS) == 30
