"""What a person can do with an episode, without any page."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3 import PPO

from sb3_guide.cloning import play
from sb3_guide.envs import ACTIONS
from sb3_guide.playground.cast import Cast
from sb3_guide.playground.episode import Beginning, Episode, Moment
from sb3_guide.playground.session import Session, messages, written
from sb3_guide.playground.shown import shown
from sb3_guide.policies import save_agent

PAGE = Path(__file__).parents[2] / "docs" / "playground.md"
GUIDED, GUIDE = "GoToLocal/guided", "GoToLocal/guide"
WORLD = Beginning("GoToLocal", 3)


def same(a: Moment, b: Moment) -> bool:
    """:return: whether two moments are the same to the bit"""
    arrays = [(a.message_probabilities, b.message_probabilities), (a.action_probabilities, b.action_probabilities)]
    arrays += [(a.world[name], b.world[name]) for name in a.world]
    arrays += [(a.observation[name], b.observation[name]) for name in a.observation]
    arrays += list(zip(a.memory or (), b.memory or (), strict=True))
    return a.spoken == b.spoken and a.outcome == b.outcome and all(np.array_equal(x, y) for x, y in arrays)


@pytest.mark.parametrize("name", [GUIDED, GUIDE, "PickupLoc/guided", "PutNextLocal/guide"])
def test_left_alone_the_agent_plays_as_ever(cast, name):
    speaker, level = cast.speaker(name), cast.level(name)
    for seed in range(3):
        episode = Episode(speaker, Beginning(level, seed))
        while not episode.now.outcome:
            episode.step()
        played = play(speaker.policy, level, np.array([seed]))
        assert [turn.action for turn in episode.turns] == played.actions.tolist()
        assert (episode.now.outcome == "fulfilled") == played.successes[0]


@pytest.mark.parametrize("name", [GUIDED, GUIDE])
def test_the_table_says_what_each_message_does(cast, name):
    speaker = cast.speaker(name)
    episode = Episode(speaker, WORLD)
    for _ in range(3):
        foreseen = episode.now.action_probabilities.argmax(axis=1)
        assert len(set(foreseen.tolist())) > 1
        for message in range(speaker.shape.count):
            episode.step(message)
            assert episode.back().action == foreseen[message]
        episode.step()
        assert episode.turns[-1].action == foreseen[episode.moments[-2].spoken]


def test_agents_with_a_window_for_a_memory(tmp_path):
    model = PPO(
        "GuidePolicy",
        "GuideGrid-GoToObj-v0",
        n_steps=8,
        batch_size=8,
        policy_kwargs={"message_length": 1, "vocabulary_size": 4},
        seed=0,
    )
    save_agent(model.policy, tmp_path / "agent")
    cast = Cast([tmp_path / "agent"], "GoToObj")
    session = Session.restored(cast, cast.first)
    (seat,) = session.seats
    assert seat.episode.now.action_probabilities.shape == (4, len(ACTIONS))
    for message in range(4):
        foreseen = seat.episode.now.action_probabilities[message].argmax()
        session.say(0, message, keep=False)
        assert seat.episode.turns[-1].action == foreseen
    before = seat.episode.now
    session.step()
    session.back()
    assert same(before, seat.episode.now)
    assert all(np.array_equal(before.world[name], array) for name, array in seat.episode.scene.env.get_state().items())


def test_back_is_exact(cast):
    session = Session(cast, [GUIDED], WORLD)
    (seat,) = session.seats
    for message in (None, 0, None, 4, 8):
        session.step({} if message is None else {0: message})
    once = list(seat.episode.moments)
    for _ in range(3):
        session.back()
    assert same(seat.episode.now, once[2])
    assert all(np.array_equal(once[2].world[name], array) for name, array in seat.episode.scene.env.get_state().items())
    for message in (None, 4, 8):
        session.step({} if message is None else {0: message})
    assert all(same(a, b) for a, b in zip(once, seat.episode.moments, strict=True))
    for _ in range(9):
        session.back()
    assert session.time == len(seat.episode.turns) == 0


def test_once_until_released_and_as_planned(cast):
    session = Session(cast, [GUIDED], WORLD)
    (seat,) = session.seats
    session.say(0, 0, keep=False)
    assert (seat.episode.turns[-1].heard, seat.told) == (0, None)
    session.say(0, 4, keep=True)
    session.step()
    assert [turn.heard for turn in seat.episode.turns] == [0, 4, 4]
    session.choreograph("left, w2 w2")
    assert seat.plan == [0, 8]
    session.step()
    session.back()
    assert seat.plan == [0, 8]  # undone, so it is planned again
    session.step()
    session.step()
    session.step()
    assert [turn.heard for turn in seat.episode.turns] == [0, 4, 4, 0, 8, 4]
    session.release()
    session.step()
    assert not seat.episode.turns[-1].by_person


def test_two_agents_share_the_time(cast):
    session = Session(cast, [GUIDED, GUIDE], WORLD)
    guided, guide = session.seats
    while not session.ended:
        session.step()
    assert (len(guided.episode.turns), len(guide.episode.turns), session.time) == (7, 6, 7)
    session.step()
    session.back()
    assert (guided.episode.now.outcome, guide.episode.now.outcome) == ("", "fulfilled")
    session.back()
    assert (len(guided.episode.turns), len(guide.episode.turns), guide.episode.now.outcome) == (5, 5, "")
    session.say(1, 0, keep=False)
    assert [seat.episode.turns[-1].by_person for seat in session.seats] == [False, True]
    session.choreograph("pirouette")
    assert [len(seat.plan) for seat in session.seats] == [4, 4]


def test_the_mission_of_a_person(cast):
    session = Session(cast, [GUIDED], Beginning("GoToLocal", 3, " Go to the  grey key"))
    while not session.ended:
        session.step()
    assert session.seats[0].episode.now.outcome == "fulfilled"
    assert session.seats[0].episode.scene.env.mission == "go to the grey key"
    away = Episode(cast.speaker(GUIDED), Beginning("GoToLocal", 3, "go to the yellow ball"))
    assert "is not there" in shown(away, 0, 0, False).status


OPERATIONS = st.lists(st.sampled_from(["step", "back", "say", "keep", "release", "dance"]), max_size=12)


@settings(max_examples=15, deadline=None)
@given(operations=OPERATIONS, heard=st.integers(0, 8), mission=st.sampled_from(["", "go to the red box"]))
def test_a_link_restores_what_is_seen(cast, operations, heard, mission):
    session = Session(cast, [GUIDED, GUIDE], Beginning("GoToLocal", 3, mission))
    for operation in operations:
        {
            "step": session.step,
            "back": session.back,
            "say": lambda: session.say(0, heard, keep=False),
            "keep": lambda: session.say(1, heard, keep=True),
            "release": session.release,
            "dance": lambda: session.choreograph("left, w2 w2, left"),
        }[operation]()
    again = Session.restored(cast, session.query())
    assert again.query() == session.query()
    for seat, other in zip(session.seats, again.seats, strict=True):
        assert same(seat.episode.now, other.episode.now)
        assert (seat.heard, seat.plan, seat.kept) == (other.heard, other.plan, other.kept)


@given(st.lists(st.none() | st.integers(0, 1023), max_size=50))
def test_messages_in_links(row):
    assert messages(written(row)) == row


LINK = {"agent": GUIDED, "level": "GoToLocal", "seed": "3"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"agent": "../../etc"}, "there is no agent '../../etc': expected one of GoToObj/guided"),
        ({"agent2": "GoToMars/guide"}, "there is no agent 'GoToMars/guide'"),
        ({"level": "GoToMars"}, "unknown level 'GoToMars'"),
        ({"seed": "-1"}, "world '-1': expected a number"),
        ({"seed": "9" * 16}, "world 9999999999999999: expected a number from 0 to 9007199254740991"),
        ({"seed": "9" * 5000}, "expected a number, such as 7"),
        ({"mission": "go to the moon"}, "'go to the moon' is no mission"),
        ({"mission": "a" * 500}, "the mission has 500 characters: expected at most 400"),
        ({"told": "g*2,9"}, "message 9 of this agent: expected 0 to 8"),
        ({"told": "left"}, "the messages 'left' of the link are none: expected such as 'g*3,0,8*2'"),
        ({"told": "g*9999"}, "are none: expected such as"),
        ({"told": "0," * 5000}, "are none: expected such as"),
        ({"plan": "0*3,77"}, "message 77 of this agent"),
        ({"keep": "-1"}, "the messages '-1' of the link are none"),
    ],
)
def test_links_that_are_none(cast, change, message):
    with pytest.raises(ValueError, match=r"(?s)^.{0,400}$") as caught:
        Session.restored(cast, {**LINK, **change})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_link_without_an_agent(cast):
    with pytest.raises(ValueError, match=r"the link names no agent: expected one such as \?agent="):
        Session.restored(cast, {"level": "GoToLocal"})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("left, lefft", "step 'lefft' is unknown: expected one of left, right"),
        ("", "the choreography is empty"),
        ("toggle", "no word for 'toggle'"),
        ("w0 w3", "step 'w0 w3' is unknown"),
        ("left," * 1000, "the choreography has 5000 characters: expected at most 2000"),
        ("/etc/passwd", "step '/etc/passwd' is unknown"),
    ],
)
def test_choreographies_with_typos(cast, text, message):
    session = Session(cast, [GUIDED], WORLD)
    with pytest.raises(ValueError, match=message):
        session.choreograph(text)
    assert session.seats[0].plan == []


def test_nothing_is_said_after_the_end(cast):
    session = Session(cast, [GUIDED], Beginning("GoToLocal", 7))
    session.step()
    assert session.ended
    session.say(0, 0, keep=True)
    session.choreograph("left")
    assert (session.time, session.seats[0].plan, session.seats[0].kept) == (1, [], None)
    with pytest.raises(ValueError, match="message 9 of this agent: expected 0 to 8"):
        session.say(0, 9, keep=False)


def test_the_example_of_the_docs():
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    scope: dict[str, object] = {}
    exec(code, scope)
    assert len(scope["episode"].turns) == 1


def test_what_is_shown_of_a_moment(cast):
    session = Session(cast, [GUIDED], WORLD)
    (seat,) = session.seats
    now = seat.episode.now
    seen = shown(seat.episode, 0, 0, by_person=True)
    assert (seen.mission, seen.status, seen.outcome) == ("go to the red key", "Step 0 of at most 64", "")
    assert [line.says for line in seen.lines] == pytest.approx(now.message_probabilities.tolist(), abs=1e-4)
    assert [line.does for line in seen.lines] == pytest.approx(now.action_probabilities.max(axis=1).tolist(), abs=1e-4)
    assert [line.message for line in seen.lines if line.spoken] == ["w2 w2"]
    assert [line.message for line in seen.lines if line.told] == ["w0 w0"]
    likeliest = now.action_probabilities.argmax(axis=1)
    assert [line.differs for line in seen.lines] == (likeliest != likeliest[now.spoken]).tolist()
    spoken = "".join(part.text for part in seen.speech).replace("\N{NO-BREAK SPACE}", " ")
    assert spoken == "The Guide says w2 w2 (57 %), but you say w0 w0; hearing it, the agent chooses left (84 %)."
