"""Code is compiled by one process and cached for all, and an edit of any of the engine's files is noticed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import sb3_guide.envs
import sb3_guide.files
from sb3_guide.envs import GuideGridVecEnv
from sb3_guide.envs.engine import kernel

ENGINE = Path(kernel.__file__).parent
PLAY = """
from sb3_guide.envs import GuideGridEnv
from sb3_guide.envs.engine.kernel import entry_points
env = GuideGridEnv("GoToObj")
env.reset(seed=0)
print(env.mission, "from cache" if entry_points().reset.stats.cache_hits else "compiled", sep=": ")
"""


def play(folder: Path, processes: int = 1) -> list[str]:
    """:return: what new processes print that use the package in this folder side by side, sorted"""
    started = [
        subprocess.Popen([sys.executable, "-c", PLAY], cwd=folder, stdout=subprocess.PIPE, text=True) for _ in range(processes)
    ]
    return sorted(process.communicate()[0].strip() for process in started)


def test_levels_sizes_and_histories_share_one_compilation() -> None:
    """The kinds of all arguments are the same."""
    for level, worlds, history in (("GoToObj", 1, 0), ("BossLevel", 3, 2)):
        GuideGridVecEnv(level, worlds, seed=0, history=history).reset()
    assert len(kernel.entry_points().reset.overloads) == 1


def test_an_edit_is_noticed_and_nothing_else_compiles(tmp_path: Path) -> None:
    """Numba itself would only notice an edit of the file with the entry points."""
    package = tmp_path / "sb3_guide"
    shutil.copytree(Path(sb3_guide.envs.__file__).parent, package / "envs")
    shutil.copy(Path(sb3_guide.files.__file__), package)
    (package / "__init__.py").touch()
    play(tmp_path)
    assert play(tmp_path) == ["go to the green key: from cache"]
    missions = package / "envs" / "engine" / "missions.py"
    missions.write_text(missions.read_text().replace('"go to", "pick up",', '"pick up", "go to",'))
    found = play(tmp_path, processes=2)  # of which one waits for the other
    assert found == ["pick up the green key: compiled", "pick up the green key: from cache"]


@pytest.mark.parametrize("file", sorted(path.name for path in ENGINE.glob("*.py")))
def test_every_file_counts(file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The digest that enters the cache's key covers the whole engine."""
    before = kernel.sources_digest()
    shutil.copytree(ENGINE, tmp_path / "engine")
    monkeypatch.setattr(kernel, "__file__", str(tmp_path / "engine" / "kernel.py"))
    assert kernel.sources_digest() == before
    with (tmp_path / "engine" / file).open("a") as source:
        source.write("\n")
    assert kernel.sources_digest() != before
