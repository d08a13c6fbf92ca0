"""Both pages in a real browser: Debian's Chromium without a window, if it is installed."""

import contextlib
import os
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

from sb3_guide.playground.episode import Beginning
from sb3_guide.playground.export import html_of, recorded
from sb3_guide.playground.session import Session

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
FLAGS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)
WIDE, PHONE = (1280, 900), (390, 844)
LINK = "?agent=GoToLocal/guided&level=GoToLocal&seed=3"

pytestmark = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason="there is no Chromium: apt-get install chromium chromium-driver"
)


class Visitor:
    """
    A person at a browser.

    :param driver: of the browser
    :param address: of the playground
    """

    def __init__(self, driver: webdriver.Chrome, address: str) -> None:
        self.driver = driver
        self.address = address

    def opens(self, page: str, size: tuple[int, int] = WIDE, scheme: str = "light") -> None:
        """
        :param page: link into the playground, or another address
        :param size: of the window
        :param scheme: "light" or "dark"
        """
        width, height = size
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
        self.driver.get(page if "://" in page else f"{self.address}/{page}")
        self.sees(lambda: self.rows())

    def sees(self, what: Callable[[], object]) -> None:
        """Wait until something is there; the page is redrawn meanwhile."""
        WebDriverWait(self.driver, 10, 0.02, [StaleElementReferenceException]).until(
            lambda _: what(), message=self.everything()
        )

    def everything(self) -> str:
        """:return: all text of the page, and its address"""
        return f"{self.driver.current_url}\n{self.driver.find_element(By.TAG_NAME, 'body').text}"

    def all(self, selector: str) -> list[WebElement]:
        return self.driver.find_elements(By.CSS_SELECTOR, selector)

    def text(self, selector: str) -> str:
        """:return: of the first element that there is, without its special spaces"""
        return self.all(selector)[0].text.replace("\N{NO-BREAK SPACE}", " ")

    def rows(self) -> list[WebElement]:
        return self.all(".message")

    def announced(self, row: int) -> str:
        """:return: what the agent would do if it heard that message"""
        return self.rows()[row].find_element(By.CSS_SELECTOR, ".does .what").text

    def turns(self) -> list[str]:
        return [turn.text for turn in self.all(".past li:not(.planned)")]

    def presses(self, *keys: str) -> None:
        for key in keys:
            self.driver.switch_to.active_element.send_keys(key)

    def presses_button(self, text: str) -> None:
        next(button for button in self.all("button") if button.text == text).click()

    def writes(self, field: str, text: str) -> None:
        element = self.all(f'input[aria-label="{field}"]')[0]
        element.send_keys(Keys.CONTROL + "a" + Keys.NULL + text + Keys.ENTER)

    def chooses(self, field: str, option: str) -> None:
        self.all(f'input[aria-label="{field}"]')[0].click()
        self.sees(lambda: any(item.text == option for item in self.all(".q-item")))
        next(item for item in self.all(".q-item") if item.text == option).click()


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> Iterator[str]:
    """The playground, served from an empty folder as a newcomer would."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "sb3_guide.experiments.cli", "play", "--port", str(port)]
    folder = tmp_path_factory.mktemp("served")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}  # NiceGUI looks for it
    environment["PYTHONPATH"] = str(Path(__file__).parents[2])
    server = subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert server.stdout is not None
    assert any(f"http://127.0.0.1:{port}" in line for line in server.stdout)  # the engine may have to be compiled first
    for _ in range(200):
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            break
        time.sleep(0.1)
    yield f"http://127.0.0.1:{port}"
    server.terminate()
    said = server.communicate()[0]
    assert "Traceback" not in said, said
    assert not list(folder.iterdir())


@pytest.fixture(scope="module")
def driver(tmp_path_factory) -> Iterator[webdriver.Chrome]:
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('chromium')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options, Service(DRIVER))
    yield driver
    driver.quit()


@pytest.fixture
def visitor(driver, address) -> Iterator[Visitor]:
    yield Visitor(driver, address)
    problems = [entry["message"] for entry in driver.get_log("browser")]
    assert not problems
    loaded = driver.execute_script("return performance.getEntriesByType('resource').map((entry) => entry.name)")
    assert all(name.startswith((address, "data:", "file:")) for name in loaded)


@pytest.fixture(scope="module")
def exported(cast, tmp_path_factory) -> str:
    """Address of a page of two episodes, in the first of which a person says something."""
    session = Session(cast, ["GoToLocal/guided"], Beginning("GoToLocal", 3))
    session.say(0, 0, keep=False)
    other = Session(cast, ["GoToLocal/guided", "GoToLocal/guide"], Beginning("GoToLocal", 2))
    for each in (session, other):
        while not each.ended:
            each.step()
    path = tmp_path_factory.mktemp("exported") / "page.html"
    path.write_text(html_of([[recorded(seat) for seat in each.seats] for each in (session, other)]), encoding="utf-8")
    return path.as_uri()


def test_other_names_of_this_machine_are_not_answered(address):
    request = urllib.request.Request(address, headers={"Host": "elsewhere.example"})
    with pytest.raises(urllib.error.HTTPError, match="400"):
        urllib.request.urlopen(request)


def test_a_click_overrules_the_guide(visitor):
    visitor.opens(LINK)
    assert visitor.text(".speech p") == "The Guide says w2 w2 (57 %); hearing it, the agent chooses forward (100 %)."
    announced = visitor.announced(0)
    assert announced == "left"
    visitor.rows()[0].click()
    visitor.sees(lambda: visitor.turns() == [f"w0 w0: {announced}"])
    assert [turn.text for turn in visitor.all(".past .by-you")] == visitor.turns()
    visitor.presses_button("Step")
    visitor.sees(lambda: len(visitor.turns()) == 2)
    assert len(visitor.all(".past .by-you")) == 1


def test_quick_clicks_and_a_reload_lose_nothing(visitor):
    visitor.opens(LINK)
    visitor.driver.execute_script("for (let i = 0; i < 12; i++) document.querySelectorAll('.message')[i % 3].click()")
    visitor.sees(lambda: len(visitor.turns()) == 12)
    visitor.sees(lambda: "told=0,1,2,0,1,2,0,1,2,0,1,2" in visitor.driver.current_url)
    before = visitor.text(".seats")
    visitor.driver.refresh()
    visitor.sees(lambda: visitor.all(".message") and visitor.text(".seats") == before)


def test_a_message_is_kept_until_released(visitor):
    visitor.opens(LINK)
    visitor.all(".q-checkbox")[0].click()
    visitor.rows()[4].click()
    visitor.sees(lambda: "but you say w1 w1" in visitor.text(".speech p"))
    visitor.presses_button("Step")
    visitor.sees(lambda: len(visitor.all(".past .by-you")) == 2)
    visitor.driver.refresh()
    visitor.sees(lambda: visitor.all(".told") and len(visitor.turns()) == 2)
    visitor.presses_button("Let the Guide speak")
    visitor.sees(lambda: not visitor.all(".told"))


def test_by_keyboard(visitor):
    visitor.opens(LINK)
    visitor.presses(Keys.ARROW_RIGHT, "5", "5")
    visitor.sees(lambda: visitor.turns() == ["w2 w2: forward", "w1 w1: right", "w1 w1: pickup"])
    visitor.presses(Keys.ARROW_LEFT)
    visitor.sees(lambda: visitor.turns() == ["w2 w2: forward", "w1 w1: right"])
    assert visitor.driver.current_url.endswith("told=g,4")
    visitor.presses("r")
    visitor.sees(lambda: not visitor.turns())
    visitor.presses("p")
    visitor.sees(lambda: visitor.text(".speech p") == "Mission fulfilled after 7 steps.")
    assert not any(row.is_enabled() for row in visitor.rows())
    visitor.all("button")[0].send_keys(Keys.TAB * 3, "9")  # digits in a field are text
    visitor.sees(lambda: len(visitor.turns()) == 7)


def test_a_choreography_and_its_typos(visitor):
    visitor.opens(LINK)
    visitor.writes("A choreography", "left, lefft")
    visitor.sees(lambda: "step 'lefft' is unknown: expected one of left, right" in visitor.text(".problem"))
    visitor.writes("A choreography", "left, left, w2 w2")
    visitor.sees(lambda: len(visitor.turns()) >= 3)
    assert visitor.turns()[:3] == ["w0 w0: left", "w0 w0: left", "w2 w2: forward"]
    assert not visitor.all(".problem")[0].text


def test_a_mission_of_ones_own(visitor):
    visitor.opens(LINK)
    visitor.writes("A mission of your own", "go to the moon")
    visitor.sees(lambda: "'go to the moon' is no mission: expected" in visitor.text(".problem"))
    visitor.writes("A mission of your own", "go to the <b>")
    visitor.sees(lambda: "'go to the <b>' is no mission" in visitor.text(".problem"))
    visitor.writes("A mission of your own", "go to the grey key")
    visitor.sees(lambda: visitor.text(".mission") == "go to the grey key")
    visitor.presses_button("Play")
    visitor.sees(lambda: visitor.text(".speech p").startswith("Mission fulfilled"))


def test_another_agent_and_two_side_by_side(visitor):
    visitor.opens(LINK)
    visitor.chooses("Agent", "GoToObj/guide")
    visitor.sees(lambda: visitor.text(".seat h2").startswith("GoToObj/guide"))
    assert "level=GoToObj&" in visitor.driver.current_url
    visitor.chooses("Compare with", "GoToObj/guided")
    visitor.sees(lambda: len(visitor.all(".seat")) == 2)
    assert len({mission.text for mission in visitor.all(".mission")}) == 1
    first, second = visitor.all(".seat")
    assert abs(first.rect["y"] - second.rect["y"]) < 1
    assert first.rect["x"] + first.rect["width"] <= second.rect["x"]


def test_a_link_that_is_none(visitor):
    visitor.opens("?agent=GoToMars")
    assert "there is no agent 'GoToMars': expected one of" in visitor.text(".problem")
    assert visitor.text(".mission") == "go to the red key"


def test_saving(visitor, tmp_path):
    visitor.opens(f"{LINK}&told=g*2,0")
    where = {"behavior": "allow", "downloadPath": str(tmp_path)}
    visitor.driver.execute_cdp_cmd("Browser.setDownloadBehavior", where)
    visitor.presses_button("Save GIF")
    visitor.presses_button("Save page")
    visitor.sees(lambda: {path.name for path in tmp_path.iterdir()} == {"episode.gif", "episode.html"})
    assert (tmp_path / "episode.gif").read_bytes().startswith(b"GIF89a")
    assert "w0 w0: left" in (tmp_path / "episode.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", ["served", "exported"])
def test_on_a_phone_and_in_the_dark(visitor, exported, page):
    address = LINK if page == "served" else exported
    backgrounds, inks = [], []
    for scheme in ("light", "dark"):
        visitor.opens(address, PHONE, scheme)
        widths = "[document.documentElement.scrollWidth, document.documentElement.clientWidth]"
        page_width, window_width = visitor.driver.execute_script(f"return {widths}")
        assert page_width == window_width <= PHONE[0]
        root = "document.body" if page == "served" else "document.documentElement"
        backgrounds.append(visitor.driver.execute_script(f"return getComputedStyle({root}).backgroundColor"))
        inks.append(visitor.driver.execute_script("return getComputedStyle(document.querySelector('.mission')).color"))
    assert [re.findall(r"\d+", colour)[:3] for colour in backgrounds] == [["255", "255", "255"], ["20", "23", "27"]]
    assert [re.findall(r"\d+", colour)[:3] for colour in inks] == [["27", "31", "36"], ["232", "234", "237"]]


def test_the_exported_page_needs_no_server(visitor, exported):
    visitor.opens(exported)
    assert "but you say w0 w0; hearing it, the agent chooses left" in visitor.text(".speech p")
    announced = visitor.announced(8)
    visitor.presses(Keys.ARROW_RIGHT)
    visitor.sees(lambda: visitor.driver.current_url.endswith("#1.1"))
    assert announced == "forward"
    assert visitor.text(".past .now").startswith(visitor.turns()[1])
    visitor.driver.refresh()
    visitor.sees(lambda: visitor.text(".soft:not(.keys)") and visitor.all(".past .now")[0].text == visitor.turns()[1])
    visitor.presses("n")
    visitor.sees(lambda: len(visitor.all(".seat")) == 2)
    visitor.presses("p")
    visitor.sees(lambda: visitor.text(".speech p") == "Mission fulfilled after 6 steps.")
    visitor.presses(Keys.ARROW_LEFT)
    visitor.sees(lambda: visitor.driver.current_url.endswith("#2.5"))
