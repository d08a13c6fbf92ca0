"""What one person watches: one agent or two on the same mission, what they are told, and the link that restores it all."""

import re
from collections.abc import Mapping, Sequence
from itertools import groupby, zip_longest

from sb3_guide.language import CHOREOGRAPHIES, danced, steps_of
from sb3_guide.playground.cast import Cast, levels_of
from sb3_guide.playground.episode import Beginning, Episode

LONGEST_TEXT = 2000  # characters of a choreography
LONGEST_ROW = 8000  # characters of messages in a link: one a step for as long as any level allows
MOST_STEPS = 5000  # more than any level allows
GUIDE = "g"  # stands in links for a message that the Guide spoke
NUMBERS = ("", "2")  # of the agents, in links


class Seat:
    """
    An agent at play, and what a person has it hear: what is planned, a message a step, then what is kept, then the Guide.

    :param name: of the agent
    :param episode: that it plays
    """

    def __init__(self, name: str, episode: Episode) -> None:
        self.name = name
        self.episode = episode
        self.plan: list[int] = []
        self.kept: int | None = None
        self._planned: list[bool] = []  # whether each turn was

    @property
    def told(self) -> int | None:
        """Index of the message that a person has it hear at the present moment; None for the Guide's."""
        return self.plan[0] if self.plan else self.kept

    @property
    def heard(self) -> int:
        """Index of the message that it hears at the present moment."""
        return self.episode.now.spoken if self.told is None else self.told

    def step(self, said: int | None) -> None:
        """
        :param said: index of what a person says right now; None goes on as planned
        """
        planned = said is None and bool(self.plan)
        self.episode.step(self.told if said is None else said)
        if planned:
            self.plan.pop(0)
        self._planned.append(planned)
        if self.episode.now.outcome:
            self.plan.clear()

    def back(self) -> None:
        """Undo the last turn; what was planned is planned again."""
        turn = self.episode.back()
        if self._planned.pop():
            self.plan.insert(0, turn.heard)

    def release(self) -> None:
        """Let the Guide speak again."""
        self.plan, self.kept = [], None


class Session:
    """
    One agent or two, whose time goes together.

    :param cast: to choose from
    :param names: of one or two agents
    :param beginning: of their episodes
    :raises ValueError: if there is no such agent, level or mission
    """

    def __init__(self, cast: Cast, names: Sequence[str], beginning: Beginning) -> None:
        self.cast = cast
        self.beginning = beginning
        self.time = 0
        self.seats = [Seat(name, Episode(cast.speaker(name), beginning)) for name in names]

    @property
    def names(self) -> list[str]:
        """Of the agents."""
        return [seat.name for seat in self.seats]

    @property
    def ended(self) -> bool:
        """Whether nobody can go on."""
        return all(seat.episode.now.outcome for seat in self.seats)

    def step(self, said: Mapping[int, int] | None = None) -> None:
        """
        Let all that can go on hear something and act.

        :param said: by seat, index of the message that a person says right now in the place of all that is planned
        """
        if self.ended:
            return
        for index, seat in enumerate(self.seats):
            if not seat.episode.now.outcome:
                seat.step((said or {}).get(index))
        self.time += 1

    def say(self, seat: int, message: int, keep: bool) -> None:
        """
        Say something to one agent, which acts on it, as all do.

        :param seat: which agent
        :param message: index of the message
        :param keep: go on saying it until released
        :raises ValueError: if there is no such message
        """
        listener = self.seats[seat]
        listener.episode.speaker.check([message])
        if listener.episode.now.outcome:
            return
        if keep:
            listener.plan, listener.kept = [], message
        self.step({seat: message})

    def release(self) -> None:
        """Let the Guides speak again."""
        for seat in self.seats:
            seat.release()

    def back(self) -> None:
        """Undo the last step."""
        if not self.time:
            return
        for seat in self.seats:
            if len(seat.episode.turns) == self.time:
                seat.back()
        self.time -= 1

    def choreograph(self, text: str) -> None:
        """
        Plan what everybody hears from now on.

        :param text: "pirouette", "waltz", or actions and messages separated by commas
        :raises ValueError: if a step is unknown, or an agent has no word for it; nothing has changed then
        """
        if len(text) > LONGEST_TEXT:
            raise ValueError(f"the choreography has {len(text)} characters: expected at most {LONGEST_TEXT}")
        plans = []
        for seat in self.seats:
            dictionary = seat.episode.speaker.dictionary
            script = danced(text, dictionary) if text in CHOREOGRAPHIES else text
            plans.append(steps_of(script, dictionary))
        for seat, plan in zip(self.seats, plans, strict=True):
            seat.plan = [] if seat.episode.now.outcome else plan

    def query(self) -> dict[str, str]:
        """:return: what a link holds, without what is empty"""
        found = {"level": self.beginning.level, "seed": str(self.beginning.seed), "mission": self.beginning.mission}
        for number, seat in zip(NUMBERS, self.seats, strict=False):
            found[f"agent{number}"] = seat.name
            found[f"told{number}"] = written([turn.heard if turn.by_person else None for turn in seat.episode.turns])
            found[f"plan{number}"] = written(list(seat.plan))
            found[f"keep{number}"] = "" if seat.kept is None else str(seat.kept)
        return {name: value for name, value in found.items() if value}

    @classmethod
    def restored(cls, cast: Cast, query: Mapping[str, str]) -> "Session":
        """
        :param cast: to choose from
        :param query: what a link holds
        :return: the session as it was when the link was made
        :raises ValueError: if the link is none of this playground's
        """
        names = [query[name] for name in ("agent", "agent2") if name in query]
        if not names:
            raise ValueError("the link names no agent: expected one such as ?agent=GoToLocal/guided&level=GoToLocal&seed=1")
        seed = query.get("seed", "0")
        if not re.fullmatch(r"\d{1,16}", seed):
            raise ValueError(f"world {seed[:20]!r}: expected a number, such as 7")
        home = cast.level(names[0])
        level = query.get("level", home)
        if level not in levels_of(home):
            raise ValueError(f"unknown level {level[:40]!r}: expected one that the page offers, such as {home}")
        beginning = Beginning(level, int(seed), query.get("mission", ""))
        session = cls(cast, names, beginning)
        told, plans, kept = (
            [messages(query.get(name + number, "")) for number in NUMBERS[: len(names)]] for name in ("told", "plan", "keep")
        )
        for seat, *lists in zip(session.seats, told, plans, kept, strict=True):
            seat.episode.speaker.check([message for row in lists for message in row if message is not None])
        for said in zip_longest(*told):
            session.step({index: message for index, message in enumerate(said) if message is not None})
        for seat, plan, keep in zip(session.seats, plans, kept, strict=True):
            seat.plan = [message for message in plan if message is not None]
            seat.kept = keep[0] if keep else None
        return session


def written(row: Sequence[int | None]) -> str:
    """
    :param row: of messages; None for the Guide's
    :return: such as "g*3,0,8*2"
    """
    runs = [(GUIDE if message is None else str(message), len(list(same))) for message, same in groupby(row)]
    return ",".join(text if times == 1 else f"{text}*{times}" for text, times in runs)


def messages(text: str) -> list[int | None]:
    """
    :param text: as :func:`written` writes it
    :raises ValueError: if it is too long, or nothing of that kind
    """
    row: list[int | None] = []
    for run in text[: LONGEST_ROW + 1].split(",") if text else []:
        match = re.fullmatch(rf"({GUIDE}|\d{{1,4}})(?:\*(\d{{1,4}}))?", run)
        times = int(match[2] or 1) if match else 0
        if match is None or len(text) > LONGEST_ROW or len(row) + times > MOST_STEPS:
            raise ValueError(f"the messages {text[:40]!r} of the link are none: expected such as '{GUIDE}*3,0,8*2'")
        row += [None if match[1] == GUIDE else int(match[1])] * times
    return row
