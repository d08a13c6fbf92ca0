"""The page that needs no server, and the GIF."""

import io
import json
import re

import numpy as np
import pytest
from PIL import Image

from sb3_guide.envs import ACTIONS, GuideGridEnv
from sb3_guide.playground.episode import Beginning
from sb3_guide.playground.export import Recording, data_of, gif_of, html_of, recorded
from sb3_guide.playground.pictures import draw_view
from sb3_guide.playground.session import Session

DATA = re.compile(r'<script type="application/json" id="data">(.*?)</script>', re.DOTALL)


@pytest.fixture(scope="module")
def session(cast) -> Session:
    """Two agents, of which one was told something, in the middle of an episode."""
    session = Session(cast, ["GoToLocal/guided", "GoToLocal/guide"], Beginning("GoToLocal", 3))
    session.step()
    session.say(0, 4, keep=True)
    session.step()
    return session


@pytest.fixture(scope="module")
def recordings(session) -> list[Recording]:
    return [recorded(seat) for seat in session.seats]


def test_the_page_holds_what_the_session_holds(session, recordings):
    (embedded,) = DATA.findall(html_of([recordings]))
    data = json.loads(embedded)
    assert data == json.loads(json.dumps(data_of([recordings])))
    for seat, shown in zip(session.seats, data["scenes"][0], strict=True):
        assert shown["agent"] == seat.name
        assert [turn["by_person"] for turn in shown["turns"]] == [turn.by_person for turn in seat.episode.turns]
        for moment, seen in zip(seat.episode.moments, shown["moments"], strict=True):
            lines = seen["lines"]
            assert [line["says"] for line in lines] == pytest.approx(moment.message_probabilities, abs=1e-4)
            assert [line["does"] for line in lines] == pytest.approx(moment.action_probabilities.max(axis=1), abs=1e-4)
            assert [ACTIONS.index(line["action"]) for line in lines] == moment.action_probabilities.argmax(axis=1).tolist()
    told = [[line["message"] for line in moment["lines"] if line["told"]] for moment in data["scenes"][0][0]["moments"]]
    assert told == [[], ["w1 w1"], ["w1 w1"], ["w1 w1"]]  # the last is what is kept from then on


def test_nothing_is_loaded_from_elsewhere(recordings):
    page = html_of([recordings])
    assert "://" not in page
    assert all(address.startswith("data:") for address in re.findall(r'(?:src|href)="(.*?)"', page))
    assert "default-src 'none'" in page
    assert len(page) < 100_000
    assert all(picture.startswith("data:image/png;base64,") for picture in data_of([recordings])["pictures"])


def test_each_picture_is_held_once(recordings):
    twice = data_of([recordings, recordings])
    assert twice["pictures"] == data_of([recordings])["pictures"]
    assert len(twice["scenes"]) == 2


def test_names_are_not_code(recordings):
    page = html_of([[recordings[0]._replace(agent="</script><script>alert(1)</script>")]])
    assert page.count("<script") == 2
    assert json.loads(DATA.findall(page)[0])["scenes"][0][0]["agent"] == "</script><script>alert(1)</script>"


def test_recording_changes_nothing(session, recordings):
    env = session.seats[0].episode.scene.env
    before = env.render()
    assert len(list(recordings[0].worlds)) == 4
    assert np.array_equal(recordings[0].worlds[-1], before)
    assert np.array_equal(env.render(), before)
    assert not np.array_equal(recordings[0].worlds[0], before)


def test_a_gif_of_the_episode(recordings):
    with Image.open(io.BytesIO(gif_of(recordings[0]))) as picture:
        assert (picture.format, picture.n_frames) == ("GIF", 4)


def test_the_view_shows_what_is_seen():
    env = GuideGridEnv("GoToLocal", history=0, render_mode="rgb_array")
    observation, _ = env.reset(seed=3)
    while env.agent_dir != 3:  # looking up, as in the view
        observation = env.step(np.int64(0))[0]
    column, row = env.agent_pos
    view, world = draw_view(observation["image"]), env.render()
    rows, columns = min(row, 6), min(column, 3)  # of the world, that are in the view, before the agent and to its left
    seen = view[(6 - rows) * 32 : 7 * 32, (3 - columns) * 32 : 4 * 32]
    assert np.array_equal(seen, world[(row - rows) * 32 : (row + 1) * 32, (column - columns) * 32 : (column + 1) * 32])
