"""Images and missions of any form: what agents make of them, and what they say where they can make nothing of them."""

import json

import minigrid  # noqa: F401  # registers its environments
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from sb3_contrib import RecurrentPPO
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from stable_baselines3 import A2C, PPO
from stable_baselines3.common.env_util import make_vec_env

from sb3_guide.envs import HistoryWrapper
from sb3_guide.policies import (
    FiLMExtractor,
    GuidePolicy,
    LearnerPolicy,
    PretrainedGuide,
    RecurrentGuidePolicy,
    RecurrentLearnerPolicy,
    load_agent,
    save_agent,
)
from sb3_guide.policies.film import CompactVision, InstructionEncoder, PixelVision
from sb3_guide.policies.picture import picture_of
from sb3_guide.policies.sequences import unpadded, windows
from sb3_guide.policies.sizes import size_of
from tests.toys import Signal

KINDS = list(Signal.spaces_by_kind)
ALGORITHMS = {PPO: {"n_steps": 8, "batch_size": 16}, A2C: {}, RecurrentPPO: {"n_steps": 8, "batch_size": 16}}


def make(policy_class, kind: str, words: int = 0, **kwargs):
    th.manual_seed(0)
    env = Signal(kind, words)
    return policy_class(env.observation_space, env.action_space, lambda _: 1e-3, **kwargs)


def sampled(space: spaces.Dict, n: int) -> dict[str, th.Tensor]:
    space.seed(0)
    rows = [space.sample() for _ in range(n)]
    return {name: th.as_tensor(np.stack([row[name] for row in rows])) for name in space.spaces}


@pytest.mark.parametrize("words", [0, 5])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("algorithm", ALGORITHMS, ids=lambda algorithm: algorithm.__name__)
def test_guides_learn_in_any_of_these_spaces(algorithm, kind, words):
    env = make_vec_env(lambda: HistoryWrapper(Signal(kind, words), 2), 2)
    model = algorithm("GuidePolicy", env, seed=0, **ALGORITHMS[algorithm])
    before = {name: weight.clone() for name, weight in model.policy.named_parameters()}
    model.learn(32)
    unchanged = {name for name, weight in model.policy.named_parameters() if th.equal(weight, before[name])}
    reads_nothing = {name for name in before if not words and ".instruction." in name}
    relaxes_symbols = {name for name in before if ".inverse_temperature." in name}  # in cloning alone
    assert unchanged <= reads_nothing | relaxes_symbols


@pytest.mark.parametrize("kind", KINDS)
def test_a_guided_learner_hears_in_any_of_these_spaces(kind, tmp_path):
    env = make_vec_env(lambda: Signal(kind, 5), 2)
    guide = PPO("GuidePolicy", env, n_steps=8, batch_size=16)
    save_agent(guide.policy, tmp_path / "guide")
    kwargs = {"guide": PretrainedGuide.from_folder(tmp_path / "guide")}
    PPO("GuidedLearnerPolicy", env, n_steps=8, batch_size=16, policy_kwargs=kwargs).learn(16)


@pytest.mark.parametrize(
    ("kind", "vision"), [("cells", CompactVision), ("bytes", CompactVision), ("pixels", PixelVision), ("floats", PixelVision)]
)
@pytest.mark.parametrize("size", ["compact", "medium", "paper"])
def test_the_space_chooses_how_images_are_seen(kind, vision, size):
    found = make(LearnerPolicy, kind, size=size).network.film.vision
    assert isinstance(found, vision) == (vision is PixelVision or size != "paper")


@pytest.mark.parametrize("kind", KINDS)
def test_every_cell_and_pixel_counts(kind):
    policy = make(LearnerPolicy, kind)
    obs = sampled(policy.observation_space, 1)
    image = obs["image"][0]
    for place in [(0, 0, 0), tuple(side - 1 for side in image.shape)]:
        changed = image.clone()
        changed[place] = changed[place] == 0  # another value, whatever it was
        with th.no_grad():
            memory = policy.memory({"image": th.stack([image, changed])})
        assert not th.equal(memory[0], memory[1])


def test_fractions_of_pixels_are_told_apart():
    policy = make(LearnerPolicy, "floats")
    images = th.rand(5, 12, 10, 1)
    with th.no_grad():
        together = policy.memory({"image": images})
        assert len(together.unique(dim=0)) == 5
        for image, expected in zip(images, together, strict=True):
            assert th.allclose(policy.memory({"image": image.unsqueeze(0)})[0], expected, atol=1e-6)


@pytest.mark.parametrize("kind", ["bytes", "pixels"])
def test_pictures_are_the_same_whichever_way_sb3_turns_them(kind):
    straight = make(LearnerPolicy, kind)
    env = make_vec_env(lambda: Signal(kind), 2)
    turned = PPO("LearnerPolicy", env, n_steps=8, batch_size=16).policy
    assert turned.observation_space["image"].shape[0] == 3
    turned.load_state_dict(straight.state_dict())
    images = sampled(straight.observation_space, 3)["image"]
    with th.no_grad():
        assert th.equal(straight.memory({"image": images}), turned.memory({"image": images.movedim(-1, 1)}))


@pytest.mark.parametrize("kind", ["cells", "bytes", "pixels", "floats"])
@pytest.mark.parametrize("normalize", [True, False])
def test_the_extractor_sees_in_sb3s_own_policies_what_agents_see(kind, normalize):
    env = make_vec_env(lambda: Signal(kind), 2)
    as_they_are = {"normalize_images": False, "features_extractor_kwargs": {"normalize_images": False}}
    kwargs = {"features_extractor_class": FiLMExtractor, **({} if normalize else as_they_are)}
    theirs = PPO("MultiInputPolicy", env, n_steps=8, batch_size=16, policy_kwargs=kwargs).policy
    ours = PPO("LearnerPolicy", env, n_steps=8, batch_size=16).policy
    ours.network.film.load_state_dict(theirs.features_extractor.state_dict())
    obs = sampled(ours.observation_space, 3)
    with th.no_grad():
        expected, position = ours.network.film.encode(windows(obs).sequences())
        assert th.allclose(theirs.extract_features(obs), expected[position], atol=1e-6)


@pytest.mark.parametrize(
    "missions", [([0, 0, 1, 2], [0, 0, 3, 4]), ([0, 3, 0, 0], [0, 4, 0, 0]), ([1, 0, 2, 0], [1, 0, 3, 0])]
)
def test_every_word_is_read_wherever_padding_is(missions):
    instruction = InstructionEncoder(6, size_of("compact"))
    with th.no_grad():
        one, other = instruction(th.tensor(missions))
        assert not th.allclose(one, other)


@pytest.mark.parametrize("shape", [(3, 3, 3), (3, 3, 5), (3, 5, 3)])
def test_channels_are_last_where_sb3_does_not_turn_pictures(shape):
    space = spaces.Dict({"image": spaces.Box(0, 255, shape, np.uint8)})
    assert picture_of(space)[:3] == shape


def test_a_cell_that_can_not_be_is_refused_whichever_channel_it_is_in():
    policy = make(LearnerPolicy, "cells")
    obs = sampled(policy.observation_space, 1)
    channel, high = min(enumerate(policy.observation_space["image"].high[0, 0].tolist()), key=lambda pair: pair[1])
    obs["image"][0, 0, 0, channel] = high + 1
    with pytest.raises(ValueError, match=f"cells of images have values .*: expected whole numbers from 0 to {high}"):
        policy.memory(obs)


def test_a_mission_that_changes_within_an_episode():
    policy = make(RecurrentLearnerPolicy, "cells", words=5)
    obs = {"image": th.ones(4, 3, 5, 2, dtype=th.uint8), "mission": th.tensor([[1, 1], [1, 1], [2, 1], [2, 2]])}
    assert unpadded({name: part[:2] for name, part in obs.items()}, 1)[0].lengths.tolist() == [2]
    start = tuple(th.zeros(1, 2, policy.network.state_size) for _ in range(2))
    with pytest.raises(ValueError, match="a mission changed within an episode"):
        policy.evaluate_actions(obs, th.zeros(4), RNNStates(start, start), th.zeros(4))


@pytest.mark.parametrize("words", [0, 5])
def test_padding_is_no_blank_image(words):
    """The first image of an episode is all zeros, like the padding of RecurrentPPO."""
    policy = make(RecurrentLearnerPolicy, "cells", words)
    images = th.zeros(2, 3, 3, 5, 2, dtype=th.uint8)
    images[0, 1:] = 1
    obs, valid = {"image": images.flatten(0, 1)}, th.tensor([[True, True, True], [True, False, False]])
    if words:
        obs["mission"] = (th.tensor([2, 1, 0], dtype=th.uint8) * valid.unsqueeze(-1)).flatten(0, 1)
    sequences, _ = unpadded(obs, 2)
    assert sequences.lengths.tolist() == ([3, 1] if words else [3, 3])
    start = tuple(th.randn(1, 2, policy.network.state_size) for _ in range(2))
    with th.no_grad():
        values, *_ = policy.evaluate_actions(obs, th.zeros(6), RNNStates(start, start), th.zeros(6))
        state = start
        for step in range(3):
            now = {name: part.unflatten(0, (2, 3))[:, step] for name, part in obs.items()}
            value = policy.predict_values(now, state, th.zeros(2))
            _, state = policy.get_distribution(now, state, th.zeros(2))
            assert th.allclose(values.view(2, 3)[valid[:, step], step], value.flatten()[valid[:, step]], atol=1e-5)


def test_a_blank_image_within_a_window_is_a_frame():
    history = th.zeros(2, 3, 1, 1, 1, dtype=th.uint8)
    history[0, 1] = 1
    found = windows({"image": th.ones(2, 1, 1, 1, dtype=th.uint8), "history": history}).sequences()
    assert found.lengths.tolist() == [3, 1]
    assert found.images.flatten().tolist() == [1, 0, 1, 1]


@pytest.mark.parametrize("kind", ["cells", "pixels"])
def test_windows_of_turned_pictures(kind):
    env = make_vec_env(lambda: HistoryWrapper(Signal(kind, 5), 2), 2)
    model = PPO("GuidePolicy", env, n_steps=8, batch_size=16).learn(16)
    obs = {name: th.as_tensor(part) for name, part in model.get_env().reset().items()}
    assert windows(obs).images.shape[2:] == model.observation_space["image"].shape


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("policy_class", [LearnerPolicy, RecurrentGuidePolicy])
def test_an_agents_folder_holds_its_spaces(kind, policy_class, tmp_path):
    policy = make(policy_class, kind, words=5)
    save_agent(policy, tmp_path)
    loaded = load_agent(tmp_path)
    assert loaded.observation_space == policy.observation_space
    assert loaded.action_space == policy.action_space
    obs = {name: part.numpy() for name, part in sampled(policy.observation_space, 3).items()}
    assert np.array_equal(policy.predict(obs, deterministic=True)[0], loaded.predict(obs, deterministic=True)[0])


def test_bounds_that_differ_come_back_from_an_agents_folder(tmp_path):
    low, high = np.zeros((2, 2, 3), np.uint8), np.broadcast_to(np.array([4, 1, 9], np.uint8), (2, 2, 3))
    space = spaces.Dict({"image": spaces.Box(low, high, (2, 2, 3), np.uint8)})
    assert picture_of(space).values == (5, 2, 10)
    save_agent(LearnerPolicy(space, spaces.Discrete(3), lambda _: 1e-3), tmp_path)
    assert load_agent(tmp_path).observation_space == space


@pytest.mark.filterwarnings("ignore:.*has no checksum")
@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("actions", 10**9, "tells of 1000000000 actions: expected 1 to 16384"),
        ("actions", "two", "actions is 'two': expected int"),
        ("observation_space", {"image": {}}, "describes no observation space"),
        ("observation_space", [1], r"observation_space is \[1\]: expected dict"),
        (
            "observation_space",
            {"image": {"shape": [10**9] * 3, "dtype": "uint8", "low": 0, "high": 1}},
            "expected 1 to 8388608",
        ),
        ("observation_space", {"image": {"shape": [2, 2, 1], "dtype": "O", "low": 0, "high": 1}}, "of O: expected"),
        (
            "observation_space",
            {"image": {"shape": [2, 2, 1], "dtype": "uint8", "low": [0], "high": [1, 2, 3]}},
            "describes no",
        ),
        ("observation_space", {}, "the observation space has no image"),
    ],
)
def test_an_agents_folder_that_describes_impossible_spaces(name, value, message, tmp_path):
    save_agent(make(LearnerPolicy, "cells"), tmp_path)
    path = tmp_path / "agent.json"
    content = json.loads(path.read_text())
    del content["sha256"]
    path.write_text(json.dumps({**content, "format": 1, name: value}))  # of a version that had no checksum
    with pytest.raises(ValueError, match=message):
        load_agent(tmp_path)


@pytest.mark.parametrize("kind", ["pixels", "cells"])
def test_sb3s_zip_holds_the_spaces_too(kind, tmp_path):
    model = PPO("GuidePolicy", make_vec_env(lambda: Signal(kind), 2), n_steps=8, batch_size=16)
    model.save(tmp_path / "model")
    obs = model.get_env().reset()
    loaded = PPO.load(tmp_path / "model")
    assert np.array_equal(model.predict(obs, deterministic=True)[0], loaded.predict(obs, deterministic=True)[0])


def test_a_guide_that_saw_something_else(tmp_path):
    save_agent(make(GuidePolicy, "cells"), tmp_path)
    with pytest.raises(ValueError, match="the Guide was trained on other observations than Dict"):
        make(GuidePolicy, "flags", guide=tmp_path)


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({}, "the observation space has no image: expected a Dict with 'image'"),
        ({"image": spaces.Box(0, 1, (4, 4))}, "has no image: expected .* a Box of"),
        ({"image": spaces.Box(-1, 1, (4, 4, 1), np.int8)}, "cells go from -1 to 1: expected integers from 0"),
        (
            {"image": spaces.Box(0, 300, (4, 4, 1), np.int32)},
            "cells go from 0 to 300: expected integers from 0 to at most 255",
        ),
        ({"image": spaces.Box(-np.inf, np.inf, (4, 4, 1))}, "the image's values have no bounds"),
        ({"image": spaces.Box(0, 3, (200, 100, 1), np.uint8)}, "the image has 200 x 100 cells: expected at most 16384"),
        ({"mission": spaces.Text(10)}, "the mission is no row of tokens: .*TextMissionWrapper makes tokens of text"),
        ({"mission": spaces.Box(0, 1, (4,))}, "the mission is no row of tokens"),
        ({"direction": spaces.Discrete(4)}, "agents see image, mission and history, and no direction: leave it out"),
        ({"history": spaces.Box(0, 3, (2, 9), np.uint8)}, "the history is Box.*: expected"),
    ],
)
def test_spaces_that_agents_can_not_see(members, message):
    usual = {} if not members else {"image": spaces.Box(0, 3, (4, 4, 2), np.uint8)}
    with pytest.raises(ValueError, match=message):
        LearnerPolicy(spaces.Dict({**usual, **members}), spaces.Discrete(3), lambda _: 1e-3)


def test_actions_that_agents_can_not_take():
    space = Signal().observation_space
    for actions in (spaces.Box(0, 1, (2,)), spaces.Discrete(3, start=1)):
        with pytest.raises(ValueError, match="expected a Discrete space of at most 16384 that starts at 0"):
            LearnerPolicy(space, actions, lambda _: 1e-3)


def test_a_space_without_an_image_in_an_algorithm():
    with pytest.raises(ValueError, match=r"the observation space has no image: .* got Box\("):
        PPO("GuidePolicy", "CartPole-v1")


def test_a_mission_as_text_in_an_algorithm():
    with pytest.raises(
        ValueError, match=r"'mission' of the observations is MissionSpace.*sb3_guide\.envs\.TextMissionWrapper"
    ):
        PPO("GuidePolicy", "MiniGrid-DoorKey-5x5-v0")


def test_images_too_small_for_the_papers_pooling():
    space = spaces.Dict({"image": spaces.Box(0, 3, (1, 9, 2), np.uint8)})
    with pytest.raises(ValueError, match="pools images of 1 x 9 away: expected 3 x 3 and more"):
        LearnerPolicy(space, spaces.Discrete(3), lambda _: 1e-3, size="paper")
    LearnerPolicy(space, spaces.Discrete(3), lambda _: 1e-3)
