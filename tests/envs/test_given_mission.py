"""A mission of one's own in the place of a world's own."""

import numpy as np
import pytest

from sb3_guide.envs import ACTIONS, LEVELS, GuideGridEnv
from sb3_guide.envs.given_mission import has_targets, with_mission


@pytest.mark.parametrize("level", LEVELS)
def test_the_words_of_a_world_mean_what_the_world_means(level):
    env = GuideGridEnv(level, history=0)
    for seed in range(20):
        env.reset(seed=seed)
        own = env.get_state()
        given = with_mission(own, env.level, env.mission)
        assert has_targets(given)
        for name in own:
            assert np.array_equal(own[name], given[name]), (name, env.mission)


def test_the_engine_verifies_it():
    env = GuideGridEnv("GoToObj", history=0)
    env.reset(seed=0)
    thing = env.mission.removeprefix("go to the ")
    env.set_state(with_mission(env.get_state(), env.level, f"pick up the {thing}"))
    assert env.mission == f"pick up the {thing}"
    path = path_to_the_object(env)
    ends = [env.step(ACTIONS.index(name))[2] for name in path]
    assert not any(ends)  # standing before it is not enough
    assert env.step(ACTIONS.index("pickup"))[2]


def path_to_the_object(env: GuideGridEnv) -> list[str]:
    """Found by trying: a copy of the world whose own mission is to go there."""
    copy = GuideGridEnv("GoToObj", history=0)
    rng = np.random.default_rng(0)
    while True:
        copy.reset(seed=0)
        path: list[str] = []
        for _ in range(60):
            path.append(str(rng.choice(ACTIONS[:3])))
            if copy.step(ACTIONS.index(path[-1]))[2]:
                return path


def test_what_is_not_there_cannot_be_done():
    env = GuideGridEnv("GoToObj", history=0)
    env.reset(seed=0)
    kinds = {"key", "ball", "box"} - {env.mission.split()[-1]}
    assert not has_targets(with_mission(env.get_state(), env.level, f"go to a {min(kinds)}"))


@pytest.mark.parametrize(
    ("mission", "message"),
    [
        ("", "'' is no mission"),
        ("go to the moon", "'go to the moon' is no mission"),
        ("go to red ball", "is no mission: expected one such as 'go to the red ball'"),
        ("put the red ball", "'put the red ball' is no mission"),
        ("go to the red ball next to a key", "is no mission"),
        ("go to a key and go to a box, then go to a ball and go to a door and open a door", "5 parts, expected at most 4"),
    ],
)
def test_texts_that_are_no_mission(mission, message):
    env = GuideGridEnv("GoToObj", history=0)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        with_mission(env.get_state(), env.level, mission)
