"""From level to level in one training."""

import numpy as np
import pytest
import torch as th
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecMonitor

from sb3_guide.callbacks import Curriculum
from sb3_guide.envs import GuideGridVecEnv
from tests.callbacks.helpers import learn_and_log

LEVEL = "GuideGrid-GoToLocal-v0"
ROLLOUT = 8 * 16
PARTS = [
    {"level": "GoToObj", "n_timesteps": 2 * ROLLOUT},
    {"level": "GoToObjMazeS4", "n_timesteps": 1, "gamma": 0.9, "gae_lambda": 0.8, "learning_rate": 0.003},
    {"level": "GoToLocal", "n_timesteps": 4 * ROLLOUT, "learning_rate": "lin_0.001", "ent_coef": 0.5},
    {"level": "GoToObj", "n_timesteps": 2 * ROLLOUT},
]


def build(algorithm, venv):
    kwargs = {} if algorithm is A2C else {"batch_size": 64, "n_epochs": 1}
    return algorithm("LearnerPolicy", venv, n_steps=16, learning_rate=0.002, ent_coef=0.1, gamma=0.99, seed=0, **kwargs)


class Diary(BaseCallback):
    """What was true when each rollout ended."""

    def _on_training_start(self) -> None:
        self.rows: list[tuple[str, float, float, float, float]] = []

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        model = self.model
        (level,) = {level.name for level in model.env.get_attr("level")}
        self.rows.append(
            (level, model.lr_schedule(0.0), model.ent_coef, model.rollout_buffer.gamma, model.rollout_buffer.gae_lambda)
        )


@pytest.mark.parametrize("algorithm", [PPO, A2C, RecurrentPPO])
def test_parts_follow_each_other_with_their_rates(algorithm):
    diary = Diary()
    model = build(algorithm, VecMonitor(GuideGridVecEnv(LEVEL, 8)))
    lam = model.gae_lambda
    model.learn(100 * ROLLOUT, callback=[Curriculum(PARTS), diary])
    assert diary.rows == [
        ("GoToObj", 0.002, 0.1, 0.99, lam),
        ("GoToObj", 0.002, 0.1, 0.99, lam),
        ("GoToObjMazeS4", 0.003, 0.1, 0.9, 0.8),
        ("GoToLocal", 0.001, 0.5, 0.99, lam),
        ("GoToLocal", 0.00075, 0.5, 0.99, lam),
        ("GoToLocal", 0.0005, 0.5, 0.99, lam),
        ("GoToLocal", 0.00025, 0.5, 0.99, lam),
        ("GoToObj", 0.002, 0.1, 0.99, lam),
    ]  # the training stops at the last step of the second rollout here
    assert model.num_timesteps == 9 * ROLLOUT


def test_another_training_begins_at_the_first_part():
    curriculum, diary = Curriculum([{"level": "GoToObj", "n_timesteps": ROLLOUT, "ent_coef": 0.5}, PARTS[-1]]), Diary()
    first, second = (build(PPO, GuideGridVecEnv(LEVEL, 8)) for _ in range(2))
    second.ent_coef = 0.2
    for model, usual in ((first, 0.1), (second, 0.2), (second, 0.2)):
        model.learn(100 * ROLLOUT, callback=[curriculum, diary])
        assert [row[2] for row in diary.rows] == [0.5, usual]


def test_a_part_is_over_once_enough_of_its_own_episodes_succeeded():
    curriculum = Curriculum(
        [{"level": "GoToObj", "success_rate": 0.25}, {"level": "GoToObjMaze", "n_timesteps": 1}], n_episodes=8
    )
    model = build(PPO, GuideGridVecEnv(LEVEL, 8))
    rows = learn_and_log(model, 200 * ROLLOUT, [curriculum])
    assert model.env.level.name == "GoToObjMaze"
    assert curriculum.position == 1
    assert not curriculum.successes
    assert rows[-1]["curriculum/part"] == 0
    assert 8 <= curriculum.first_frame < 200 * ROLLOUT


def test_the_worlds_are_those_of_the_level():
    """After a change of level, the same streams give what they give where it was that level from the beginning."""
    venv, fresh = GuideGridVecEnv("GoToObjMaze", 4), GuideGridVecEnv("GoToObjMazeS4", 4, seed=7)
    venv.reset()
    venv.env_method("set_level", "GoToObjMazeS4")
    with pytest.raises(ValueError, match="before the first reset"):
        venv.step(np.zeros(4, dtype=int))
    venv.seed(7)
    ours, theirs = venv.reset(), fresh.reset()
    actions = np.random.default_rng(0).integers(0, 7, size=(300, 4))
    for action in actions:
        assert all(np.array_equal(ours[name], theirs[name]) for name in theirs)
        (ours, *_), (theirs, *_) = venv.step(action), fresh.step(action)


def test_it_works_in_sb3s_own_worlds():
    def weights(venv):
        return build(PPO, venv).learn(100 * ROLLOUT, callback=Curriculum(PARTS)).policy.state_dict()

    ours, theirs = weights(VecMonitor(GuideGridVecEnv(LEVEL, 8))), weights(make_vec_env(LEVEL, 8))
    assert all(th.equal(ours[name], theirs[name]) for name in ours)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([], "a curriculum of no parts: expected at least one"),
        ([{"level": "GoToMars", "n_timesteps": 1}], "unknown level 'GoToMars'"),
        ([{"level": "GoTo"}], "the part in GoTo has no end: expected success_rate, n_timesteps or both"),
        ([{"level": "GoTo", "success_rate": 99}], "success_rate=99: expected a number from 0 to 1"),
        ([{"level": "GoTo", "n_timesteps": 0}], "n_timesteps=0: expected a number from 1"),
        ([{"level": "GoTo", "n_steps": 5}], "a part of a curriculum has n_steps: expected some of level, "),
        ([{"level": "GoTo", "n_timesteps": 9, "learning_rate": "exp_1"}], "schedule 'exp_1' is unknown"),
        ([{"level": "GoTo", "n_timesteps": 9, "gamma": 7.0}], "gamma=7.0: expected a number from 0 to 1"),
        ([{"level": "GoTo", "n_timesteps": "200"}], "n_timesteps='200': expected a number from 1"),
        ([{"level": "GoTo", "n_timesteps": 9, "learning_rate": [1]}], r"learning_rate=\[1\]: expected a number from 0"),
        ([{"level": "GoTo", "n_timesteps": 9, "learning_rate": -3}], "learning_rate=-3: expected a number from 0"),
        ([{"level": "GoTo", "success_rate": 1, "learning_rate": "lin_1"}], "has no end: expected n_timesteps too"),
    ],
)
def test_parts_that_are_not_possible(parts, message):
    with pytest.raises(ValueError, match=message):
        Curriculum(parts)
