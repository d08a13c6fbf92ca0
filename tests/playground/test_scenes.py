"""Agents of environments that are not ours can be watched and spoken to as well."""

import gymnasium
import minigrid  # noqa: F401  # registers its environments
import numpy as np
import pytest
from sb3_contrib import RecurrentPPO

from sb3_guide.cloning import play
from sb3_guide.envs import TextMissionWrapper, Vocabulary
from sb3_guide.playground.cast import Cast
from sb3_guide.playground.episode import Beginning, Episode
from sb3_guide.playground.export import gif_of, html_of, recorded
from sb3_guide.playground.pictures import draw_image
from sb3_guide.playground.session import Session
from sb3_guide.policies import save_agent
from tests import toys

WORDS = Vocabulary.of(["use the key to open the door and then get to the goal"])


def door_key(render_mode=None):
    return TextMissionWrapper(gymnasium.make("MiniGrid-DoorKey-5x5-v0", render_mode=render_mode), WORDS)


gymnasium.register("WordsDoorKey-v0", door_key, max_episode_steps=12)
gymnasium.register("PixelSignal-v0", toys.Signal, kwargs={"kind": "pixels"})
OTHERS = ["Pick-v0", "PixelSignal-v0", "WordsDoorKey-v0"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Guides that have learned nothing yet."""
    folder = tmp_path_factory.mktemp("others")
    for env_id in OTHERS:
        guide = RecurrentPPO("GuidePolicy", env_id, n_steps=8, batch_size=8, seed=0)
        save_agent(guide.policy, folder / env_id, level=env_id)
    return folder


@pytest.fixture(scope="module")
def others(folder):
    return Cast([folder / env_id for env_id in OTHERS])


@pytest.mark.parametrize("env_id", OTHERS)
def test_left_alone_the_agent_plays_as_ever(folder, others, env_id):
    speaker = others.speaker(str(folder / env_id))
    episode = Episode(speaker, Beginning(env_id, 5))
    while not episode.now.outcome:
        episode.step()
    played = play(speaker.policy, env_id, np.array([5]))
    assert [turn.action for turn in episode.turns] == played.actions.tolist()
    assert (episode.now.outcome == "fulfilled") == played.successes[0]


@pytest.mark.parametrize("env_id", OTHERS)
def test_back_and_on_again_is_the_same(folder, others, env_id):
    session = Session(others, [str(folder / env_id)], Beginning(env_id, 3))
    episode = session.seats[0].episode
    session.step()
    pictures = [episode.scene.world()]
    foreseen = episode.now.action_probabilities.argmax(axis=1)
    for message in range(episode.speaker.shape.count):
        session.say(0, message, keep=False)
        assert episode.turns[-1].action == foreseen[message]
        session.back()
        assert np.array_equal(episode.scene.world(), pictures[0])
    again = Session.restored(others, session.query())
    assert np.array_equal(again.seats[0].episode.now.action_probabilities, episode.now.action_probabilities)


@pytest.mark.parametrize("env_id", OTHERS)
def test_what_is_saved(folder, others, env_id):
    session = Session(others, [str(folder / env_id)], Beginning(env_id, 3))
    while not session.ended:
        session.step()
    recording = recorded(session.seats[0])
    assert len(recording.worlds) == len(recording.views) == len(recording.turns) + 1
    assert gif_of(recording).startswith(b"GIF8")
    page = html_of([[recording]])
    assert "The world as you see it." in page
    assert ("in false colours" in page) == (env_id != "PixelSignal-v0")
    assert "Lighter" not in page
    assert f"trained on {env_id}" in page


def test_words_of_the_environment(folder, others):
    named = {env_id: Episode(others.speaker(str(folder / env_id)), Beginning(env_id, 0)) for env_id in OTHERS}
    missions = {env_id: episode.scene.mission(episode.now.observation) for env_id, episode in named.items()}
    assert missions["Pick-v0"] in ("mission 1", "mission 2")
    assert missions["PixelSignal-v0"] == "no mission"
    assert missions["WordsDoorKey-v0"] == "use the key to open the door and then get to the goal"
    assert named["Pick-v0"].speaker.dictionary.actions == ("left", "right")
    assert named["WordsDoorKey-v0"].scene.world().shape == (160, 160, 3)  # as Minigrid draws it


def test_cells_in_false_colours_and_pixels_as_they_are():
    kinds = toys.Signal.spaces_by_kind
    cells = np.zeros((3, 5, 2), np.uint8)
    cells[1, 2] = (2, 1)
    drawn = draw_image(cells, gymnasium.spaces.Dict({"image": kinds["cells"]}))
    assert drawn.shape == (3 * 44, 5 * 44, 3)
    assert drawn[44:88, 88:132].reshape(-1, 3).tolist() == [[255, 127, 0]] * 44 * 44
    assert drawn.sum() == (255 + 127) * 44 * 44
    pixels = np.random.default_rng(0).integers(0, 256, (36, 48, 3), np.uint8)
    first = gymnasium.spaces.Dict({"image": gymnasium.spaces.Box(0, 255, (3, 36, 48), np.uint8)})
    for image in (pixels, np.moveaxis(pixels, -1, 0)):  # SB3 turns what the policy observes, not what the environment shows
        assert np.array_equal(draw_image(image, first)[::4, ::4], pixels)


def test_agents_stay_where_they_can_play(folder, others):
    pick = str(folder / "Pick-v0")
    with pytest.raises(ValueError, match="an agent trained on Pick-v0 can't play PixelSignal-v0: expected Pick-v0"):
        Session(others, [pick], Beginning("PixelSignal-v0", 0))
    with pytest.raises(ValueError, match="play Pick-v0: expected GoToLocal, or another level of ours"):
        Session(others, [pick, "GoToLocal/guided"], Beginning("Pick-v0", 0))
    with pytest.raises(ValueError, match="expected none, as only levels of ours take one of your own"):
        Session(others, [pick], Beginning("Pick-v0", 0, "take the left one"))
    with pytest.raises(ValueError, match="unknown level 'CartPole-v1': expected one that the page offers, such as Pick-v0"):
        Session.restored(others, {"agent": pick, "level": "CartPole-v1"})


def test_an_environment_that_is_not_registered(folder, tmp_path):
    guide = RecurrentPPO("GuidePolicy", "Pick-v0", n_steps=8, batch_size=8)
    save_agent(guide.policy, tmp_path / "lost", level="Lost-v0")
    with pytest.raises(ValueError, match=r"(?s)unknown environment 'Lost-v0'.*PACKAGE:ID"):
        Cast([tmp_path / "lost"])
