"""
The same small page made with NiceGUI, Panel and Gradio, in a browser: `python -m benchmarks.ui_libraries`.

It needs `pip install nicegui panel gradio selenium psutil`, and Chromium with its driver. The libraries take turns, as other
work on the machine would else disturb one more than another. Times are medians.
"""

import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import psutil
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.keys import Keys

from benchmarks.ui_pages import PORTS, WIDTH

CLICKS = 50
EVENTS = ("requestWillBeSent", "loadingFinished", "webSocketFrameReceived")
FLAGS = ("--headless=new", "--no-sandbox", "--disable-background-networking", "--disable-component-update", "--no-first-run")
SEEN = f"""const deep = (root, what) => [...root.querySelectorAll(what)].concat(
    [...root.querySelectorAll('*')].filter(e => e.shadowRoot).flatMap(e => deep(e.shadowRoot, what)));
const canvas = new OffscreenCanvas(1, 1).getContext('2d', {{willReadFrequently: true}});
const press = text => deep(document, 'button').find(b => b.textContent.trim() == text).click();
const seen = () => {{
    const image = deep(document, 'img').find(i => i.complete && i.naturalWidth == {WIDTH});
    if (!image) return null;
    canvas.drawImage(image, 0, 0, 1, 1, 0, 0, 1, 1);
    const [message, step] = canvas.getImageData(0, 0, 1, 1).data;
    const said = `${{message}} after ${{step}} steps`;
    return deep(document, 'p, span, div').some(e => e.textContent.trim() == said) ? [message, step] : null;
}};
const done = arguments[arguments.length - 1], start = performance.now();
"""  # message and step, if picture and text agree
CLICK = """
press(`say ${arguments[0]}`);
const wait = () => (seen() ?? [])[0] == arguments[0] ? done(performance.now() - start) : setTimeout(wait, 1);
wait();"""
MANY = """
let left = 30;
const timer = setInterval(() => { press('step'); if (!--left) { clearInterval(timer); done(); } }, 10);"""


class Visitor:
    """
    A browser of its own, which has loaded nothing before.

    :param library: whose page is looked at
    """

    def __init__(self, library: str) -> None:
        options = webdriver.ChromeOptions()
        for flag in FLAGS:
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"performance": "ALL"})
        self.driver = webdriver.Chrome(options, Service(shutil.which("chromedriver")))
        self.driver.set_window_size(1280, 900)
        self.address = f"http://127.0.0.1:{PORTS[library]}/"
        self.times: list[float] = []

    def opens(self, query: str = "") -> None:
        self.driver.get(self.address + query)
        self.settles(lambda seen: seen is not None)

    def settles(self, good: Callable[[Any], bool]) -> Any:
        """:return: message and step that are seen, as soon as they are good, else after five seconds"""
        end = time.perf_counter() + 5
        while not good(seen := self.driver.execute_async_script(SEEN + "done(seen())")) and time.perf_counter() < end:
            time.sleep(0.02)
        return seen

    def clicks(self, n: int) -> None:
        """Say message n, and note the milliseconds until that is seen."""
        self.times.append(self.driver.execute_async_script(SEEN + CLICK, n))

    def loaded(self) -> dict[str, Any]:
        """:return: what was loaded until now, web sockets included, and from which hosts but this one"""
        log = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        named = {name: [e["params"] for e in log if e["method"] == f"Network.{name}"] for name in EVENTS}
        urls = [urlsplit(e["request"]["url"]) for e in named["requestWillBeSent"]]
        sent = [u for u in urls if u.scheme.startswith("http")]
        octets = sum(e["encodedDataLength"] for e in named["loadingFinished"])
        octets += sum(len(e["response"]["payloadData"]) for e in named["webSocketFrameReceived"])
        hosts = {u.hostname or "" for u in sent} - {"127.0.0.1"}
        return {"requests": len(sent), "loaded, MB": octets / 1e6, "page asks": sorted(hosts)}

    def tries(self) -> dict[str, Any]:
        """:return: what is seen after many quick clicks, after keys, by another tab, and after a link and a reload"""
        found: dict[str, Any] = {}
        self.opens("?message=4&step=7")
        found["restored"] = self.settles(lambda seen: seen == [4, 7])
        self.driver.execute_async_script(SEEN + MANY)
        found["30 clicks"] = self.settles(lambda seen: seen == [4, 37])
        for _ in range(5):
            self.driver.switch_to.active_element.send_keys(Keys.ARROW_RIGHT)
        found["5 keys"] = self.settles(lambda seen: seen == [4, 42])
        time.sleep(1)
        found["address"] = urlsplit(self.driver.current_url).query
        self.driver.refresh()
        found["reload"] = self.settles(lambda seen: seen == [4, 42])
        self.driver.switch_to.new_window("tab")
        self.opens()
        found["other tab"] = self.settles(lambda seen: seen == [0, 0])
        return found


def import_seconds(library: str) -> float:
    """:return: CPU time in a fresh process"""
    code = f"import time, {library}; print(time.process_time())"
    return float(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout)


class Server:
    """
    A process that serves a library's page.

    :param library: which
    :param log: of what it prints
    """

    def __init__(self, library: str, log: Path) -> None:
        self.log = log
        command = [sys.executable, "-m", "benchmarks.ui_pages", library]
        with log.open("w") as file:
            self.process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)

    def seconds(self) -> float:
        """:return: CPU time until now"""
        return sum(psutil.Process(self.process.pid).cpu_times()[:2])

    def asks(self) -> list[str]:
        """:return: hosts that it asked for, but this one"""
        lines = [line.split() for line in self.log.read_text().splitlines() if line.startswith("host ")]
        return sorted({host for _, host in lines} - {"127.0.0.1"})


def main() -> None:
    """Print a line for each finding."""
    imports = [{library: import_seconds(library) for library in PORTS} for _ in range(5)]
    report: dict[str, dict[str, Any]] = {
        library: {"import, s": statistics.median(one[library] for one in imports)} for library in PORTS
    }
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        servers = {library: Server(library, Path(folder) / library) for library in PORTS}
        for server in servers.values():
            stack.callback(server.process.wait)
            stack.callback(server.process.terminate)
        time.sleep(20)
        visitors = {library: Visitor(library) for library in PORTS}
        for library, visitor in visitors.items():
            stack.callback(visitor.driver.quit)
            visitor.opens()
            time.sleep(3)
            report[library] |= visitor.loaded()
            report[library]["server, ms a click"] = -1000 * servers[library].seconds() / CLICKS
        for n in range(CLICKS):
            for visitor in visitors.values():
                visitor.clicks((n + 1) % 9)
        for library, visitor in visitors.items():
            report[library]["server, ms a click"] += 1000 * servers[library].seconds() / CLICKS
            report[library] |= {"click to picture, ms": statistics.median(visitor.times), **visitor.tries()}
            report[library]["server asks"] = servers[library].asks()
    print("| |", " | ".join(PORTS), "|")
    for finding in report["nicegui"]:
        values = [report[library][finding] for library in PORTS]
        print(f"| {finding} |", " | ".join(f"{v:.3g}" if isinstance(v, float) else str(v) for v in values), "|")


if __name__ == "__main__":
    main()
