"""The success rate in SB3's own logs."""

import numpy as np
import pytest
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO

from sb3_guide.callbacks import SuccessRateCallback
from sb3_guide.envs import GuideGridVecEnv

LEVEL = "GuideGrid-GoToObj-v0"


class Watched(SuccessRateCallback):
    """Keeps what it sees, to be counted again by hand."""

    def _on_training_start(self) -> None:
        self.seen: list[bool] = []

    def _on_step(self) -> bool:
        self.seen += [info["is_success"] for info in self.locals["infos"] if "is_success" in info]
        return super()._on_step()


@pytest.mark.parametrize("algorithm", [PPO, A2C, RecurrentPPO])
def test_it_is_the_share_among_the_last_episodes(algorithm):
    callback = Watched()
    model = algorithm("LearnerPolicy", GuideGridVecEnv(LEVEL, 8, seed=0), n_steps=100, seed=0, stats_window_size=10)
    model.learn(800, callback=[callback])
    assert len(callback.seen) > 10
    assert model.logger.name_to_value["rollout/success_rate"] == np.mean(callback.seen[-10:])


def test_levels_that_do_not_tell_success_are_left_alone():
    callback = SuccessRateCallback()
    model = PPO("MlpPolicy", "CartPole-v1", n_steps=64, batch_size=64).learn(64, callback=callback)
    assert "rollout/success_rate" not in model.logger.name_to_value
