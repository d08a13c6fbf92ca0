"""Callbacks in environments that are not ours."""

import gymnasium
import pytest
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import configure
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sb3_guide.callbacks import CICCallback, LanguageCallback
from sb3_guide.envs import HistoryWrapper
from tests.toys import Signal


@pytest.fixture(scope="module", autouse=True)
def registered():
    gymnasium.register("SignalSeen-v0", lambda: HistoryWrapper(Signal("pixels", words=5), 2))
    yield
    del gymnasium.registry["SignalSeen-v0"]


@pytest.mark.parametrize("algorithm", [PPO, RecurrentPPO])
def test_communication_is_measured_and_shown_anywhere(algorithm, tmp_path):
    model = algorithm("GuidePolicy", make_vec_env("SignalSeen-v0", 2), n_steps=8, batch_size=16, seed=0)
    model.set_logger(configure(str(tmp_path), ["tensorboard"]))
    model.learn(16, callback=[CICCallback(), LanguageCallback("SignalSeen-v0", n_episodes=3, every_n_rollouts=1)])
    events = EventAccumulator(str(tmp_path)).Reload()
    assert {"guide/cic", "guide/uniform_cic", "guide/message_entropy"} <= set(events.Tags()["scalars"])
    assert events.Tags()["histograms"] == ["guide/messages"]
    assert "guide/actions" in events.Tags()["images"]
