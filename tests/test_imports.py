"""What importing does, in either order and with a core installation, and who may import whom."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = re.findall(r"^\| \[`(sb3_guide/.*?)/?`\]", (ROOT / "README.md").read_text(), flags=re.MULTILINE)
USE = "import gymnasium; gymnasium.make('GuideGrid-GoToObj-v0'); PPO.policy_aliases['GuidePolicy']"


def run(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout


@pytest.mark.parametrize(
    "imports",
    [
        "import sb3_guide; from stable_baselines3 import PPO",
        "from stable_baselines3 import PPO; import sb3_guide",
        "from sb3_contrib import RecurrentPPO; import sb3_guide; from stable_baselines3 import PPO",
        "import gymnasium; import sb3_guide; from stable_baselines3 import PPO",
    ],
)
def test_either_order(imports):
    run(f"{imports}; {USE}")


def test_nothing_but_cloning_needs_the_extras():
    graphical = ("matplotlib.pyplot", "pygame", "nicegui", "jinja2")
    extras = (*graphical, "imitation", "snakemake", "scipy.stats", "minigrid", "filelock")
    code = (
        "import sys\n"
        f"for name in {extras}: sys.modules[name] = None\n"
        "import sb3_guide, sb3_guide.envs, sb3_guide.policies, sb3_guide.metrics, sb3_guide.cloning, sb3_guide.callbacks\n"
    )
    run(code)


def test_importing_draws_nothing_from_the_global_generators():
    run(
        "import numpy as np, torch\n"
        "def state(): return np.random.get_state()[1].tolist(), torch.get_rng_state().tolist()\n"
        "before = state()\n"
        "import sb3_guide\n"
        "assert state() == before\n"
    )


def imports(path: Path) -> Iterator[str]:
    """:return: every module of ours that a file imports, as a path"""
    for node in ast.walk(ast.parse(path.read_text())):
        names = [node.module] if isinstance(node, ast.ImportFrom) else getattr(node, "names", [])
        for name in (each.name if isinstance(each, ast.alias) else each for each in names):
            if name and name.split(".")[0] == "sb3_guide":
                yield name.replace(".", "/")


def place(path: str) -> int:
    """:return: which line of the table a file is in; what is in none, as the command line, stands below all"""
    (line,) = [line for line, room in enumerate(ROOMS) if f"{path}/".startswith(f"{room.removesuffix('.py')}/")] or [
        len(ROOMS)
    ]
    return line


def test_every_folder_is_in_the_table():
    folders = {str(path.parent.relative_to(ROOT)) for path in (ROOT / "sb3_guide").rglob("*.py")}
    assert {folder for folder in folders if place(folder) == len(ROOMS)} == {"sb3_guide", "sb3_guide/experiments"}


def test_a_folder_imports_only_those_above_it():
    files = [path.relative_to(ROOT) for path in (ROOT / "sb3_guide").rglob("*.py")]
    upwards = [
        f"{file} imports {module}"
        for file in files
        if file != Path("sb3_guide/__init__.py")
        for module in imports(ROOT / file)
        if place(module) > place(str(file.with_suffix("")))
    ]
    assert upwards == []
