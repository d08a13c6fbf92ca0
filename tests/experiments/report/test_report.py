import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from sb3_guide.experiments.report.page import duration, write_report
from sb3_guide.experiments.report.summary import summarise


class Outline(HTMLParser):
    """Tags of a page, and whether they are nested as they should be."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "br", "img", "source"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def page_of(folder: Path, levels: list[str], seeds: int) -> str:
    write_report(folder, summarise(folder, levels, seeds, wall_seconds=3725.0), "sb3-guide reproduce <GoToObj>")
    return (folder / "report.html").read_text()


@pytest.fixture(scope="module")
def page(finished_run: Path) -> str:
    return page_of(finished_run, ["GoToObj"], seeds=1)


def test_the_page_is_whole_and_needs_nothing_else(page: str) -> None:
    outline = Outline(page)
    assert not outline.open
    assert "script" not in {tag for tag, _ in outline.tags}
    links = [
        value for _, attributes in outline.tags for name, value in attributes.items() if name in ("src", "href", "srcset")
    ]
    assert all((link or "").startswith(("data:", "#")) for link in links)


def test_every_picture_has_words(page: str) -> None:
    tags = Outline(page).tags
    assert all(attributes["alt"] for tag, attributes in tags if tag == "img")
    described = [attributes["aria-label"] for _, attributes in tags if attributes.get("role") == "img"]
    assert len(described) == sum(tag == "svg" for tag, _ in tags) == 4


def test_ids_are_unique(finished_run: Path) -> None:
    tags = Outline(page_of(finished_run, ["GoToObj", "GoToLocal"], seeds=2)).tags
    ids = [attributes["id"] for _, attributes in tags if "id" in attributes]
    assert len(ids) == len(set(ids))


def test_the_page_says_what_a_reader_wants_to_know(page: str) -> None:
    text = re.sub(r"\s+", " ", page)
    for words in (
        "single seed, which proves nothing",
        "95&nbsp;% Wilson intervals",
        "left out: w1 w0, w2 w0, w2 w1 (3 of 9 messages)",
        "Never taken: pickup, drop, toggle, done",
        "sb3-guide reproduce &lt;GoToObj&gt;",
        "The whole run took 1:02:05",
        "stable-baselines3 2.2.1",
    ):
        assert words in text


def test_several_levels_and_seeds_have_an_overview(finished_run: Path) -> None:
    page = page_of(finished_run, ["GoToObj", "GoToLocal"], seeds=2)
    assert not Outline(page).open
    assert "At a glance" in page
    assert 'href="#GoToLocal"' in page
    assert "mean over 2 seeds" in page


def test_a_page_is_written_whole_or_not_at_all(finished_run: Path) -> None:
    page = page_of(finished_run, ["GoToObj"], seeds=1)
    summary = summarise(finished_run, ["GoToObj"], 1, wall_seconds=1.0)
    with pytest.raises(FileNotFoundError):
        write_report(finished_run, {**summary, "level": "GoToNowhere"}, "")
    assert (finished_run / "report.html").read_text() == page


@pytest.mark.parametrize(("seconds", "text"), [(0.4, "0:00"), (59.6, "1:00"), (3599, "59:59"), (7207, "2:00:07")])
def test_durations_are_those_of_a_clock(seconds: float, text: str) -> None:
    assert duration(seconds) == text
