"""The list of packages that `make demo` installs without working it out."""

import re
from importlib.metadata import requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
ALONE = {
    "imitation",
    "editables",
    "hatchling",
    "pathspec",
    "pluggy",
    "trove-classifiers",
}  # whose requirements are not followed
ELSEWHERE = {"torch", "setuptools"}  # installed by a line of its own, with all that it asks for


def pins(name: str) -> dict[str, str]:
    """:return: version by package, as a file at the root has them"""
    lines = re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / name).read_text(), flags=re.MULTILINE)
    return {canonicalize_name(package): version for package, version in lines}


def needed(extra: str) -> set[str]:
    """:return: all packages that sb3-guide asks for with an extra, what these ask for, and so on"""
    found: set[str] = set()
    waiting = [("sb3-guide", extra)]
    while waiting:
        package, of_extra = waiting.pop()
        for requirement in map(Requirement, requires(package) or ()):
            if requirement.marker is None or requirement.marker.evaluate({"extra": of_extra}):
                name = canonicalize_name(requirement.name)
                waiting += [(name, each) for each in ({""} if name not in found else set()) | requirement.extras]
                found.add(name)
    return found


def test_the_list_is_complete_and_no_longer_than_needed():
    assert set(pins("demo.txt")) == (needed("experiments") | ALONE) - ELSEWHERE


def test_versions_are_those_of_the_tests():
    assert pins("demo.txt").items() <= pins("constraints.txt").items()
