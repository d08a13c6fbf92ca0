"""Speaking to agents, with those that are shipped."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from stable_baselines3 import PPO

import sb3_guide
from sb3_guide.cloning import mission_seeds, play
from sb3_guide.envs import ACTIONS
from sb3_guide.language import ablate, ablations, learn, obey, overhear, perform, read, steps_of
from sb3_guide.language.analysis import change, structure
from sb3_guide.metrics import obedience
from sb3_guide.policies import RecurrentGuidePolicy
from sb3_guide.policies.interventions import Intervention
from tests.policies.helpers import make_policy

LEVEL, PAGE = "GoToLocal", Path(__file__).parents[2] / "docs" / "language.md"


@pytest.fixture(scope="module")
def policy():
    return sb3_guide.load_guided_learner(LEVEL)


@pytest.fixture(scope="module")
def reading(policy):
    return read(policy, LEVEL, mission_seeds("validation", 100))


@pytest.fixture(scope="module")
def dictionary(reading):
    return learn(reading)


def test_reading_says_what_was_said_and_done(policy, reading):
    episodes = play(policy, LEVEL, mission_seeds("validation", 100))
    assert (reading.episodes.actions == episodes.actions).all()
    frames, messages = len(episodes.actions), reading.shape.count
    assert reading.message_log_probs.shape == (frames, messages)
    assert reading.action_log_probs.shape == (frames, messages, len(ACTIONS))
    heard = reading.action_log_probs[np.arange(frames), reading.messages]
    assert (heard.argmax(dim=1).numpy() == episodes.actions).mean() > 0.999
    assert reading.episode[-1] == 99


def test_a_guide_that_always_says_the_same_has_a_language_without_structure(reading):
    mute = replace(reading, messages=np.zeros_like(reading.messages))
    for found in structure(mute).values():
        assert set(found.values()) == {None}
    spoken = structure(reading)["topographic_similarity"]
    assert spoken["low"] < spoken["value"] < spoken["high"]
    assert spoken["p_value"] < 0.01


def test_what_became_of_words(policy, reading):
    guide = read(sb3_guide.load_guide(LEVEL), LEVEL, mission_seeds("validation", 100))
    found = change(guide, reading)
    w0_w0, left = 0, ACTIONS.index("left")
    assert found["change"][w0_w0][left] == pytest.approx(0, abs=0.02)
    low, high = np.array(found["change_intervals"], dtype=float)
    known = ~np.isnan(low)
    assert (low[known] <= high[known]).all()
    assert np.abs(np.array(change(reading, reading)["change"], dtype=float)[w0_w0]).max() == 0


def test_the_agent_does_what_it_is_told(policy, dictionary):
    told = np.array(steps_of("forward, right\nright # twice", dictionary))[:, None].repeat(20, axis=1)
    taken = perform(policy, LEVEL, mission_seeds("analysis", 20), told).taken
    assert taken.shape == (3, 20)
    assert (taken == dictionary.meanings[told]).mean() > 0.7


def test_each_world_may_be_told_something_else(policy, dictionary):
    words = np.array([dictionary.message_for(ACTIONS.index(name)) for name in ("left", "right")])
    taken = perform(policy, LEVEL, mission_seeds("analysis", 40), words[np.arange(40) % 2][None]).taken[0]
    assert (taken == dictionary.meanings[words[np.arange(40) % 2]]).mean() > 0.7


def test_obedience_is_measured_the_same_each_time(policy, dictionary):
    once, again = (obey(policy, LEVEL, dictionary, mission_seeds("analysis", 20), np.random.default_rng(1)) for _ in range(2))
    assert np.array_equal(once, again)
    assert once[0].shape == (200,)
    assert obedience(*once)[0] > 0.6


def test_speak_is_predict_for_ones_own_loop(policy, dictionary):
    env = sb3_guide.GuideGridVecEnv(LEVEL, n_envs=3, history=0, seed=0)
    message = dictionary.shape.names()[dictionary.message_for(ACTIONS.index("left"))]
    actions, state = sb3_guide.speak(policy, env.reset(), message, episode_start=np.ones(3, dtype=bool))
    assert actions.shape == (3,)
    assert state is not None
    assert policy.channel.intervention == Intervention()


def test_a_model_of_sb3_is_spoken_to_as_well():
    model = PPO("GuidePolicy", "GuideGrid-GoToObj-v0", n_steps=8)
    actions, _ = sb3_guide.speak(model, model.get_env().reset(), (0, 2))
    assert actions.shape == (1,)


@pytest.mark.parametrize("message", ["w0", "w0 w3", "w0 w1 w2", "left", "w0 w-1", ""])
def test_no_message_of_this_agent(policy, message):
    obs = sb3_guide.GuideGridVecEnv(LEVEL, n_envs=1, history=0, seed=0).reset()
    with pytest.raises(ValueError, match="is no message of this agent: expected 2 words from w0 to w2"):
        sb3_guide.speak(policy, obs, message)


def test_an_agent_without_a_channel():
    model = sb3_guide.load_expert("GoToObj")
    with pytest.raises(ValueError, match="sends no messages"):
        sb3_guide.speak(model, model.get_env().reset(), "w0 w0")


def test_a_channel_without_symbols():
    policy = make_policy(RecurrentGuidePolicy, channel="continuous")
    obs = sb3_guide.GuideGridVecEnv(LEVEL, n_envs=1, history=0, seed=0).reset()
    for ask in (read, overhear, lambda *of: perform(*of, np.zeros((1, 2), dtype=np.int64))):
        with pytest.raises(ValueError, match="continuous channel are not made of symbols"):
            ask(policy, LEVEL, mission_seeds("validation", 2))
    with pytest.raises(ValueError, match="Chosen needs symbols, of which a continuous channel has none"):
        sb3_guide.speak(policy, obs, "w0 w0")


def test_choreographies_with_typos(dictionary):
    with pytest.raises(ValueError, match="step 'lefft' is unknown: expected one of left, right"):
        steps_of("left, lefft", dictionary)
    with pytest.raises(ValueError, match="is empty"):
        steps_of("# nothing\n", dictionary)


def test_what_is_overheard_is_what_is_read(policy, reading):
    overheard = overhear(policy, LEVEL, reading.episodes.seeds)
    assert np.array_equal(overheard.counts, learn(reading).counts)
    assert (overheard.shape, overheard.actions) == (reading.shape, reading.actions)


def test_ablations_are_paired_and_repeatable(policy, reading):
    chosen = {name: ablations(reading)[name] for name in ("spoken", "silent", "uniform")}
    seeds = mission_seeds("analysis", 60)
    once, again = (ablate(policy, LEVEL, seeds, chosen) for _ in range(2))
    assert all(np.array_equal(once[name], again[name]) for name in chosen)
    assert np.array_equal(once["spoken"], play(policy, LEVEL, seeds).successes)
    assert once["spoken"].mean() > 0.9
    assert once["silent"].mean() < 0.5


def test_how_often_the_agent_says_what(reading):
    assert sum(ablations(reading)["marginal"].probabilities) == pytest.approx(1)
    assert [name for name in ablations(reading) if name.startswith("swapped")] == ["swapped 0", "swapped 1"]


def test_the_example_of_the_docs():
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    scope: dict[str, object] = {}
    exec(code, scope)
    assert scope["actions"].shape == (2,)
