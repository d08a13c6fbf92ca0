"""What importing does, in either order and with a core installation."""

import subprocess
import sys

import pytest

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
