"""The page that is served: what a person does on it becomes a step of the session, and what the session holds is shown."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from fastapi import Request
from nicegui import app, events, run, ui
from nicegui.elements.mixins.text_element import TextElement
from starlette.middleware.trustedhost import TrustedHostMiddleware

from sb3_guide.envs import LEVELS
from sb3_guide.language import CHOREOGRAPHIES
from sb3_guide.playground.cast import Cast
from sb3_guide.playground.episode import HIGHEST_SEED, LONGEST_MISSION, Beginning
from sb3_guide.playground.export import gif_of, html_of, recorded
from sb3_guide.playground.pictures import data_url, draw_view
from sb3_guide.playground.session import LONGEST_TEXT, Seat, Session
from sb3_guide.playground.shown import AGENT, GUIDE, YOU, Line, Part, percent, shown, turn_in_words

STYLE = (Path(__file__).parent / "templates" / "style.css").read_text(encoding="utf-8")
TITLE = "What the Guide says, and what the agent makes of it"
LOOPBACK = ("127.0.0.1", "localhost")
NOBODY = "nobody"
SPEEDS = {1.2: "slow", 0.5: "brisk", 0.15: "fast"}  # seconds a step
TURNS = 12  # that are listed
KEYED = 9  # messages with a key of their own
LEAD = [
    [
        Part("The red triangle has a mission, and sees no more than the seven by seven cells before it. At each step a "),
        Part("Guide", GUIDE),
        Part(" looks at the same cells and says two words. Nobody taught it these words: they came to mean something because "),
        Part("an agent", AGENT),
        Part(" that hears them has to get along."),
    ],
    [
        Part("What do they mean? For each message you see how probable it is that the Guide says it, and what the agent would do "),
        Part("if it heard it. "),
        Part("Click a message", YOU),
        Part(" to say it in the Guide's place; where it would make the agent act otherwise, that is "),
        Part("in this colour", YOU),
        Part("."),
    ],
]
KEYS = [("→", "step"), ("←", "back"), ("P", "play or pause"), ("1–9", "say a message"), ("Esc", "let the Guide speak"), ("R", "restart")]


def words(tag: str, text: str = "", classes: str = "") -> TextElement:
    """:return: an element with a text in it"""
    element = TextElement(tag=tag, text=text)
    element.classes(classes)
    return element


def sentence(parts: list[Part]) -> None:
    """Add a sentence, each part in the colour of who says or does it."""
    for part in parts:
        words("span", part.text, part.who)


class Row:
    """
    A message on the page, which can be clicked.

    :param number: of its key, from 1
    :param say: called when it is clicked
    """

    def __init__(self, number: int, say: Callable[[], None]) -> None:
        with ui.element("button").classes("message").on("click", say) as self.button:
            with ui.element("span").classes("word"):
                words("kbd", str(number)) if number <= KEYED else words("span")
                self.message = words("b")
                self.meaning = words("small")
            self.says = self._share("says")
            self.does = self._share("does")

    @staticmethod
    def _share(classes: str) -> tuple[TextElement, TextElement, ui.element]:
        with ui.element("span").classes(f"share {classes}"):
            return words("span", classes="what"), words("span"), ui.element("i")

    def show(self, line: Line, ended: bool) -> None:
        """
        :param line: of the message
        :param ended: whether nothing can be said any more
        """
        self.message.set_text(line.message)
        self.meaning.set_text(line.meaning)
        who = "you" if line.told else "Guide" if line.spoken else ""
        for (what, number, bar), text, share in ((self.says, who, line.says), (self.does, line.action, line.does)):
            what.set_text(text)
            number.set_text(percent(share))
            bar.style(f"--part: {share:.1%}")
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
                    words("span", f" {speaker.kind}", "soft")
                self.mission = words("p", classes="mission")
                self.status = words("p", classes="soft")
            with ui.element("div").classes("pictures"):
                self.world = self._picture("The world as you see it. Lighter: what the agent sees.", "the world from above")
                self.view = self._picture("All that the agent sees. It stands below, looking up.", "the view of the agent")
            with ui.element("div"):
                self.speech = ui.element("p").classes("speech").props("aria-live=polite")
                with ui.element("div").classes("messages"):
                    with ui.element("div").classes("head"):
                        for text in ("Message, and what it means", "The Guide says it", "If heard, the agent would go for"):
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
        note = "" if episode.possible else ". Something that it speaks of is not there, so it can't be fulfilled"
        self.mission.set_text(now.mission)
        self.status.set_text(now.status + note)
        self.world.props["src"] = data_url(episode.env.render())
        self.view.props["src"] = data_url(draw_view(episode.now.observation["image"]))
        self.speech.clear()
        with self.speech:
            sentence(now.speech)
        for row, line in zip(self.rows, now.lines, strict=True):
            row.show(line, bool(now.outcome))
        self._list_turns(seat)

    def _list_turns(self, seat: Seat) -> None:
        episode = seat.episode
        self.past.clear()
        with self.past:
            if len(episode.turns) > TURNS:
                words("li", f"{len(episode.turns) - TURNS} before")
            for turn in episode.turns[-TURNS:]:
                words("li", turn_in_words(episode, turn), "by-you" if turn.by_person else "")
            if seat.plan:
                coming = ", ".join(episode.speaker.shape.names()[message] for message in seat.plan[:TURNS])
                words("li", f"you will say {coming}{', ...' if len(seat.plan) > TURNS else ''}", "by-you")


class Page:
    """
    The page of one person.

    :param cast: to choose from
    """

    def __init__(self, cast: Cast) -> None:
        self.cast = cast
        self.session: Session | None = None
        self.panels: list[Panel] = []
        self._requests = 0  # for a session; the newest wins
        ui.add_css(STYLE)
        ui.add_css(".nicegui-content { padding: 0; }")
        with ui.element("main").classes("play"):
            words("h1", "What does the Guide say, and what does the agent make of it?")
            for parts in LEAD:
                with ui.element("p").classes("lead"):
                    sentence(parts)
            self._fields()
            self.problem = words("p", classes="problem").props("role=alert")
            self._bar()
            self.seats = ui.element("div").classes("seats")
            with ui.element("p").classes("soft keys"):
                for key, use in KEYS:
                    words("kbd", key)
                    words("span", f" {use}   ")
        ui.keyboard(self.key, ignore=["input", "select", "textarea"])
        self.timer = ui.timer(0.5, self.tick, active=False)

    def _fields(self) -> None:
        """What is played: a change begins anew."""
        with ui.element("div").classes("fields"):
            self.agent = ui.select(list(self.cast.folders), label="Agent").on("update:model-value", self.agent_chosen)
            self.other = ui.select([NOBODY, *self.cast.folders], label="Compare with", value=NOBODY)
            self.level = ui.select(list(LEVELS), label="Level")
            self.seed = ui.number("World number", min=0, max=HIGHEST_SEED, precision=0, step=1)
            for select in (self.other, self.level):
                select.on("update:model-value", self.begin)
            self.seed.on("change", self.begin)
        with ui.element("div").classes("fields"):
            self.mission = ui.input("A mission of your own", placeholder="such as: go to the red ball").classes("wide")
            self.mission.props(f"maxlength={LONGEST_MISSION} stack-label").on("change", self.begin)
            self.dance = ui.input("A choreography", placeholder="such as: forward, forward, w0 w0", autocomplete=list(CHOREOGRAPHIES))
            self.dance.classes("wide").props(f"maxlength={LONGEST_TEXT} stack-label").on("keydown.enter", self.choreograph)
            with self.dance.add_slot("append"):
                ui.button("Dance", on_click=self.choreograph).props("flat dense no-caps")

    def _bar(self) -> None:
        """What happens next."""
        with ui.element("div").classes("bar"):
            for text, action in (("Back", self.back), ("Step", self.step)):
                ui.button(text, on_click=action).props("outline no-caps")
            self.run = ui.button("Play", on_click=self.play_or_pause).props("unelevated no-caps")
            self.speed = ui.select(SPEEDS, value=0.5).props('dense borderless aria-label="speed"')
            ui.button("Restart", on_click=self.restart).props("flat no-caps")
            self.keep = ui.checkbox("keep saying what I click")
            self.freed = ui.button("Let the Guide speak", on_click=self.release).props("flat no-caps")
            ui.element("span").classes("spring")
            for text, action in (("Save GIF", self.save_gif), ("Save page", self.save_page), ("Copy link", self.copy_link)):
                ui.button(text, on_click=action).props("flat dense no-caps")

    @contextmanager
    def telling(self) -> Iterator[Session | None]:
        """Do something with the session, tell what was wrong about it, and show what came of it."""
        self.problem.set_text("")
        try:
            yield self.session
        except ValueError as error:
            self.problem.set_text(str(error))
        self.show()

    async def restore(self, query: dict[str, str]) -> None:
        """
        :param query: of the link that the page was opened by
        """
        try:
            await self.take(lambda: Session.restored(self.cast, query))
        except ValueError as error:
            await self.take(lambda: Session.restored(self.cast, self.cast.first))
            self.problem.set_text(str(error))

    async def take(self, make: Callable[[], Session]) -> None:
        """
        Show another session, which may take a while to make, as agents are loaded when they first play.

        :param make: that session
        :raises ValueError: as it does
        """
        self.pause()
        self._requests += 1
        request = self._requests
        session = await run.io_bound(make)
        if request == self._requests:
            self.session = session
            self.fill_in(session)
            self.seats.clear()
            with self.seats.classes(**{"add" if len(session.seats) > 1 else "remove": "two"}):
                self.panels = [Panel(seat, partial(self.say, index)) for index, seat in enumerate(session.seats)]
            self.show()

    def fill_in(self, session: Session) -> None:
        """Let the fields say what is played."""
        self.agent.value, self.other.value = (*session.names, NOBODY)[:2]
        self.level.value, self.seed.value = session.beginning.level, session.beginning.seed
        self.mission.value = session.beginning.mission

    def show(self) -> None:
        """Show the present moment, and let the address say it."""
        if self.session is not None:
            for panel, seat in zip(self.panels, self.session.seats, strict=True):
                panel.show(seat)
            if self.session.ended:
                self.pause()
            self.freed.set_visibility(any(seat.told is not None for seat in self.session.seats))
            ui.run_javascript(f"history.replaceState(null, '', {json.dumps(link_of(self.session))})")

    async def agent_chosen(self) -> None:
        """Another agent plays where it was trained."""
        self.level.value = self.cast.level(self.agent.value)
        await self.begin()

    async def begin(self) -> None:
        """Begin what the fields say."""
        self.problem.set_text("")
        names = [name for name in (self.agent.value, self.other.value) if name != NOBODY]
        level, seed, mission = self.level.value, int(self.seed.value or 0), self.mission.value or ""
        try:
            await self.take(lambda: Session(self.cast, names, Beginning(level, seed, mission.strip())))
        except ValueError as error:
            self.problem.set_text(str(error))

    async def restart(self) -> None:
        """Begin the same anew."""
        session = self.session
        if session is not None:
            await self.take(lambda: Session(self.cast, session.names, session.beginning))

    def step(self) -> None:
        """Go on by a step."""
        with self.telling() as session:
            if session is not None:
                session.step()

    def back(self) -> None:
        """Go back by a step."""
        self.pause()
        with self.telling() as session:
            if session is not None:
                session.back()

    def say(self, seat: int, message: int) -> None:
        """Say a message to an agent."""
        with self.telling() as session:
            if session is not None:
                session.say(seat, message, bool(self.keep.value))

    def release(self) -> None:
        """Let the Guides speak."""
        with self.telling() as session:
            if session is not None:
                session.release()

    def choreograph(self) -> None:
        """Dance what is written."""
        with self.telling() as session:
            if session is not None:
                session.choreograph((self.dance.value or "").strip())
                self.play()

    def play_or_pause(self) -> None:
        """Go on by itself, or stop that."""
        if self.timer.active:
            self.pause()
        else:
            self.play()

    def play(self) -> None:
        """Go on by itself."""
        self.timer.interval = self.speed.value
        self.timer.activate()
        self.run.set_text("Pause")

    def pause(self) -> None:
        """Stop going on by itself."""
        self.timer.deactivate()
        self.run.set_text("Play")

    def tick(self) -> None:
        """A step of those that are taken by themselves."""
        self.timer.interval = self.speed.value
        self.step()

    def key(self, event: events.KeyEventArguments) -> Any:
        """A key is as good as the button that it stands for."""
        held = event.modifiers
        if not event.action.keydown or held.ctrl or held.alt or held.meta or self.session is None:
            return None
        number = event.key.number
        if number and number <= self.session.seats[0].episode.speaker.shape.count:
            return self.say(0, number - 1)
        uses: dict[str, Callable[[], Any]] = {"ArrowRight": self.step, "ArrowLeft": self.back, "Escape": self.release}
        uses |= {"p": self.play_or_pause, "r": self.restart}
        return uses.get(event.key.name, lambda: None)()

    async def save_gif(self) -> None:
        """Save the episode of the first agent."""
        if self.session is not None:
            ui.download.content(await run.io_bound(gif_of, recorded(self.session.seats[0])), "episode.gif", "image/gif")

    async def save_page(self) -> None:
        """Save what has happened as a page that needs no server."""
        if self.session is not None:
            page = await run.io_bound(html_of, [recorded(seat) for seat in self.session.seats])
            ui.download.content(page, "episode.html", "text/html")

    def copy_link(self) -> None:
        """Put the address, which restores what is seen, into the clipboard."""
        ui.run_javascript("navigator.clipboard.writeText(location.href)")
        ui.notify("The link to what you see is in the clipboard.")


def link_of(session: Session) -> str:
    """:return: address of the page that restores the session, without the host"""
    return "?" + urlencode(session.query(), safe="*,/")


def serve(cast: Cast, host: str, port: int) -> None:
    """
    Serve a page to each who asks, until interrupted.

    :param cast: to choose from
    :param host: address to listen at
    :param port: to listen at
    """

    @ui.page("/")
    async def index(request: Request) -> None:
        page = Page(cast)
        await ui.context.client.connected()
        await page.restore(dict(request.query_params) or cast.first)

    if host in LOOPBACK:  # other names for this machine may be another site's, which would read along
        app.add_middleware(TrustedHostMiddleware, allowed_hosts=list(LOOPBACK))
    ui.run(
        host=host, port=port, title=TITLE, favicon="🔺", dark=None, tailwind=False, reload=False, show=False, show_welcome_message=False
    )
