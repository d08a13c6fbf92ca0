"""Agents to disk and back."""

import copy
import functools
import json
import pickle
import shutil
import warnings

import numpy as np
import pytest
import torch as th
from stable_baselines3 import PPO

from sb3_guide.files import read_arrays, write_arrays
from sb3_guide.policies import (
    AgentPolicy,
    GuidedLearnerPolicy,
    GuidePolicy,
    LearnerPolicy,
    MessageShape,
    PretrainedGuide,
    RecurrentGuidedLearnerPolicy,
    RecurrentGuidePolicy,
    load_agent,
    save_agent,
)
from sb3_guide.policies.agents import LearnerAgent
from sb3_guide.policies.saving import POLICIES
from tests.policies.helpers import make_policy

LEVEL = "GuideGrid-GoToObj-v0"


@pytest.fixture
def guide(tmp_path):
    folder = tmp_path / "guide"
    save_agent(make_policy(GuidePolicy, message_length=1, vocabulary_size=4), folder, level="GoToObj")
    return folder


def same(one: AgentPolicy, other: AgentPolicy, obs) -> bool:
    with th.no_grad():
        return all(th.equal(a, b) for a, b in zip(one(obs, deterministic=True), other(obs, deterministic=True), strict=True))


@pytest.mark.parametrize(
    ("policy_class", "kwargs"),
    [
        (LearnerPolicy, {}),
        (LearnerPolicy, {"net_arch": [16], "activation_fn": th.nn.ReLU}),
        (GuidePolicy, {"message_length": 3, "vocabulary_size": 2}),
        (GuidePolicy, {"channel": "continuous"}),
    ],
)
def test_an_agents_folder_holds_all_of_it(tmp_path, window, policy_class, kwargs):
    policy = make_policy(policy_class, **kwargs)
    save_agent(policy, tmp_path, level="GoToObj")
    loaded = load_agent(tmp_path)
    assert type(loaded) is policy_class
    assert same(policy, loaded, window)
    description = json.loads((tmp_path / "agent.json").read_text())
    assert description["level"] == "GoToObj"
    assert {"sb3-guide", "torch", "stable-baselines3"} <= description["versions"].keys()


def test_a_guided_learners_folder_needs_no_guide(tmp_path, guide, window):
    policy = make_policy(GuidedLearnerPolicy, guide=guide, freeze_guide=True)
    save_agent(policy, tmp_path / "guided")
    shutil.rmtree(guide)
    loaded = load_agent(tmp_path / "guided")
    assert same(policy, loaded, window)
    assert not any(weight.requires_grad for weight in loaded.channel.speaker.parameters())


def test_the_guides_trunk_and_decoder_are_taken_over_and_the_encoder_is_new(guide):
    pretrained = load_agent(guide)
    th.nn.init.ones_(pretrained.channel.encoder.embedding.weight)  # as no new one has it
    save_agent(pretrained, guide)
    guided = make_policy(GuidedLearnerPolicy, guide=guide)
    old, new = pretrained.channel.speaker.state_dict(), guided.channel.speaker.state_dict()
    assert all(th.equal(old[name], new[name]) for name in old)
    assert not th.equal(pretrained.channel.encoder.embedding.weight, guided.channel.encoder.embedding.weight)
    assert all(weight.requires_grad for weight in guided.parameters())


def test_sb3s_zip_holds_the_guide_too(tmp_path, guide):
    pretrained = PretrainedGuide.from_folder(guide)
    model = PPO("GuidedLearnerPolicy", LEVEL, n_steps=16, batch_size=16, policy_kwargs={"guide": pretrained}, seed=0)
    model.learn(16)
    model.save(tmp_path / "model")
    shutil.rmtree(guide)
    loaded = PPO.load(tmp_path / "model")
    for name, weight in model.policy.state_dict().items():
        assert th.equal(weight, loaded.policy.state_dict()[name]), name


@pytest.mark.parametrize("policy", ["LearnerPolicy", "GuidePolicy"])
def test_sb3s_zip(tmp_path, policy):
    model = PPO(policy, LEVEL, n_steps=16, batch_size=16, seed=0).learn(16)
    model.save(tmp_path / "model")
    loaded = PPO.load(tmp_path / "model", env=model.get_env())
    obs = model.get_env().reset()
    assert model.predict(obs, deterministic=True)[0] == loaded.predict(obs, deterministic=True)[0]
    loaded.learn(16)


def test_a_copied_guide_says_what_it_said(guide):
    pretrained = PretrainedGuide.from_folder(guide)
    for copied in (copy.deepcopy(pretrained), pickle.loads(pickle.dumps(pretrained))):
        assert copied == pretrained
        assert all(th.equal(weight, copied.weights[name]) for name, weight in pretrained.weights.items())


def test_sb3s_zip_may_be_loaded_with_the_settings_it_was_saved_with(tmp_path, guide):
    settings = {"guide": PretrainedGuide.from_folder(guide)}
    PPO("GuidedLearnerPolicy", LEVEL, policy_kwargs=settings).save(tmp_path / "model")
    loaded = PPO.load(tmp_path / "model", policy_kwargs=settings)
    anew = PPO("GuidedLearnerPolicy", LEVEL, policy_kwargs=loaded.policy_kwargs)
    speakers = [model.policy.channel.speaker.state_dict() for model in (loaded, anew)]
    assert all(th.equal(weight, speakers[1][name]) for name, weight in speakers[0].items())


def test_what_can_not_be_loaded_again_is_not_saved(tmp_path):
    with pytest.raises(
        ValueError, match=r"PPO could not be loaded again: expected one of LearnerPolicy, .* such as model\.policy"
    ):
        save_agent(PPO("LearnerPolicy", LEVEL), tmp_path / "agent")
    policy = make_policy(LearnerPolicy, activation_fn=functools.partial(th.nn.LeakyReLU, 0.2))
    with pytest.raises(ValueError, match=r"activation_fn=.*LeakyReLU.* can't be loaded again"):
        save_agent(policy, tmp_path / "agent")
    assert not (tmp_path / "agent").exists()


def test_a_policy_of_ones_own_is_saved_where_it_can_be_loaded(tmp_path, monkeypatch):
    class Mine(GuidePolicy):
        pass

    policy = make_policy(Mine)
    with pytest.raises(ValueError, match=r"Mine could not be loaded again: .* sb3_guide\.policies\.saving\.POLICIES"):
        save_agent(policy, tmp_path / "agent")
    monkeypatch.setitem(POLICIES, "Mine", Mine)
    save_agent(policy, tmp_path / "agent")
    assert isinstance(load_agent(tmp_path / "agent"), Mine)


def test_a_guided_learner_without_a_guide():
    with pytest.raises(ValueError, match=r"guide=None is no Guide: a GuidedLearnerPolicy needs a pretrained one"):
        make_policy(GuidedLearnerPolicy)


def test_a_guide_of_the_other_memory_mode(guide):
    with pytest.raises(ValueError, match="RecurrentGuidedLearnerPolicy can't hear a GuidePolicy"):
        make_policy(RecurrentGuidedLearnerPolicy, guide=guide)


def test_a_learner_where_a_guide_is_expected(tmp_path):
    save_agent(make_policy(LearnerPolicy), tmp_path)
    with pytest.raises(ValueError, match="holds a LearnerPolicy: expected one of GuidePolicy, RecurrentGuidePolicy"):
        make_policy(GuidedLearnerPolicy, guide=tmp_path)


def test_a_guide_where_a_learner_is_expected(guide):
    with pytest.raises(ValueError, match="holds a GuidePolicy: expected one of LearnerPolicy, RecurrentLearnerPolicy"):
        load_agent(guide, LearnerAgent)


def test_a_folder_that_is_no_agents(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"is no agent's folder, as it lacks agent\.json"):
        load_agent(tmp_path)


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("network.safetensors", b"\0" * 100, r"network\.safetensors is damaged"),
        ("agent.json", b"{", r"agent\.json is no JSON"),
        ("agent.json", b"{}", "does not describe an agent"),
        ("agent.json", b'{"policy": "GuidePolicy", "kwargs": {}, "history": 3, "format": 99}', "has format 99: expected 2"),
        ("agent.json", b'{"policy": "GuidePolicy", "kwargs": {}, "history": 3}', "its files don't match its checksum"),
        ("agent.json", b'{"policy": ["GuidePolicy"], "kwargs": {}, "history": 3}', "policy is .*: expected str"),
        ("agent.json", b"[]", "holds a list: expected a dict"),
        ("agent.json", b"[" * 10**6, "is no JSON"),
        ("agent.json", b" " * 2**25, "has 33554432 bytes: expected at most"),
    ],
)
def test_damaged_files_are_named(guide, file, content, message):
    (guide / file).write_bytes(content)
    with pytest.raises(ValueError, match=message):
        load_agent(guide)


def flipped(content: bytes, bit: int) -> bytes:
    return content[: bit // 8] + bytes([content[bit // 8] ^ 1 << bit % 8]) + content[bit // 8 + 1 :]


@pytest.mark.parametrize("file", ["network.safetensors", "agent.json"])
def test_a_flipped_bit_is_noticed_wherever_it_is(guide, file):
    whole = (guide / file).read_bytes()
    for bit in np.random.default_rng(0).choice(8 * len(whole), 100, replace=False):
        (guide / file).write_bytes(flipped(whole, bit))
        with pytest.raises(ValueError, match=str(guide)):
            load_agent(guide)


def test_weights_of_one_agent_and_the_description_of_another(guide, tmp_path):
    other = load_agent(guide)
    th.nn.init.ones_(other.action_net.bias)
    save_agent(other, tmp_path / "other", level="GoToObj")
    shutil.copy(tmp_path / "other" / "network.safetensors", guide)
    with pytest.raises(ValueError, match="its files don't match its checksum"):
        load_agent(guide)


def as_before(folder, **changes) -> None:
    """Rewrite an agent's description as earlier versions wrote it: without checksum."""
    content = json.loads((folder / "agent.json").read_text())
    del content["sha256"]
    content["kwargs"] |= changes
    (folder / "agent.json").write_text(json.dumps({**content, "format": 1}))


def test_a_folder_of_an_earlier_version_is_read_with_a_warning_and_saved_anew(guide, window):
    policy = load_agent(guide)
    as_before(guide)
    with pytest.warns(UserWarning, match="has no checksum: make sure of where it is from, and save it anew"):
        loaded = load_agent(guide)
    assert same(policy, loaded, window)
    save_agent(loaded, guide)
    with warnings.catch_warnings(action="error"):
        load_agent(guide)


@pytest.mark.filterwarnings("ignore:.*has no checksum")
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"message_length": 10**9}, "expected a length of 1 to 100 and 2 to 10000 symbols"),
        ({"vocabulary_size": 10**9}, "expected a length of 1 to 100 and 2 to 10000 symbols"),
        ({"vocabulary_size": 4.0}, "expected a length of 1 to 100 and 2 to 10000 symbols"),
        ({"net_arch": [10**9]}, "expected ints, at most 8 layers of 1 to 2048 units"),
        ({"net_arch": [64] * 1000}, "expected ints, at most 8 layers of 1 to 2048 units"),
        ({"activation_fn": "Transformer"}, "activation_fn='Transformer' is no activation function"),
        ({"features_extractor_kwargs": {}}, "GuidePolicy takes no features_extractor_kwargs"),
        ({"guide": "somewhere/else"}, "guide='somewhere/else' is no description"),
        ({"size": "paper"}, "there is no place for"),
    ],
)
def test_what_a_description_may_ask_for(guide, changes, message):
    as_before(guide, **changes)
    with pytest.raises(ValueError, match=f"is damaged: its weights and its description don't fit .*{message}"):
        load_agent(guide)


@pytest.mark.filterwarnings("ignore:.*has no checksum")
@pytest.mark.parametrize("shape", [[10**9, 7, 3], [7, "x", 3], [], [7, 0, 3], [7, 7.0, 3]])
def test_what_an_observation_space_may_ask_for(guide, shape):
    as_before(guide)
    content = json.loads((guide / "agent.json").read_text())
    content["observation_space"]["image"]["shape"] = shape
    (guide / "agent.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match="is damaged: its weights and its description don't fit"):
        load_agent(guide)


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_weights_that_are_not_finite_are_neither_saved_nor_loaded(guide, number):
    policy = load_agent(guide)
    th.nn.init.constant_(policy.action_net.bias, number)
    with pytest.raises(ValueError, match=r"action_net\.bias of the agent in .* is not finite: its training diverged"):
        save_agent(policy, guide)
    load_agent(guide)
    weights = {name: np.full_like(weight, number) for name, weight in read_arrays(guide / "network.safetensors")[0].items()}
    write_arrays(guide / "network.safetensors", weights)
    as_before(guide)
    with pytest.warns(UserWarning, match="has no checksum"), pytest.raises(ValueError, match="is not finite"):
        load_agent(guide)


def test_no_more_memory_is_taken_than_the_file_is_long(guide):
    header = json.dumps({"weight": {"dtype": "F32", "shape": [10**10], "data_offsets": [0, 4 * 10**10]}}).encode()
    (guide / "network.safetensors").write_bytes(len(header).to_bytes(8, "little") + header)
    with pytest.raises(ValueError, match=r"network\.safetensors is damaged"):
        load_agent(guide)
    with (guide / "network.safetensors").open("wb") as file:
        file.truncate(2**40)  # a hole
    with pytest.raises(ValueError, match="has 1099511627776 bytes: expected at most 1073741824"):
        load_agent(guide)


def test_an_unknown_size():
    with pytest.raises(ValueError, match="size='huge' is unknown: expected one of 'compact', 'medium', 'paper'"):
        make_policy(RecurrentGuidePolicy, size="huge")


def test_an_agent_without_a_channel(window):
    with pytest.raises(ValueError, match="LearnerPolicy sends no messages"):
        make_policy(LearnerPolicy).message_log_probs(window)


def test_a_guided_learner_takes_the_form_of_its_guides_messages(tmp_path, window):
    save_agent(make_policy(GuidePolicy, message_length=1, vocabulary_size=5, channel="continuous"), tmp_path / "guide")
    save_agent(policy := make_policy(GuidedLearnerPolicy, guide=tmp_path / "guide"), tmp_path / "guided")
    loaded = load_agent(tmp_path / "guided")
    assert same(policy, loaded, window)
    assert loaded.channel.encoder.shape == MessageShape(1, 5, "continuous")
    assert not loaded.has_symbols
    with pytest.raises(ValueError, match=r"the Guide has .*'continuous'.*: expected .*'discrete'"):
        make_policy(GuidePolicy, guide=tmp_path / "guide", message_length=1, vocabulary_size=5)
