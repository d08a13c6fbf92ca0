"""
Every page does what it says: its Python runs, its commands exist, and the site is built without a warning.

A page needs no entry here, unless tests of its own run it. Its Python blocks run one after the other, as one program, in a
folder that has what README's commands leave behind; only training is cut short. Blocks of YAML that begin with a file's name,
`# mine.yml`, are files there. Where Python can't run, a remark before the block says why: <!-- not run: it needs a cluster -->
"""

import importlib
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import gymnasium
import minigrid  # noqa: F401  registers its environments before a page does, for no page's registrations last
import pytest
import typer
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.inventory import InventoryFile
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import DictRolloutBuffer

from sb3_guide.envs import LEVELS
from sb3_guide.experiments.cli import app
from sb3_guide.experts import expert_folder
from sb3_guide.policies.interventions import INTERVENTIONS
from sb3_guide.speakers import speaker_folder

ROOT = Path(__file__).parents[1]
PAGES = [path for folder in ("", "docs/", "docs/api/", "docs/results/*/") for path in sorted(ROOT.glob(f"{folder}*.md"))]
RUN_BY_THEIR_OWN_TESTS = ("docs/tutorial.md", "docs/your-environment.md")
PUBLIC = [
    ".".join(path.parent.relative_to(ROOT).parts)
    for path in sorted((ROOT / "sb3_guide").rglob("__init__.py"))
    if "__all__" in path.read_text()
]
BLOCK = re.compile(
    r"(?:^<!-- not run: (?P<reason>.+) -->\n+)?^```(?P<language>\w+)\n(?P<code>.*?)^```$", re.DOTALL | re.MULTILINE
)
COMMANDS = {command.name: command for command in typer.main.get_command(app).commands.values()}  # type: ignore[attr-defined]


class Block(NamedTuple):
    """A block of code, the line of the page where it begins, and why it is not run."""

    language: str
    code: str
    line: int
    reason: str | None


def blocks(page: Path, language: str) -> list[Block]:
    """:return: a page's blocks of one language"""
    text = page.read_text(encoding="utf-8")
    found = [
        Block(each["language"], each["code"], text[: each.start("code")].count("\n"), each["reason"])
        for each in BLOCK.finditer(text)
    ]
    return [block for block in found if block.language == language]


def pages_with(language: str) -> list:
    return [pytest.param(page, id=str(page.relative_to(ROOT))) for page in PAGES if blocks(page, language)]


@pytest.fixture
def runs(tmp_path, monkeypatch) -> Path:
    """The folder of the commands in README's "stage by stage", with their agents, which are the shipped ones."""
    folder = tmp_path / "runs" / "mine"
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    shutil.copytree(expert_folder("GoToObj"), folder / "expert")
    for agent in ("guide", "guided"):
        shutil.copytree(speaker_folder("GoToObj", agent), folder / agent)
    monkeypatch.chdir(tmp_path)
    return folder


@pytest.fixture
def short_training(monkeypatch) -> None:
    """Every training is one rollout, a short one where its buffer lets it, and one pass through it."""
    setup = BaseAlgorithm._setup_learn

    def shortly(self, total_timesteps, *args):
        self.n_epochs = 1
        if type(self.rollout_buffer) is DictRolloutBuffer:
            self.n_steps = self.rollout_buffer.buffer_size = 16
            self.rollout_buffer.reset()
        return setup(self, 1, *args)

    monkeypatch.setattr(BaseAlgorithm, "_setup_learn", shortly)


@pytest.fixture
def own_names() -> Iterator[None]:
    """What a page adds to the package's tables is gone after it."""
    with ExitStack() as tables:
        for table in (LEVELS, INTERVENTIONS, gymnasium.registry, PPO.policy_aliases):
            tables.enter_context(patch.dict(table))
        yield


@pytest.mark.parametrize("page", [page for page in pages_with("python") if page.id not in RUN_BY_THEIR_OWN_TESTS])
@pytest.mark.usefixtures("runs", "short_training", "own_names")
def test_the_python_of_a_page_runs(page):
    for block in blocks(page, "yaml"):
        if name := re.match(r"# (\w+\.yml)\n", block.code):
            Path(name[1]).write_text(block.code)
    scope: dict[str, object] = {"__name__": "page"}
    for block in blocks(page, "python"):
        if block.reason is None:
            exec(compile("\n" * block.line + block.code, page, "exec"), scope)  # lines in tracebacks are the page's


@pytest.mark.parametrize("page", pages_with("sh"))
def test_the_commands_of_a_page_exist(page):
    for block in blocks(page, "sh"):
        code = block.code.replace("\\\n", " ")
        for name, arguments in re.findall(r"(?:^|\W)sb3-guide (\S+)(.*)", code):
            assert name in COMMANDS, f"{page.name}: sb3-guide {name}"
            options = {option for parameter in COMMANDS[name].params for option in parameter.opts}
            used = {word for word in shlex.split(arguments, comments=True) if word.startswith("--")}
            assert used <= options | {"--help"}, f"{page.name}: sb3-guide {name} {arguments}"


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The documentation site, as `make docs` builds it."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "-q", "-c", "docs", ".", str(folder)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    return folder


def test_the_site_begins_with_the_readme(site):
    assert "url=README.html" in (site / "index.html").read_text()
    assert (site / "README.html").is_file()


@pytest.mark.parametrize("module", PUBLIC)
def test_every_public_name_is_documented(site, module):
    with (site / "objects.inv").open("rb") as file:
        inventory = InventoryFile.load(file, "", lambda base, name: name)
    shown = {name for kind in ("py:class", "py:data", "py:function") for name in inventory.get(kind, ())}
    owner = importlib.import_module(module)
    for name in owner.__all__:
        places = [place for place in shown if place.startswith("sb3_guide.") and place.endswith(f".{name}")]
        assert places, f"{module}.{name} is on no page of docs/api"
        assert described(getattr(owner, name), places), f"{module}.{name} has no docstring"


def described(thing: object, places: list[str]) -> bool:
    """:return: whether a function or class has a docstring; or a constant, at one of the places, a comment that is one"""
    if callable(thing):
        return bool(thing.__doc__)
    modules = [place.rpartition(".")[::2] for place in places]
    return any(("", name) in ModuleAnalyzer.for_module(module).find_attr_docs() for module, name in modules)
