"""One thread a process, as the tests themselves run side by side: threads that wait for each other stall otherwise."""

import os
import shutil

import pytest

os.environ["OMP_NUM_THREADS"] = "1"  # read when torch is first imported, here and in the programs that tests start


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say what was not tried for want of a browser."""
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        terminalreporter.write_line(
            "Without Chromium, the playground was not tried in a browser: apt-get install chromium chromium-driver"
        )
