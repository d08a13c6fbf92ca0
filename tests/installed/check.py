"""
What a user of the wheel does first, in an empty folder and with nothing of the checkout: `make test-installed`. The
environment's own Python runs it, with the README as argument, whose snippets it takes.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from importlib.metadata import distribution, version
from pathlib import Path

BIN = Path(sys.executable).parent
HIGHEST_RATIO = 2.0  # of the time to import us to that of importing stable_baselines3 alone
HIGHEST_SIZE = 60e6  # bytes of what is installed, almost all of them weights
STUDY = """
conditions:
  guide-in-a-minute: {agent: guide, params: &short {train_episodes: 200, n_epochs: 2, validate_every: 2, validate_at: [0]}}
  guided-in-a-minute: {agent: guided, guide: guide-in-a-minute, params: *short}
studies:
  minute:
    grids: [{levels: [GoToObj], conditions: [guided-in-a-minute], seeds: 1}]
"""
EXPERT = """
GuideGrid-GoToObj-v0: {policy: LearnerPolicy, n_envs: 8, n_timesteps: 512, n_steps: 16, batch_size: 64, n_epochs: 1}
"""


def run(*command: str | Path) -> str:
    """:return: what a command printed; it ends all if it fails"""
    started = time.monotonic()
    ended = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    print(f"{time.monotonic() - started:6.1f} s  {' '.join(str(part) for part in command)[:100]!r}", flush=True)
    if ended.returncode:
        sys.exit(f"it failed:\n{ended.stdout}\n{ended.stderr}")
    return ended.stdout


def cli(*arguments: str | Path) -> str:
    return run(BIN / "sb3-guide", *arguments)


def snippets(readme: Path) -> str:
    """:return: the README's first two blocks of Python, one program, with a rollout for each training"""
    blocks = re.findall(r"```python\n(.*?)```", readme.read_text(encoding="utf-8"), flags=re.DOTALL)
    return re.sub(r"learn\(\d+_000", "learn(1", "".join(blocks[:2]))


def seconds_to_import(module: str) -> float:
    """:return: the least of three, of the processor's time, which other programs don't lengthen"""
    code = f"import time; started = time.process_time(); import {module}; print(time.process_time() - started)"
    return min(float(run(sys.executable, "-c", code)) for _ in range(3))


def check_size() -> None:
    size = sum(Path(str(file.locate())).stat().st_size for file in distribution("sb3-guide").files or ())
    print(f"installed files: {size / 1e6:.1f} MB")
    assert size < HIGHEST_SIZE, f"expected less than {HIGHEST_SIZE / 1e6:.0f} MB"


def check_import_time() -> None:
    alone, ours = seconds_to_import("stable_baselines3"), seconds_to_import("sb3_guide")
    print(f"import: {ours:.2f} s, stable_baselines3 alone {alone:.2f} s, {ours / alone:.2f} times that")
    assert ours < HIGHEST_RATIO * alone, f"expected less than {HIGHEST_RATIO} times that"


def check_commands() -> None:
    Path("expert.yml").write_text(EXPERT)
    Path("study.yml").write_text(STUDY)
    cli("expert", "--level", "GoToObj", "--config", "expert.yml", "--out", "runs/expert")
    cli("speak", "pretrained", "--level", "GoToObj", "--say", "w0 w1", "--out", "runs/speech")
    cli("play", "--level", "GoToObj", "--episodes", "1", "--export", "runs/playground.html")
    cli("reproduce", "--study", "minute", "--conditions", "study.yml", "--cores", "2", "--out", "runs/minute")
    assert list(Path("runs/minute").rglob("guided-in-a-minute/evaluation.json"))


def main() -> None:
    code = snippets(Path(sys.argv[1]).resolve())
    os.environ.pop("PYTHONPATH", None)
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        names = ("sb3-guide", "stable-baselines3", "gymnasium", "numpy", "numba", "torch")
        print(*(f"{name} {version(name)}" for name in names), sep=", ")
        assert folder not in sys.path
        check_size()
        run(sys.executable, "-c", code)
        check_import_time()
        check_commands()


if __name__ == "__main__":
    main()
