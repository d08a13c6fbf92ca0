"""What all tests run under."""

import os
import shutil
import signal

import hypothesis
import pytest

# One thread a process, as tests run side by side: threads that wait for each other stall otherwise. Read when torch is first
# imported, here and in the programs that tests start.
os.environ["OMP_NUM_THREADS"] = "1"
hypothesis.settings.register_profile("untimed", deadline=None)  # as a first example may wait for numba's compiler
hypothesis.settings.load_profile("untimed")
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as in the background of a script, and then in all programs tests start
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say what was not tried for want of a browser."""
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        terminalreporter.write_line(
            "Without Chromium, the playground was not tried in a browser: apt-get install chromium chromium-driver"
        )
