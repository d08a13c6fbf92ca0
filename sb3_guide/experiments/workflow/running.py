"""One call that works in a folder: alone, going on where a killed one stopped, and leaving nothing running."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from types import FrameType
from typing import Any

import psutil
from filelock import FileLock, Timeout

from sb3_guide.experiments.workflow.display import Display, last_lines
from sb3_guide.files import read_json, write_json

SNAKEFILE = Path(__file__).with_name("Snakefile")
RUN_VARIABLE = "SB3_GUIDE_RUN"  # in the environment of every process of a run: the run's folder
POLL_SECONDS = 0.5
COMPILE = (sys.executable, "-m", "sb3_guide.experiments.workflow.compiling")
ENGINE_SECONDS = "engine_seconds.json"
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # Ctrl-C; kill; a terminal that is closed


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """
    Hold a folder, and be sure that no process of an earlier call works in it: neither before nor after.

    :param folder: of the run, made if need be
    :raises RuntimeError: if another call holds it, or it can't be used
    """
    lock, owner = FileLock(folder / ".lock"), folder / ".owner.json"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            lock.acquire(timeout=10 if end_abandoned(owner) else 0)
        write_json(owner, {"pid": os.getpid(), "ancestors": ancestors(psutil.Process())})
    except Timeout:
        raise RuntimeError(f"{folder} is in use by another reproduce: wait for it, or choose another folder") from None
    except OSError as error:
        raise RuntimeError(f"{folder} can't be used ({error}): choose another folder") from error
    with interruptible():
        try:
            end_leftovers(folder)
            yield
        finally:
            end_leftovers(folder)
            lock.release()


@contextmanager
def interruptible() -> Iterator[None]:
    """
    Let the first signal that asks for the end raise KeyboardInterrupt or SystemExit, so that all is left in order, which
    further signals don't disturb. Signals that are ignored already, as SIGHUP under nohup, stay so. Only the main thread of
    a process can be told of signals: in another one this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in SIGNALS}
    heeded = [number for number in SIGNALS if before[number] != signal.SIG_IGN]

    def end(number: int, frame: FrameType | None) -> None:
        for each in heeded:
            signal.signal(each, signal.SIG_IGN)
        raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)

    for number in heeded:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in heeded:
            signal.signal(number, before[number])


def end_abandoned(owner: Path) -> bool:
    """
    Kill the call that holds a folder if what started it is gone, as after a SIGKILL of make: nobody watches it any more.

    :param owner: file in which the holder has put its process and the processes above it
    :return: whether the folder will be free
    """
    try:
        content = read_json(owner)
        holder = psutil.Process(content["pid"])
        if ancestors(holder) == content["ancestors"]:
            return False
        holder.kill()
    except (FileNotFoundError, psutil.NoSuchProcess):
        pass  # it is about to begin or to end
    except (LookupError, TypeError, ValueError):
        return False  # the file is damaged: nobody knows whose process it is
    return True


def ancestors(process: psutil.Process) -> list[int]:
    """:return: numbers of the processes above this one, its parent first"""
    return [parent.pid for parent in process.parents()]


def end_leftovers(folder: Path) -> None:
    """
    Kill what a killed call left running. The stages can bear that: they go on from their checkpoints.

    :param folder: of the run
    """
    while left := [
        process
        for process in psutil.process_iter(["environ"])
        if (process.info["environ"] or {}).get(RUN_VARIABLE) == str(folder)
    ]:
        for process in left:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        psutil.wait_procs(left, timeout=10)


def run_workflow(config: dict[str, Any], cores: int, folder: Path) -> float:
    """
    :param config: of the Snakefile: "study", "levels", "seeds" and "conditions"
    :param cores: of this machine
    :param folder: of the runs
    :return: seconds that the runs have taken, all calls that worked on them together, and the engine's compilation if they
        had to wait for it
    :raises RuntimeError: if a stage fails
    """
    stopwatch, log = Stopwatch(folder / "log" / "seconds.json"), folder / "log" / "snakemake.log"
    settings = folder / "log" / "config.json"
    write_json(settings, config)
    command = [
        *(sys.executable, "-m", "snakemake", "all", "--snakefile", str(SNAKEFILE), "--directory", str(folder)),
        *("--configfile", str(settings), "--cores", str(cores), "--scheduler", "greedy", "--keep-going"),
        # this call holds a lock of its own, which unlike Snakemake's ends with the process
        *("--nolock", "--rerun-incomplete", "--rerun-triggers", "mtime", "params", "input", "--nocolor"),
    ]
    # threads that spin while they wait make a stage several times slower as soon as other processes want the cores
    environment = {"OMP_WAIT_POLICY": "PASSIVE", **os.environ, RUN_VARIABLE: str(folder), "TQDM_MININTERVAL": "1"}
    engine = Engine(folder / "log", environment)
    process = subprocess.Popen(
        command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    with (
        ended(engine.process),
        ended(process),
        closing(Display(folder, cores)) as display,
        log.open("w", buffering=1) as file,
    ):
        for line in lines_of(process):
            stopwatch.save()
            file.write(line)
            display.say(engine.news())
            display.show(line)
        process.wait()  # here, for whoever is still there when the block ends is killed
    if process.returncode:
        reason = " ".join(last_lines(log)[-3:])
        if display.failed:
            reason = f"failed: {', '.join(display.failed)}"
        elif process.returncode < 0:
            reason = f"Snakemake was killed by signal {-process.returncode}"
        raise RuntimeError(f"The workflow stopped ({reason}), see {log}. The same command goes on from where it stopped")
    return stopwatch.save()


class Engine:
    """
    Compiles the levels' engine in a process of its own while Snakemake plans, and the agents' networks while the expert
    learns. A stage that needs the engine earlier waits for it. If all is compiled already, the process ends in a moment.

    :param folder: of the logs, made if need be
    :param environment: of the process
    """

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.log, self.took = folder / "engine.log", folder / ENGINE_SECONDS
        self.told = self.done = False
        self.start = time.monotonic()
        with self.log.open("w") as file:
            self.process = subprocess.Popen(
                COMPILE, env=environment, stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT, text=True
            )

    def news(self) -> str:
        """:return: what there is to tell since the last call: that it has to be compiled, or how long that took"""
        if self.done or not (said := last_lines(self.log)):
            return ""
        if not self.told:
            self.told = True
            return said[0]
        if self.process.poll() is None:
            return ""
        self.done, seconds = True, round(time.monotonic() - self.start, 1)
        if self.process.returncode:
            return f"engine: did not compile, see {self.log}"
        write_json(self.took, seconds)
        return f"engine: compiled in {seconds:.0f} s"


def compiling_seconds(folder: Path) -> float | None:
    """
    :param folder: of a run
    :return: seconds that the engine compiled for in one of its calls; None if it was compiled before
    """
    path = folder / "log" / ENGINE_SECONDS
    return read_json(path, float) if path.exists() else None


@contextmanager
def ended(process: "subprocess.Popen[str]") -> Iterator[None]:
    """
    Kill a process, and all that it has started, if it has not ended when the block ends. Each is stopped before it is asked
    for its children, so that none is missed: not even one that is about to begin and has no environment yet.
    """
    try:
        yield
    finally:
        tree = [] if process.poll() is not None else [psutil.Process(process.pid)]
        for each in tree:
            with suppress(psutil.NoSuchProcess):
                each.suspend()
                tree += each.children()
        for each in tree:
            with suppress(psutil.NoSuchProcess):
                each.kill()
        psutil.wait_procs(tree, timeout=10)


def lines_of(process: "subprocess.Popen[str]") -> Iterator[str]:
    """
    :param process: with a pipe as its standard output
    :return: each line as it comes, and an empty one after every POLL_SECONDS of silence, until the process ends
    """
    lines: SimpleQueue[str | None] = SimpleQueue()

    def read() -> None:
        for line in process.stdout or ():
            lines.put(line)
        lines.put(None)

    Thread(target=read, daemon=True).start()
    while True:
        try:
            line = lines.get(timeout=POLL_SECONDS)
        except Empty:
            line = "" if process.poll() is None else None  # if it was killed, a stage may still hold the pipe's other end
        if line is None:
            return
        yield line


class Stopwatch:
    """
    Seconds that the calls of one run have taken together, those that were killed included.

    :param path: where the sum is kept
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(exist_ok=True)
        self.path = path
        self.before = read_json(path, float) if path.exists() else 0.0
        self.start = time.monotonic()

    def save(self) -> float:
        """:return: the sum up to now, which is written down too"""
        seconds = self.before + time.monotonic() - self.start
        write_json(self.path, round(seconds, 1))
        return seconds
