"""One agent on the page that is served: pictures, what is said, what each message would do, and what was done."""

from collections.abc import Callable
from functools import partial

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement

from sb3_guide.playground.pictures import data_url
from sb3_guide.playground.session import Seat
from sb3_guide.playground.shown import Line, Part, percent, pictures_class, shown, turn_in_words

TURNS = 12  # that are listed, of those before and of those that are planned
KEYED = 9  # messages with a key of their own


def words(tag: str, text: str = "", classes: str = "") -> TextElement:
    """:return: an element with a text in it"""
    element = TextElement(tag=tag, text=text)
    element.classes(classes)
    return element


def sentence(parts: list[Part]) -> None:
    """Add a sentence, each part in the colour of who says or does it."""
    for part in parts:
        words("span", part.text, part.who)


class Share:
    """
    A probability as a number and a bar.

    :param classes: whose it is
    """

    def __init__(self, classes: str) -> None:
        with ui.element("span").classes(f"share {classes}"):
            self.what, self.number, self.bar = words("span", classes="what"), words("span"), ui.element("i")

    def show(self, what: str, share: float) -> None:
        """
        :param what: of what it is the probability
        :param share: from 0 to 1
        """
        self.what.set_text(what)
        self.number.set_text(percent(share))
        self.bar.style(f"--part: {share:.1%}")


class Row:
    """
    A message, which can be clicked.

    :param number: of its key, from 1
    :param say: called when it is clicked
    """

    def __init__(self, number: int, say: Callable[[], None]) -> None:
        with ui.element("button").classes("message").on("click", say) as self.button:
            with ui.element("span").classes("word"):
                if number <= KEYED:
                    words("kbd", str(number))
                self.message, self.meaning = words("b"), words("small")
            self.says, self.does = Share("says"), Share("does")

    def show(self, line: Line, ended: bool) -> None:
        """
        :param line: of the message
        :param ended: whether nothing can be said any more
        """
        self.message.set_text(line.message)
        self.meaning.set_text(line.meaning)
        self.says.show("you" if line.told else "Guide" if line.spoken else "", line.says)
        self.does.show(line.action, line.does)
        for name in ("spoken", "told", "differs"):
            self.button.classes(**{"add" if getattr(line, name) else "remove": name})
        self.button.props["title"] = f"If it heard {line.message}: {line.chances}"
        self.button.props.set_bool("disabled", ended)


class Panel:
    """
    An agent on the page.

    :param seat: of the agent
    :param say: called with the message that is clicked
    """

    def __init__(self, seat: Seat, say: Callable[[int], None]) -> None:
        speaker = seat.episode.speaker
        with ui.element("section").classes("seat"):
            with ui.element("header"):
                with ui.element("h2"):
                    words("span", seat.name)
                    words("span", speaker.kind, "soft")
                self.mission, self.status = words("p", classes="mission"), words("p", classes="soft")
            scene = seat.episode.scene
            with ui.element("div").classes(pictures_class(scene.world())):
                self.world = self._picture(scene.captions.world, "the world")
                self.view = self._picture(scene.captions.view, "the view of the agent")
            with ui.element("div").classes("speech"):
                self.speech = ui.element("p").props("aria-live=polite")
                with ui.element("div").classes("messages"):
                    with ui.element("div").classes("head"):
                        for text in ("Message, and what it means", "The Guide says it", "If heard, the agent chooses"):
                            words("span", text)
                    self.rows = [Row(number + 1, partial(say, number)) for number in range(speaker.shape.count)]
            self.past = ui.element("ol").classes("past").props('aria-label="what was heard, and what the agent did"')

    @staticmethod
    def _picture(caption: str, alt: str) -> ui.element:
        with ui.element("figure"):
            picture = ui.element("img").props(f'alt="{alt}"')
            words("figcaption", caption)
        return picture

    def show(self, seat: Seat) -> None:
        """Show the present moment."""
        episode = seat.episode
        now = shown(episode, len(episode.turns), seat.heard, seat.told is not None)
        self.mission.set_text(now.mission)
        self.status.set_text(now.status)
        self.world.props["src"] = data_url(episode.scene.world())
        self.view.props["src"] = data_url(episode.scene.view(episode.now.observation))
        self.speech.clear()
        with self.speech:
            sentence(now.speech)
        for row, line in zip(self.rows, now.lines, strict=True):
            row.show(line, bool(now.outcome))
        self._list_turns(seat)

    def _list_turns(self, seat: Seat) -> None:
        """The newest turns, and those that are planned."""
        episode, names = seat.episode, seat.episode.speaker.shape.names()
        self.past.clear()
        with self.past:
            if len(episode.turns) > TURNS:
                words("li", f"{len(episode.turns) - TURNS} before")
            for turn in episode.turns[-TURNS:]:
                words("li", turn_in_words(episode, turn), "by-you" if turn.by_person else "")
            for message in seat.plan[:TURNS]:
                words("li", names[message], "by-you planned")
