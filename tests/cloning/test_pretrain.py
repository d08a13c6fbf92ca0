"""Any recurrent policy is cloned, and goes on under RecurrentPPO."""

import numpy as np
import pytest
import torch as th
from sb3_contrib import RecurrentPPO
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure

from sb3_guide import GuideGridVecEnv
from sb3_guide.cloning.bc import EpisodeLoader, EpisodeLoss, distribution_along
from sb3_guide.cloning.pretrain import pretrain
from sb3_guide.policies import FiLMExtractor
from sb3_guide.policies.sequences import Sequences
from tests.cloning.helpers import make_demonstrations, make_episodes

SMALL = {"features_extractor_class": FiLMExtractor, "lstm_hidden_size": 8}
VARIANTS = [
    {},
    {"enable_critic_lstm": False, "shared_lstm": True},
    {"n_lstm_layers": 2, "net_arch": [16]},
    {"share_features_extractor": False},
]


def make_model(policy: str = "MultiInputLstmPolicy", **policy_kwargs) -> RecurrentPPO:
    env = GuideGridVecEnv("GuideGrid-GoToObj-v0", n_envs=2, history=0)
    return RecurrentPPO(policy, env, n_steps=8, batch_size=16, n_epochs=1, seed=0, policy_kwargs=policy_kwargs)


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_loss_is_that_of_sb3_contribs_own_evaluation(variant):
    policy, episodes = make_model(**SMALL, **variant).policy, make_episodes([3, 1, 4])
    (batch,) = EpisodeLoader(episodes, 3, seed=0)
    obs = {name: th.as_tensor(part) for name, part in batch["obs"].items()}
    acts = th.as_tensor(batch["acts"])
    expected = []
    for row, length in enumerate(obs["length"].tolist()):
        frames = {"image": obs["image"][row, :length], "mission": obs["mission"][[row]].expand(length, -1)}
        nothing = tuple(th.zeros(policy.lstm_actor.num_layers, 1, policy.lstm_actor.hidden_size) for _ in range(2))
        starts = th.tensor([1.0] + [0.0] * (length - 1))
        with th.no_grad():
            _, log_prob, _ = policy.evaluate_actions(frames, acts[row, :length], RNNStates(nothing, nothing), starts)
        expected += log_prob.tolist()
    loss = EpisodeLoss(0.0, th.Generator(), "float32")(policy, obs, acts)
    assert loss.neglogp.item() == pytest.approx(-np.mean(expected), rel=1e-4)
    valid = th.arange(acts.shape[1]) < obs["length"].unsqueeze(1)
    sequences = Sequences(obs["image"][valid], obs["mission"], obs["length"])
    assert distribution_along(policy, sequences, valid, th.Generator()).log_prob(acts[valid]).tolist() == pytest.approx(
        expected, abs=1e-5
    )


@pytest.mark.parametrize(("policy", "policy_kwargs"), [("MultiInputLstmPolicy", SMALL), ("GuidePolicy", {})])
def test_a_model_is_cloned_into_and_goes_on_with_its_log(policy, policy_kwargs, tmp_path):
    model, demonstrations = make_model(policy, **policy_kwargs), make_demonstrations([3, 2, 4, 3])
    demonstrations.episodes.actions[:] = 5
    model.set_logger(configure(str(tmp_path), ["csv"]))
    pretrain(model, demonstrations, n_epochs=30, batch_size=4, learning_rate=1e-2)
    obs = {name: np.asarray(part) for name, part in model.env.reset().items()}
    actions, _ = model.predict(obs, deterministic=True)
    assert actions.tolist() == [5, 5]
    assert not model.policy.optimizer.state
    model.learn(16)
    columns = (tmp_path / "progress.csv").read_text().splitlines()[0].split(",")
    assert {"bc/neglogp", "time/total_timesteps"} <= set(columns)
    model.save(tmp_path / "model")
    loaded = RecurrentPPO.load(tmp_path / "model")
    assert th.equal(loaded.policy.action_net.weight, model.policy.action_net.weight)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (lambda env: PPO("MultiInputPolicy", env), "MultiInputActorCriticPolicy has no memory: expected a recurrent policy"),
        (lambda env: PPO("LearnerPolicy", env), "LearnerPolicy remembers windows: expected RecurrentLearnerPolicy"),
    ],
)
def test_what_can_not_be_cloned(model, message):
    env = GuideGridVecEnv("GuideGrid-GoToObj-v0", n_envs=1, history=0)
    with pytest.raises(ValueError, match=message):
        pretrain(model(env), make_demonstrations([2]), n_epochs=1, batch_size=1)


def test_demonstrations_have_no_history():
    env = GuideGridVecEnv("GuideGrid-GoToObj-v0", n_envs=1, history=3)
    with pytest.raises(ValueError, match="expected image and mission alone, as with history=0"):
        pretrain(RecurrentPPO("LearnerPolicy", env), make_demonstrations([2]), n_epochs=1, batch_size=1)
