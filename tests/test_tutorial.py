"""The tutorial is run as it stands."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np

PAGE = Path(__file__).parents[1] / "docs" / "tutorial.md"


def script() -> str:
    """The page's commands and programs, in their order, for a shell."""
    blocks = re.findall(r"```(sh|python)\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
    assert len(blocks) >= 6
    return "".join(code if language == "sh" else f"python - <<'END'\n{code}END\n" for language, code in blocks)


def test_the_tutorial_ends_with_an_agent_that_does_as_it_is_told(tmp_path):
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    found = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script()],
        cwd=tmp_path,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
    )
    assert found.returncode == 0, found.stderr
    assert found.stdout.splitlines()[-3:] == [found.stdout.splitlines()[-1]] * 3
    assert found.stdout.splitlines()[-1].endswith("forward")
    mine = tmp_path / "mine"
    assert json.loads((mine / "guide" / "evaluation.json").read_text())["success_rate"] > 0.95
    for dance in ("pirouette", "dance"):
        walk = json.loads((mine / dance / "speech.json").read_text())["walk"]
        told = [step for step in zip(walk["meant"], walk["taken"], strict=False) if step[0] is not None]
        assert len(told) >= 2
        assert all(np.equal(*np.array(told).T))
    assert json.loads((mine / "obedience" / "speech.json").read_text())["obedience"]["messages"] == 500
    pictures = (
        "analysis/actions.png",
        "analysis/cells.png",
        "analysis/episode.gif",
        "pirouette/walk.png",
        "changed/change.png",
    )
    assert all((mine / picture).is_file() for picture in pictures)
