"""What every stage of an experiment has in common: a folder, a lock, a record of what was done."""

import csv
import io
import shlex
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import torch as th
from filelock import FileLock, Timeout
from stable_baselines3.common.logger import KVWriter

from sb3_guide.files import checksum, read_arrays, read_json, write_json, write_text
from sb3_guide.policies.folder import AGENT, package_versions

SETTINGS = "settings.json"  # of the run that a folder holds
PATIENCE = 5  # seconds, in which one that was killed has ended


@contextmanager
def alone(place: Path, lock: Path) -> Iterator[None]:
    """
    Work where no other call works.

    :param place: folder or file that is worked on
    :param lock: file of its lock, which the kernel releases when the holder dies
    :raises RuntimeError: if another call works there
    """
    held = FileLock(lock)
    try:
        held.acquire(timeout=PATIENCE)
    except Timeout:
        raise RuntimeError(f"{place} is in use by another call: wait for it, or choose another --out") from None
    try:
        yield
    finally:
        held.release()


@dataclass
class Run:
    """
    A stage at work.

    :param folder: of its results
    :param settings: everything that these depend on, as JSON
    :param finished: an earlier run has done all of it already
    :param seconds_before: that earlier, killed parts of it took
    :param found: what is to be told of it in run.json, as JSON
    """

    folder: Path
    settings: dict[str, Any]
    finished: bool
    seconds_before: float = 0.0
    found: dict[str, Any] = field(default_factory=dict)
    started: float = field(default_factory=time.monotonic)

    @property
    def seconds(self) -> float:
        """That the stage took up to now, earlier parts included."""
        return self.seconds_before + time.monotonic() - self.started

    def begin(self) -> None:
        """
        Take the folder: a run of other settings is deleted. To be called when all that can be wrong with the settings has been
        found, and before anything is written, so that a run that can't begin costs no other.
        """
        begun = self.folder / SETTINGS
        for left in self.folder.rglob("*.[0-9]*.partial"):  # by one that was killed
            left.unlink()
        if begun.exists() and (changed := changes(read_json(begun), self.settings)):
            print(f"{self.folder} holds a run of other settings ({changed}), which is deleted: it runs anew", file=sys.stderr)
            empty(self.folder)
        write_json(begun, self.settings)


@contextmanager
def stage(
    name: str, settings: dict[str, Any], made_from: Sequence[Path], folder: Path, resume: bool, renew: bool = False
) -> Iterator[Run]:
    """
    Work in a folder: alone, and such that a killed run can be continued. At the end, run.json says what was done.

    :param name: of the stage
    :param settings: everything that the result depends on, as JSON; "config", "level" and "seed" among it where they exist
    :param made_from: files in safetensors' format that it depends on too; of those that are missing the block complains
    :param folder: made if need be
    :param resume: go on where an earlier run of the same settings stopped, or return at once where it finished
    :param renew: the same; and where an earlier run had other settings, delete it, say so, and begin anew
    :return: the run, whose block calls :meth:`Run.begin` unless it has finished already
    :raises RuntimeError: if another call works in the folder
    :raises ValueError: if the folder holds a run of other settings, one that was not to be resumed, what no run has made, or
        what this one is to be made from
    """
    if lost := [str(file) for file in made_from if file.resolve().is_relative_to(folder.resolve())]:
        raise ValueError(f"{folder} holds what the run is to be made from ({', '.join(lost)}): choose another --out")
    settings = {**settings, "made_from": {str(file): digest(file) for file in made_from if file.is_file()}}
    folder.mkdir(parents=True, exist_ok=True)
    with alone(folder, folder / "lock"):
        begun = folder / SETTINGS
        check_ours(folder, begun)
        changed = changes(read_json(begun), settings) if begun.exists() else ""
        if changed and not renew:
            raise ValueError(
                f"{folder} holds a run of other settings ({changed}): choose another --out, or pass --renew to delete it"
            )
        if begun.exists() and not (resume or renew):
            raise ValueError(f"{folder} holds a run already: pass --resume to continue it, or choose another --out")
        run = Run(folder, settings, finished=not changed and (folder / "run.json").exists())
        yield run
        if not run.finished:
            write_json(folder / "run.json", {**record(name, settings, run.seconds), **run.found})


def check_ours(folder: Path, begun: Path) -> None:
    """
    :param folder: in which a run is to begin or to go on
    :param begun: its settings
    :raises ValueError: if it holds an agent or settings that no run has made, and that would get lost
    """
    if begun.exists() and not {"level", "seed"} <= read_json(begun).keys():
        raise ValueError(f"{begun} is of no run of sb3-guide: choose another --out")
    if not begun.exists() and (folder / AGENT).exists():
        raise ValueError(f"{folder} holds an agent that no run has made: choose another --out or delete it")


def check_result(path: Path, name: str) -> None:
    """
    To be called before the work is done.

    :param path: of the JSON file that a stage is to write in the end
    :param name: of the stage
    :raises ValueError: if it is no name of a JSON file, can't be in its folder, or would take the place of what is no result
        of that stage
    """
    if path.suffix != ".json":
        raise ValueError(f"{path} is to hold the result of {name}: expected the name of a file that ends in .json")
    if above := next((folder for folder in path.parents if folder.is_file()), None):
        raise ValueError(f"{path} can't be written, as {above} is a file: choose another --out")
    if path.exists() and read_json(path).get("stage") != name:
        raise ValueError(f"{path} holds something else than a result of {name}: choose another --out or delete it")


def changes(before: dict[str, Any], after: dict[str, Any]) -> str:
    """:return: names of the settings that differ"""
    return ", ".join(sorted(name for name in before | after if before.get(name) != after.get(name)))


def empty(folder: Path) -> None:
    """
    Delete all that a run has left, its settings last, so that what is half deleted is still known for another run's.

    :param folder: of the run, whose lock stays
    """
    for path in sorted(folder.iterdir(), key=lambda path: path.name == SETTINGS):
        if path.is_dir():
            shutil.rmtree(path)
        elif path.name != "lock":
            path.unlink()


def digest(path: Path) -> str:
    """
    :param path: of a file in safetensors' format
    :return: SHA-256 of what it holds, by which a run knows whether what it was made from is still the same: the bytes of two
        files with the same content differ
    :raises ValueError: if it is damaged
    """
    return checksum(*read_arrays(path))


def record(name: str, settings: dict[str, Any], seconds: float) -> dict[str, Any]:
    """
    :param name: of the stage
    :param settings: that it ran with
    :param seconds: that it took
    :return: what is written beside a result
    """
    return {
        "stage": name,
        "command": shlex.join(["sb3-guide", *sys.argv[1:]]),
        **settings,
        "versions": package_versions(),
        "seconds": round(seconds, 2),
        "finished": datetime.now(timezone.utc).isoformat(timespec="seconds"),
    }


def use_threads(threads: int) -> None:
    """
    Let torch compute with so many threads, and always add up in the same order, which several threads do not by themselves.

    :param threads: of torch; results depend on their number, so it is part of a stage's settings
    :raises ValueError: if there is none
    """
    if threads < 1:
        raise ValueError(f"threads={threads}: expected at least 1")
    th.set_num_threads(threads)
    th.use_deterministic_algorithms(True)
    # a safeguard against reading it, which costs a tenth
    th.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]  # a property of the module


def write_table(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """
    Write a CSV file atomically; a column for every name that occurs.

    :param path: of the file
    :param rows: a dict each
    """
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


@contextmanager
def intact(folder: Path) -> Iterator[None]:
    """
    Read results.

    :param folder: of them
    :raises ValueError: if one lacks something, or has something else in its place
    """
    try:
        yield
    except (LookupError, TypeError, ValueError) as error:
        raise ValueError(f"{folder} holds a damaged result ({error!r}): delete it, and run it anew") from error


def read_table(path: Path) -> list[dict[str, str]]:
    """
    :param path: of a file that :func:`write_table` wrote
    """
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


class TableWriter(KVWriter):
    """
    SB3 logger output that a resumed run continues: the whole table is written each time.

    :param path: of the CSV file
    :param rows: of earlier parts of the run
    """

    def __init__(self, path: Path, rows: list[dict[str, Any]]) -> None:
        self.path = path
        self.rows = rows

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        self.rows.append(dict(sorted(plain_values(key_values).items())))
        write_table(self.path, self.rows)

    def close(self) -> None:
        pass


def plain_values(logged: dict[str, Any]) -> dict[str, Any]:
    """
    :param logged: values of an SB3 logger
    :return: the same without numpy's scalars
    """
    return {name: value.item() if isinstance(value, np.generic) else value for name, value in logged.items()}
