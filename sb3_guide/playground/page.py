"""The page that is served: what a person does on it becomes a step of the session, and what the session holds is shown."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from fastapi import Request
from nicegui import app, events, run, ui
from starlette.middleware.trustedhost import TrustedHostMiddleware

from sb3_guide.language import CHOREOGRAPHIES
from sb3_guide.playground.cast import Cast, levels_of
from sb3_guide.playground.episode import HIGHEST_SEED, LONGEST_MISSION, Beginning
from sb3_guide.playground.export import gif_of, html_of, recorded
from sb3_guide.playground.panel import Panel, sentence, words
from sb3_guide.playground.session import LONGEST_TEXT, Session
from sb3_guide.playground.shown import AGENT, GUIDE, YOU, Part

STYLE = (Path(__file__).parent / "templates" / "style.css").read_text(encoding="utf-8")
FITTING = """
.nicegui-content { padding: 0; }
body { --q-primary: var(--agent) !important; background: var(--paper); }
.play .bg-primary { color: var(--paper) !important; }
"""  # of Quasar's parts to ours
TITLE = "What the Guide says, and what the agent makes of it"
LOOPBACK = ("127.0.0.1", "localhost")
NOBODY = "nobody"
SPEEDS = {1.2: "slow", 0.5: "brisk", 0.15: "fast"}  # seconds a step
LEAD = [
    [
        Part("An agent has a mission, and sees no more than what the second picture shows. At each step a "),
        Part("Guide", GUIDE),
        Part(" looks at the same and says a short message. Nobody taught it the words: they came to mean "),
        Part("something because "),
        Part("an agent", AGENT),
        Part(" had to find its way by them."),
    ],
    [
        Part("What do they mean? For each message you see how probable it is that the Guide says it, and what the agent "),
        Part("would do if it heard it. "),
        Part("Click a message", YOU),
        Part(" to say it in the Guide's place; where it would make the agent act otherwise, that is "),
        Part("in this colour", YOU),
        Part("."),
    ],
]
KEYS = {
    "→": "step",
    "←": "back",
    "P": "play or pause",
    "1 to 9": "say a message",
    "Esc": "let the Guide speak",
    "R": "restart",
}


class Page:
    """
    The page of one person.

    :param cast: to choose from
    """

    def __init__(self, cast: Cast) -> None:
        self.cast = cast
        self.session: Session | None = None  # until the agents are loaded
        self.panels: list[Panel] = []
        self._requests = 0  # for a session; the newest wins
        ui.add_css(STYLE)
        ui.add_css(FITTING)
        with ui.element("main").classes("play"):
            self._introduction()
            self._fields()
            self.problem = words("p", classes="problem").props("role=alert")
            self._bar()
            with ui.element("div").classes("seats") as self.seats:
                words("p", "The agents are waking up ...", "soft")
            with ui.element("p").classes("soft keys"):
                for key, use in KEYS.items():
                    with ui.element("span"):
                        words("kbd", key)
                        words("span", use)
        ui.keyboard(self.key, ignore=["input", "select", "textarea"])
        self.timer = ui.timer(0.5, self.tick, active=False)

    def _introduction(self) -> None:
        with ui.element("div").classes("top"):
            words("h1", "What does the Guide say, and what does the agent make of it?")
            with ui.element("div"):
                for text, action in (
                    ("Save GIF", self.save_gif),
                    ("Save page", self.save_page),
                    ("Copy link", self.copy_link),
                ):
                    ui.button(text, on_click=action).props("flat dense no-caps")
        for parts in LEAD:
            with ui.element("p").classes("lead"):
                sentence(parts)

    def _fields(self) -> None:
        """What is played: a change begins anew."""
        with ui.element("div").classes("fields"):
            self.agent = ui.select(list(self.cast.folders), label="Agent").on("update:model-value", self.agent_chosen)
            self.other = ui.select([NOBODY, *self.cast.folders], label="Compare with", value=NOBODY)
            self.level = ui.select(levels_of(self.cast.first["level"]), label="Level")
            self.seed = ui.number("World number", min=0, max=HIGHEST_SEED, precision=0, step=1).on("change", self.begin)
            for select in (self.other, self.level):
                select.on("update:model-value", self.begin)
        with ui.element("div").classes("fields"):
            self.mission = ui.input("A mission of your own", placeholder="such as: go to the red ball").classes("wide")
            self.mission.props(f"maxlength={LONGEST_MISSION} stack-label").on("change", self.begin)
            self.dance = ui.input(
                "A choreography", placeholder=f"such as: {' or '.join(CHOREOGRAPHIES)}; or left, forward, w0 w0"
            )
            self.dance.classes("wide").props(f"maxlength={LONGEST_TEXT} stack-label").on("keydown.enter", self.choreograph)
            with self.dance.add_slot("append"):
                ui.button("Dance", on_click=self.choreograph).props("flat dense no-caps")

    def _bar(self) -> None:
        """What happens next."""
        with ui.element("div").classes("bar"):
            for text, action in (("Back", self.back), ("Step", self.step)):
                ui.button(text, on_click=action).props("outline no-caps")
            self.run = ui.button("Play", on_click=self.play_or_pause).props("unelevated no-caps")
            ui.button("Restart", on_click=self.restart).props("flat no-caps")
            self.speed = ui.select(SPEEDS, value=0.5).props('dense borderless aria-label="speed"')
            self.keep = ui.checkbox("keep saying what I click")
            self.freed = ui.button("Let the Guide speak", on_click=self.release).props("flat no-caps")

    def act(self, do: Callable[[Session], None]) -> None:
        """
        Do something with the session, show what came of it, and tell what was wrong.

        :param do: what
        """
        self.problem.set_text("")
        try:
            if self.session is not None:
                do(self.session)
        except ValueError as error:
            self.problem.set_text(str(error))
        self.show()

    async def take(self, make: Callable[[], Session]) -> None:
        """
        Show another session, which may take a while to make, as agents are loaded when they first play.

        :param make: that session
        """
        self.pause()
        self.problem.set_text("")
        self._requests += 1
        request = self._requests
        try:
            session = await run.io_bound(make)
        except ValueError as error:
            self.problem.set_text(str(error))
            return
        if session is not None and request == self._requests:
            self.session = session
            self.fill_in(session)
            self.seats.clear()
            with self.seats.classes(**{"add" if len(session.seats) > 1 else "remove": "two"}):
                self.panels = [Panel(seat, partial(self.say, index)) for index, seat in enumerate(session.seats)]
            self.show()

    async def restore(self, query: dict[str, str]) -> None:
        """
        :param query: of the link that the page was opened by
        """
        await self.take(lambda: Session.restored(self.cast, query))
        problem = self.problem.text
        if self.session is None:
            await self.take(lambda: Session.restored(self.cast, self.cast.first))
            self.problem.set_text(problem)

    def fill_in(self, session: Session) -> None:
        """Let the fields say what is played."""
        self.agent.value, self.other.value = (*session.names, NOBODY)[:2]
        self.level.set_options(levels_of(session.beginning.level), value=session.beginning.level)
        self.seed.value = session.beginning.seed
        self.mission.value = session.beginning.mission

    def show(self) -> None:
        """Show the present moment, and let the address say it."""
        if self.session is not None:
            for panel, seat in zip(self.panels, self.session.seats, strict=True):
                panel.show(seat)
            if self.session.ended:
                self.pause()
            self.freed.set_visibility(any(seat.told is not None for seat in self.session.seats))
            ui.navigate.history.replace(link_of(self.session))

    async def agent_chosen(self) -> None:
        """Another agent plays where it was trained."""
        home = self.cast.level(self.agent.value)
        self.level.set_options(levels_of(home), value=home)
        await self.begin()

    async def begin(self) -> None:
        """Begin what the fields say."""
        names = [name for name in (self.agent.value, self.other.value) if name != NOBODY]
        level, seed, mission = self.level.value, int(self.seed.value or 0), (self.mission.value or "").strip()
        await self.take(lambda: Session(self.cast, names, Beginning(level, seed, mission)))

    async def restart(self) -> None:
        """Begin the same anew."""
        session = self.session
        if session is not None:
            await self.take(lambda: Session(self.cast, session.names, session.beginning))

    def step(self) -> None:
        """Go on by a step."""
        self.act(Session.step)

    def back(self) -> None:
        """Go back by a step."""
        self.pause()
        self.act(Session.back)

    def say(self, seat: int, message: int) -> None:
        """Say a message to an agent."""
        self.act(lambda session: session.say(seat, message, bool(self.keep.value)))

    def release(self) -> None:
        """Let the Guides speak."""
        self.act(Session.release)

    def choreograph(self) -> None:
        """Dance what is written."""
        self.act(lambda session: session.choreograph((self.dance.value or "").strip()))
        if not self.problem.text:
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
            picture = await run.io_bound(gif_of, recorded(self.session.seats[0]))
            ui.download.content(picture or b"", "episode.gif", "image/gif")

    async def save_page(self) -> None:
        """Save what has happened as a page that needs no server."""
        if self.session is not None:
            page = await run.io_bound(html_of, [[recorded(seat) for seat in self.session.seats]])
            ui.download.content(page or "", "episode.html", "text/html")

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
    settings: dict[str, Any] = {"dark": None, "tailwind": False, "reload": False, "show": False, "show_welcome_message": False}
    ui.run(host=host, port=port, title=TITLE, favicon="🔺", **settings)
