"""CIC while agents are trained."""

import math

import numpy as np
import pytest
import torch as th
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO

from sb3_guide.callbacks import CICCallback
from sb3_guide.callbacks.communication import carried_state
from sb3_guide.cloning import measure_communication
from sb3_guide.envs import GuideGridVecEnv
from sb3_guide.metrics import cic
from sb3_guide.policies import GuidePolicy, PretrainedGuide, RecurrentGuidePolicy, save_agent
from tests.callbacks.helpers import learn_and_log
from tests.policies.helpers import make_policy, random_images, random_missions

LEVEL = "GuideGrid-GoToObj-v0"
KEYS = {"guide/cic", "guide/uniform_cic", "guide/message_entropy", "guide/tempered_cic"}
SHORT = {"n_steps": 16, "seed": 0}


@pytest.mark.parametrize("algorithm", [PPO, A2C, RecurrentPPO])
@pytest.mark.parametrize("guided", [False, True])
def test_it_drops_into_any_on_policy_algorithm(algorithm, guided, tmp_path):
    save_agent(make_policy(RecurrentGuidePolicy if algorithm is RecurrentPPO else GuidePolicy), tmp_path)
    policy_kwargs = {"guide": PretrainedGuide.from_folder(tmp_path)} if guided else {}
    policy = "GuidedLearnerPolicy" if guided else "GuidePolicy"
    model = algorithm(policy, GuideGridVecEnv(LEVEL, 4), policy_kwargs=policy_kwargs, **SHORT)
    (row,) = learn_and_log(model, 64, [CICCallback()])[:1]
    values = {name: value for name, value in row.items() if name.startswith("guide/")}
    assert values.keys() == KEYS
    assert 0 <= values["guide/cic"] <= values["guide/message_entropy"] <= math.log(9) + 1e-6


def test_training_is_the_same_with_and_without_it():
    weights = []
    for callback in (None, CICCallback()):
        model = PPO("GuidePolicy", GuideGridVecEnv(LEVEL, 4), batch_size=32, **SHORT).learn(128, callback=callback)
        weights.append(model.policy.action_net.weight)
    assert th.equal(*weights)


def test_every_so_many_rollouts():
    model = PPO("GuidePolicy", GuideGridVecEnv(LEVEL, 4), batch_size=32, **SHORT)
    rows = learn_and_log(model, 5 * 64, [CICCallback(every_n_rollouts=2)])
    assert ["guide/cic" in row for row in rows] == [False, True, False, True, False]
    rows = learn_and_log(model, 2 * 64, [CICCallback(every_n_rollouts=2)], reset_num_timesteps=False)
    assert ["guide/cic" in row for row in rows] == [True, False]  # the sixth and the seventh, as if it had not been stopped


def test_carried_memory_is_what_the_policy_had_at_the_frame():
    model = RecurrentPPO("GuidePolicy", GuideGridVecEnv(LEVEL, 3), batch_size=24, n_epochs=1, **SHORT)
    callback = CICCallback()
    memories = []

    def keep() -> None:
        policy, buffer = model.policy, model.rollout_buffer
        step, world = np.array([0, 7, 15]), np.array([0, 2, 1])
        obs = {name: th.as_tensor(part[step, world]) for name, part in buffer.observations.items()}
        with th.no_grad():
            memories.append(policy.memory(obs, carried_state(policy, buffer, step, world)))
        after = th.as_tensor(buffer.hidden_states_pi[8, 0, 2])  # the state after step 7 is the one before step 8
        assert th.allclose(memories[0][1], after, atol=1e-5) or buffer.episode_starts[8, 2]

    callback._on_rollout_end = keep
    model.learn(48, callback=callback)
    assert len(memories) == 1


def test_averages_are_over_frames(monkeypatch):
    policy = make_policy(RecurrentGuidePolicy)
    th.nn.init.normal_(policy.action_net.weight)  # SB3 starts with hardly any influence
    monkeypatch.setattr("sb3_guide.policies.channel.ENUMERATED_AT_ONCE", 27)
    with th.no_grad():
        memory = policy.memory({"image": random_images(7), "mission": random_missions(7)})
        expected = cic(policy.channel.message_log_probs(memory), policy.listen(memory)).mean().item()
    assert measure_communication(policy, memory)["cic"] == pytest.approx(expected, rel=1e-5)


def test_an_agent_without_a_channel():
    with pytest.raises(ValueError, match="LearnerPolicy sends no messages"):
        PPO("LearnerPolicy", LEVEL, n_steps=16, batch_size=16).learn(16, callback=[CICCallback()])


def test_a_policy_that_is_not_ours():
    with pytest.raises(ValueError, match="CICCallback can't measure ActorCriticPolicy in PPO"):
        PPO("MlpPolicy", "CartPole-v1", n_steps=16, batch_size=16).learn(16, callback=[CICCallback()])


@pytest.mark.parametrize("kwargs", [{"n_frames": 0}, {"every_n_rollouts": 0}])
def test_numbers_must_be_positive(kwargs):
    with pytest.raises(ValueError, match=r"n_frames=.* and every_n_rollouts=.*: expected at least 1"):
        CICCallback(**kwargs)


def test_a_channel_without_symbols():
    model = PPO("GuidePolicy", LEVEL, n_steps=16, batch_size=16, policy_kwargs={"channel": "continuous"})
    with pytest.raises(ValueError, match="continuous channel are not made of symbols"):
        model.learn(16, callback=[CICCallback()])
