"""What was measured: the versions that belong to every result."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("sb3-guide", "minigrid", "envpool", "stable-baselines3", "gymnasium", "numba", "numpy", "torch")


def installed(package: str) -> str | None:
    """:return: the version of a package, None if it is not installed"""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def versions() -> dict[str, str | None]:
    """:return: the version of Python and of every package that matters, by name"""
    return {"python": platform.python_version(), **{name: installed(name) for name in PACKAGES}}
