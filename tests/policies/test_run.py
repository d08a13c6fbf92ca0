"""The policies in SB3's and sb3-contrib's algorithms, by their names."""

import pytest
import torch as th
from sb3_contrib import RecurrentPPO
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from stable_baselines3 import A2C, PPO
from stable_baselines3.common.vec_env import VecNormalize

from sb3_guide.envs import GuideGridVecEnv
from sb3_guide.policies import GuidePolicy, PretrainedGuide, RecurrentGuidePolicy, save_agent
from sb3_guide.policies.interventions import Silent
from tests.policies.helpers import make_policy

LEVEL = "GuideGrid-GoToLocal-v0"
ALGORITHMS = {PPO: {"n_steps": 16, "batch_size": 32, "n_epochs": 2}, A2C: {}, RecurrentPPO: {"n_steps": 16, "batch_size": 32}}


@pytest.fixture
def guide_of(tmp_path):
    for policy_class in (GuidePolicy, RecurrentGuidePolicy):
        save_agent(make_policy(policy_class), tmp_path / policy_class.__name__)
    return lambda algorithm: tmp_path / ("RecurrentGuidePolicy" if algorithm is RecurrentPPO else "GuidePolicy")


@pytest.mark.parametrize("policy", ["LearnerPolicy", "GuidePolicy", "GuidedLearnerPolicy"])
@pytest.mark.parametrize("algorithm", ALGORITHMS, ids=lambda algorithm: algorithm.__name__)
def test_every_policy_learns_in_every_algorithm(algorithm, policy, guide_of):
    kwargs = {"guide": PretrainedGuide.from_folder(guide_of(algorithm))} if policy == "GuidedLearnerPolicy" else {}
    model = algorithm(policy, GuideGridVecEnv(LEVEL, 4), seed=0, policy_kwargs=kwargs, **ALGORITHMS[algorithm])
    before = {name: weight.clone() for name, weight in model.policy.named_parameters()}
    model.learn(128)
    unchanged = {name.split(".")[-2] for name, weight in model.policy.named_parameters() if th.equal(weight, before[name])}
    assert unchanged == ({"inverse_temperature"} if policy == "GuidePolicy" else set())  # of what no gradient passes through


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("key", ["image", "mission"])
def test_normalised_observations_are_refused(key, seed):
    env = VecNormalize(GuideGridVecEnv(LEVEL, 4, seed=seed), norm_obs_keys=[key])
    with pytest.raises(ValueError, match=r"have values from .*: expected whole numbers from 0 to \d+.* norm_obs=False"):
        PPO("LearnerPolicy", env, n_steps=32).learn(128)


@pytest.mark.parametrize("algorithm", [PPO, RecurrentPPO])
def test_what_the_network_decides_is_no_setting(algorithm):
    settings = {"share_features_extractor": False, "features_extractor_class": object}
    settings |= {"lstm_hidden_size": 32, "n_lstm_layers": 2} if algorithm is RecurrentPPO else {}
    for name, value in settings.items():
        with pytest.raises(ValueError, match=f"policy_kwargs have {name}, which the agent's own network decides"):
            algorithm("LearnerPolicy", LEVEL, policy_kwargs={name: value})


def test_a_single_environment_by_its_id():
    model = PPO("GuidePolicy", LEVEL, n_steps=32, batch_size=32).learn(32)
    assert model.num_timesteps == 32


@pytest.mark.parametrize("policy", ["LearnerPolicy", "GuidePolicy"])
def test_the_same_seed_gives_the_same_weights(policy):
    one, same, other = (
        PPO(policy, GuideGridVecEnv(LEVEL, 4), n_steps=16, batch_size=32, seed=s).learn(128) for s in (0, 0, 1)
    )
    weights = [model.policy.action_net.weight for model in (one, same, other)]
    assert th.equal(weights[0], weights[1])
    assert not th.equal(weights[0], weights[2])


def test_collecting_and_training_see_the_same_function():
    """PPO's ratio is 1 before the first update: nothing depends on the training mode or on chance."""
    model = PPO("GuidePolicy", GuideGridVecEnv(LEVEL, 4), n_steps=16, batch_size=64, n_epochs=1, seed=0).learn(64)
    data = next(iter(model.rollout_buffer.get(64)))
    model = PPO("GuidePolicy", GuideGridVecEnv(LEVEL, 4), n_steps=16, batch_size=64, n_epochs=1, seed=0)
    for training in (True, False):
        model.policy.set_training_mode(training)
        _, log_prob, _ = model.policy.evaluate_actions(data.observations, data.actions.long().flatten())
        assert th.allclose(log_prob, data.old_log_prob, atol=1e-5)


@pytest.mark.parametrize("policy_class", [GuidePolicy, RecurrentGuidePolicy])
def test_a_guide_that_learns_from_reward_draws_its_messages(policy_class, window):
    policy = make_policy(policy_class)
    th.nn.init.normal_(policy.channel.speaker.decoder.logits.weight)
    zeros = th.zeros(1, 4, policy.network.state_size)
    carried = {"lstm_states": RNNStates((zeros, zeros), (zeros, zeros)), "episode_starts": th.ones(4)}
    of_mode = carried if policy.carries_memory else {}
    memory = policy.memory(window, (zeros, zeros))
    spoken, heard = policy.channel.message_log_probs(memory).exp(), policy.listen(memory).exp()  # (4, 9), (4, 9, 7)
    for action in range(7):
        _, log_prob, _ = policy.evaluate_actions(window, th.full((4,), action), **of_mode)
        assert th.allclose(log_prob.exp(), (spoken * heard[:, :, action]).sum(dim=1), atol=1e-6)
    with policy.hearing(Silent()):
        _, log_prob, _ = policy.evaluate_actions(window, th.full((4,), 6), **of_mode)
        assert th.allclose(log_prob.exp(), heard[:, 0, 6], atol=1e-6)


@pytest.mark.parametrize("kwargs", [{"message_length": 7}, {"channel": "continuous"}], ids=str)
def test_a_guide_whose_messages_can_not_be_enumerated_learns_too(kwargs):
    PPO("GuidePolicy", GuideGridVecEnv(LEVEL, 2), n_steps=16, batch_size=32, policy_kwargs=kwargs).learn(32)


def test_a_frozen_guide_stays_as_it_is(guide_of):
    guide = PretrainedGuide.from_folder(guide_of(PPO))
    kwargs = {"guide": guide, "freeze_guide": True}
    model = PPO("GuidedLearnerPolicy", GuideGridVecEnv(LEVEL, 4), n_steps=16, batch_size=32, policy_kwargs=kwargs).learn(64)
    speaker = model.policy.channel.speaker.state_dict()
    assert all(th.equal(speaker[name], weight) for name, weight in guide.weights.items())


def test_other_heads():
    kwargs = {"net_arch": {"pi": [32, 32], "vf": [16]}, "activation_fn": th.nn.ReLU, "ortho_init": False}
    PPO("GuidePolicy", GuideGridVecEnv(LEVEL, 2), n_steps=16, batch_size=32, policy_kwargs=kwargs).learn(32)
