"""The first call of an entry point in a process, which compiles it or loads it from numba's cache."""

from __future__ import annotations

import fcntl
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Timer
from typing import IO, Any

MESSAGE = "sb3_guide: compiling the levels' engine: about half a minute, once on this machine"
_PATIENCE = 3.0  # seconds; loading compiled code takes less


@cache
def _tell() -> None:
    """Say once in a process what the user is waiting for."""
    print(MESSAGE, file=sys.stderr, flush=True)


@contextmanager
def first_call(entry_point: Any) -> Iterator[None]:
    """
    Of processes that need the same code at the same time, let one compile it and the others wait, which then load it. Tell
    the user if this takes long.

    :param entry_point: function of numba that is cached
    """
    timer = Timer(_PATIENCE, _tell)
    timer.start()
    lock = _locked(Path(entry_point.stats.cache_path))
    try:
        yield
    finally:
        timer.cancel()
        if lock is not None:
            lock.close()


def _locked(folder: Path) -> IO[bytes] | None:
    """:return: a locked file in this folder; None if the folder is read-only, or its file system has no locks"""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / "compiling.lock").open("ab")
    except OSError:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
    except OSError:
        lock.close()
        return None
    return lock
