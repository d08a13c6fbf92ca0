"""What a person sees of a running workflow."""

import re
import shutil
import sys
import time
from pathlib import Path

from tqdm import tqdm

STARTED = re.compile(r"Job (\d+): log in (log/(.+)\.log)")  # what Snakemake prints of the Snakefile's `message`
FINISHED = re.compile(r"Finished jobid: (\d+)")
FAILED = re.compile(r" +jobid: (\d+)")  # printed of failed jobs only, as every stage has a message
TOTAL = re.compile(r"total +(\d+)")
TAIL_BYTES, TAIL_LINES = 20_000, 20  # of a failed stage's log
MOST_RUNNING = 8  # stages that are shown side by side


class Display:
    """
    Stages that are finished, a bar of them, and the last line of each running stage's log, which is that stage's own progress
    bar. Without a terminal it is a line for every stage that starts, finishes or fails.

    :param folder: of the run
    :param cores: so many stages can run side by side
    """

    def __init__(self, folder: Path, cores: int) -> None:
        self.folder = folder
        self.failed: list[str] = []
        self.running: dict[str, tuple[str, Path, float]] = {}  # name, log and start of a stage by Snakemake's number of it
        form = "{desc}: {n}/{total} |{bar}| {elapsed}, left about {remaining}"
        self.bar = tqdm(desc="planning", total=0, bar_format=form, disable=None)
        self.tails = [
            tqdm(bar_format="{desc}", position=line, leave=False, disable=None)
            for line in range(1, min(cores, MOST_RUNNING) + 1)
        ]

    def close(self) -> None:
        """Leave the terminal as it should be."""
        for line in (*self.tails, self.bar):
            line.close()

    def show(self, line: str) -> None:
        """
        :param line: that Snakemake has printed; an empty one brings the display up to date
        """
        if match := TOTAL.match(line):
            self.bar.set_description_str("stages", refresh=False)
            self.bar.reset(int(match[1]) - 1)  # one of Snakemake's jobs stands for all the others
        elif match := STARTED.match(line):
            self.running[match[1]] = match[3], self.folder / match[2], time.monotonic()
            self.say(f"{match[3]}: started" if self.bar.disable else "")
        elif (match := FINISHED.match(line)) and match[1] in self.running:
            name, _, start = self.running.pop(match[1])
            self.say(f"{name}: finished in {time.monotonic() - start:.0f} s")
            self.bar.update()
        elif (match := FAILED.match(line)) and match[1] in self.running:
            name, log, _ = self.running.pop(match[1])
            self.failed.append(name)
            self.say("\n".join((f"{name}: FAILED. The end of {log}:", *last_lines(log)[-TAIL_LINES:])))
        self.refresh()

    def say(self, text: str) -> None:
        """:param text: written above the bars, unless it is empty"""
        if text:
            tqdm.write(text, file=sys.stderr)

    def refresh(self) -> None:
        """Show how far each running stage is."""
        width = shutil.get_terminal_size().columns - 1
        logs = [(name, last_lines(log)[-1:]) for name, log, _ in self.running.values()]
        for index, line in enumerate(self.tails):
            name, tail = logs[index] if index < len(logs) else ("", [])
            line.set_description_str(f"  {name}  {''.join(tail)}"[:width])


def last_lines(path: Path) -> list[str]:
    """
    :param path: of a text that may still grow
    :return: its last lines that aren't empty; a progress bar writes its lines over one another
    """
    if not path.exists():
        return []
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - TAIL_BYTES))
        text = file.read().decode(errors="replace")
    return [line.rstrip() for line in re.split(r"[\r\n]", text) if line.strip()]
