"""What was measured, and where: what belongs to every result."""

from __future__ import annotations

import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = (
    *("sb3-guide", "minigrid", "envpool", "stable-baselines3", "sb3-contrib", "imitation", "gymnasium"),
    *("numba", "numpy", "torch"),
)


def installed(package: str) -> str | None:
    """:return: the version of a package, None if it is not installed"""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def versions() -> dict[str, str | None]:
    """:return: the version of Python and of every package that matters, by name"""
    return {"python": platform.python_version(), **{name: installed(name) for name in PACKAGES}}


def processor() -> str:
    """:return: which one this is, as Linux tells it"""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    found = dict(reversed([[part.strip() for part in line.split(":", 1)] for line in lines if ":" in line]))
    return f"{found['model name']}, family {found['cpu family']}, model {found['model']}"


def this_commit() -> str:
    """:return: of the checkout"""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short=7", "HEAD"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
