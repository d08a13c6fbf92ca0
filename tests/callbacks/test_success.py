"""The success rate in SB3's own logs."""

import numpy as np
import pytest
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO

from sb3_guide.callbacks import StopTrainingOnSuccessRate, SuccessRateCallback
from sb3_guide.envs import GuideGridVecEnv
from tests.callbacks.helpers import learn_and_log

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
    model = algorithm("LearnerPolicy", GuideGridVecEnv(LEVEL, 8, seed=0), n_steps=100, seed=0, stats_window_size=5)
    rows = learn_and_log(model, 800, [callback])
    assert len(callback.seen) > 5
    assert rows[-1]["rollout/success_rate"] == np.mean(callback.seen[-5:])


def test_levels_that_do_not_tell_success_are_left_alone():
    model = PPO("MlpPolicy", "CartPole-v1", n_steps=64, batch_size=64)
    assert all("rollout/success_rate" not in row for row in learn_and_log(model, 64, SuccessRateCallback()))


def test_training_stops_once_enough_of_the_last_episodes_succeeded(capsys):
    stop, watched = StopTrainingOnSuccessRate(0.5, n_episodes=4, verbose=1), Watched()
    model = PPO("LearnerPolicy", GuideGridVecEnv(LEVEL, 8, seed=0), n_steps=16, batch_size=64, n_epochs=1, seed=0)
    model.learn(100_000, callback=[watched, stop])
    rates = [np.mean(watched.seen[end - 4 : end]) for end in range(4, len(watched.seen) + 1)]
    assert model.num_timesteps < 100_000
    assert rates[-1] >= 0.5
    assert "of the last 4 episodes succeeded" in capsys.readouterr().out


def test_it_waits_for_all_the_episodes_it_looks_at():
    stop, watched = StopTrainingOnSuccessRate(0.01, n_episodes=20), Watched()
    model = PPO("LearnerPolicy", GuideGridVecEnv(LEVEL, 4, seed=0), n_steps=16, batch_size=64, n_epochs=1, seed=0)
    model.learn(10_000, callback=[watched, stop])
    assert len(watched.seen) >= 20


def test_another_training_is_judged_by_its_own_episodes():
    stop, watched = StopTrainingOnSuccessRate(0.01, n_episodes=20), Watched()
    for model in [PPO("LearnerPolicy", GuideGridVecEnv(LEVEL, 4, seed=0), n_steps=16, seed=0) for _ in range(2)]:
        for _ in range(2):
            model.learn(10_000, callback=[watched, stop])
            assert len(watched.seen) >= 20
    kept = list(stop.successes)
    model.learn(0, callback=stop, reset_num_timesteps=False)  # which goes on with the same training
    assert list(stop.successes) == kept


@pytest.mark.parametrize("kwargs", [{"success_rate": 0}, {"success_rate": 99}, {"success_rate": 0.9, "n_episodes": 0}])
def test_numbers_out_of_range(kwargs):
    with pytest.raises(ValueError, match="expected"):
        StopTrainingOnSuccessRate(**kwargs)
