"""Environments that are not ours, by their ids."""

import gymnasium
import minigrid  # noqa: F401  # registers its environments
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env

from sb3_guide.envs import (
    ACTIONS,
    HistoryWrapper,
    TextMissionWrapper,
    Vocabulary,
    action_names,
    name_of,
    observation_space,
    spaces_of,
    worlds_of,
)
from tests.toys import Signal

DOOR_KEY = "MiniGrid-DoorKey-5x5-v0"
MISSION = "use the key to open the door and then get to the goal"


@pytest.fixture(scope="module", autouse=True)
def registered():
    gymnasium.register("Turned-v0", Signal, kwargs={"kind": "pixels", "words": 5})
    yield
    del gymnasium.registry["Turned-v0"]


def test_a_vocabulary_from_resets_survives_the_disk(tmp_path):
    vocabulary = Vocabulary.sampled(gymnasium.make(DOOR_KEY), resets=3)
    assert vocabulary.words == ("", "and", "door", "get", "goal", "key", "open", "the", "then", "to", "use")
    assert vocabulary.length == 13
    vocabulary.save(tmp_path / "new" / "words.json")
    assert Vocabulary.load(tmp_path / "new" / "words.json") == vocabulary
    assert vocabulary.decode(vocabulary.encode(MISSION)) == MISSION


def test_a_vocabulary_of_texts():
    vocabulary = Vocabulary.of(["Stop!", "go, then stop"])
    assert vocabulary.words == ("", "!", ",", "Stop", "go", "stop", "then")
    assert vocabulary.encode("go!").tolist() == [4, 1, 0, 0]
    assert vocabulary.space == spaces.Box(0, 6, (4,), np.uint8)
    assert Vocabulary.of([]).encode("").tolist() == [0]
    assert Vocabulary.of(map(str, range(300))).space.dtype == np.int32


@pytest.mark.parametrize(
    ("content", "message"),
    [("{}", "holds no vocabulary"), ('{"words": ["a"], "length": 2}', "expected '' for padding first"), ("[", "is no JSON")],
)
def test_files_that_hold_no_vocabulary(tmp_path, content, message):
    (tmp_path / "words.json").write_text(content)
    with pytest.raises(ValueError, match=message):
        Vocabulary.load(tmp_path / "words.json")
    with pytest.raises(FileNotFoundError, match=r"none\.json does not exist"):
        Vocabulary.load(tmp_path / "none.json")


def test_a_text_mission_becomes_tokens_and_nothing_else_is_left():
    vocabulary = Vocabulary.of([MISSION])
    env = TextMissionWrapper(gymnasium.make(DOOR_KEY), vocabulary)
    check_env(env, skip_render_check=True)
    observation, _ = env.reset(seed=0)
    assert observation.keys() == {"image", "mission"}
    assert vocabulary.decode(observation["mission"]) == MISSION


def test_an_unknown_word_of_a_mission():
    env = TextMissionWrapper(gymnasium.make(DOOR_KEY), Vocabulary.of(["use the key"]))
    with pytest.raises(ValueError, match=r"unknown words \['and', 'door', 'get', 'goal', 'open', 'then', 'to'\]"):
        env.reset(seed=0)


def test_what_has_no_text_mission_or_no_image():
    with pytest.raises(ValueError, match="expected a Dict with 'image' and 'mission'"):
        TextMissionWrapper(gymnasium.make("CartPole-v1"), Vocabulary.of([]))
    with pytest.raises(ValueError, match="expected at least 1, and a Dict with 'image'"):
        HistoryWrapper(gymnasium.make("CartPole-v1"), 2)
    with pytest.raises(ValueError, match="history=0, and"):
        HistoryWrapper(Signal(), 0)


def test_a_history_is_what_was_seen_before():
    env, seen = HistoryWrapper(Signal("floats"), 2), []
    check_env(env, skip_render_check=True)
    for _ in range(2):
        observation, _ = env.reset(seed=0)
        assert not observation["history"].any()
        seen = [observation["image"]]
        for _ in range(3):
            observation, *_ = env.step(0)
            seen.append(observation["image"])
        assert np.array_equal(observation["history"], seen[1:3])


@pytest.mark.parametrize("go_on", [False, True])
def test_worlds_are_what_single_environments_are(go_on):
    worlds, seeds = worlds_of("Turned-v0", 3, go_on=go_on), np.array([7, 1_000_000_003, 3_000_000_001])
    observation = worlds.reset_to(seeds)
    singles = [gymnasium.make("Turned-v0") for _ in seeds]
    expected = [env.reset(seed=int(seed))[0] for env, seed in zip(singles, seeds, strict=True)]
    rests = [False] * 3
    for step in range(8):
        for world, single in enumerate(expected):
            assert np.array_equal(observation["image"][world], single["image"].transpose(2, 0, 1))
            assert np.array_equal(observation["mission"][world], single["mission"])
        actions = np.array([step % 4, 0, 1])
        observation, rewards, dones, infos = worlds.step(actions)
        assert len(infos) == 3
        for world, env in enumerate(singles):
            if rests[world]:
                assert (rewards[world], dones[world]) == (0, True)
                continue
            expected[world], reward, terminated, truncated, _ = env.step(actions[world])
            assert (rewards[world], dones[world]) == (reward, terminated or truncated)
            if dones[world] and go_on:
                expected[world] = env.reset()[0]
            rests[world] = dones[world] and not go_on


def test_spaces_and_names():
    assert spaces_of("GoToObj") == spaces_of("GuideGrid-GoToObj-v0") == (observation_space(0), spaces.Discrete(7))
    image, actions = spaces_of("Turned-v0")
    assert image["image"].shape == (3, 36, 48)
    assert actions == spaces.Discrete(4)
    assert action_names("GoToObj") == ACTIONS == action_names(DOOR_KEY)
    assert action_names("Signal-v0") == ("north", "east", "south", "west")
    assert action_names("CartPole-v1") == ("0", "1")
    assert [name_of(env_id) for env_id in ("GoTo", "GuideGrid-GoTo-v0", DOOR_KEY)] == ["GoTo", "GoTo", DOOR_KEY]


@pytest.mark.parametrize(
    ("env_id", "message"),
    [
        ("Nowhere-v0", "unknown environment 'Nowhere-v0': expected a level"),
        ("os:Nowhere-v0", "unknown environment 'os:Nowhere-v0'"),
        ("CartPole-v1", "CartPole-v1 observes Box.*: expected a Dict with 'image'"),
        ("MountainCarContinuous-v0", "MountainCarContinuous-v0 observes Box"),
    ],
)
def test_what_is_no_world_of_agents(env_id, message):
    with pytest.raises(ValueError, match=message):
        worlds_of(env_id, 1)
