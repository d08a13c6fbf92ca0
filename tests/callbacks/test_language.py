"""Pictures of a language in TensorBoard."""

import io

import pytest
import torch as th
from PIL import Image
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO
from stable_baselines3.common.logger import configure
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sb3_guide.callbacks import LanguageCallback
from sb3_guide.envs import GuideGridVecEnv
from sb3_guide.speakers import speaker_folder

LEVEL = "GuideGrid-GoToObj-v0"


def learn(algorithm, callback, folder=None):
    model = algorithm("GuidePolicy", GuideGridVecEnv(LEVEL, 4), n_steps=16, seed=0)
    model.set_logger(configure(str(folder) if folder else None, ["tensorboard", "csv"] if folder else []))
    return model.learn(128, callback=callback, log_interval=1)


@pytest.mark.parametrize("algorithm", [PPO, A2C, RecurrentPPO])
def test_tensorboard_shows_messages_and_what_follows_them(algorithm, tmp_path):
    learn(algorithm, LanguageCallback("GoToObj", n_episodes=4, every_n_rollouts=2), tmp_path)
    events = EventAccumulator(str(tmp_path), size_guidance={"histograms": 0, "images": 0})
    events.Reload()
    (histogram,) = events.Histograms("guide/messages")
    assert histogram.histogram_value.num > 0
    (picture,), (clip,) = events.Images("guide/actions"), events.Images("guide/episode")
    assert picture.encoded_image_string.startswith(b"\x89PNG")
    assert clip.encoded_image_string.startswith(b"GIF89a")
    assert picture.step == clip.step == 2 * 4 * 16
    assert (clip.width, clip.height) == Image.open(io.BytesIO(clip.encoded_image_string)).size
    assert "guide/actions" not in (tmp_path / "progress.csv").read_text()


def test_training_is_the_same_with_and_without_it():
    without, watched = (learn(PPO, callback) for callback in (None, LanguageCallback("GoToObj", 4, 1)))
    weights = [list(model.policy.parameters()) for model in (without, watched)]
    assert all(th.equal(a, b) for a, b in zip(*weights, strict=True))


def test_not_even_where_the_channel_draws():
    weights = []
    for callback in (None, LanguageCallback("GoToObj", 4, 1)):
        settings = {"guide": speaker_folder("GoToObj", "guide"), "hears": "uniform"}
        model = RecurrentPPO(
            "GuidedLearnerPolicy", GuideGridVecEnv(LEVEL, 4, history=0), n_steps=16, seed=0, policy_kwargs=settings
        )
        model.learn(128, callback=callback)
        weights.append(list(model.policy.parameters()))
    assert all(th.equal(a, b) for a, b in zip(*weights, strict=True))


def test_an_agent_without_a_channel():
    model = PPO("LearnerPolicy", GuideGridVecEnv(LEVEL, 2), n_steps=8)
    with pytest.raises(ValueError, match="sends no messages"):
        model.learn(16, callback=LanguageCallback("GoToObj"))


def test_a_channel_without_symbols():
    model = PPO("GuidePolicy", GuideGridVecEnv(LEVEL, 2), n_steps=8, policy_kwargs={"channel": "continuous"})
    with pytest.raises(ValueError, match="continuous channel are not made of symbols"):
        model.learn(16, callback=LanguageCallback("GoToObj"))


def test_numbers_are_positive():
    with pytest.raises(ValueError, match="n_episodes=0 and every_n_rollouts=10: expected at least 1 of each"):
        LanguageCallback("GoToObj", n_episodes=0)
