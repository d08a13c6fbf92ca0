"""Callbacks in environments that are not ours."""

import gymnasium
import pytest
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from sb3_guide.callbacks import CICCallback, LanguageCallback
from sb3_guide.envs import HistoryWrapper
from tests.callbacks.helpers import learn_and_log
from tests.toys import Signal


@pytest.fixture(scope="module", autouse=True)
def registered():
    gymnasium.register("SignalSeen-v0", lambda: HistoryWrapper(Signal("pixels", words=5), 2))
    yield
    del gymnasium.registry["SignalSeen-v0"]


@pytest.mark.parametrize("algorithm", [PPO, RecurrentPPO])
def test_communication_is_measured_and_shown_anywhere(algorithm):
    model = algorithm("GuidePolicy", make_vec_env("SignalSeen-v0", 2), n_steps=8, batch_size=16, seed=0)
    rows = learn_and_log(model, 16, [CICCallback(), LanguageCallback("SignalSeen-v0", n_episodes=3, every_n_rollouts=1)])
    assert {"guide/cic", "guide/uniform_cic", "guide/message_entropy", "guide/messages", "guide/actions"} <= rows[-1].keys()
    panel, *_ = rows[-1]["guide/actions"].figure.axes
    assert [label.get_text() for label in panel.get_xticklabels()] == ["north", "east", "south", "west"]
