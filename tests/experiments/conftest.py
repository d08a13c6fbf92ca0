import subprocess
import sys
from pathlib import Path

import pytest

FAKE = Path(__file__).with_name("fake_stages.py")


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the results of all stages of two levels and two seeds, for what reads them."""
    folder = tmp_path_factory.mktemp("finished")
    subprocess.run([sys.executable, FAKE, "everything", "GoToObj,GoToLocal", "--seed", "2", "--out", folder], check=True)
    return folder
