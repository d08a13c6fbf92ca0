"""
All stages in environments that are not ours: Minigrid's DoorKey with its mission as text, Basic of ViZDoom as pixels, and a
toy of the tests. Needs `pip install vizdoom`.

    python -m benchmarks.other_envs --out runs/other_envs --results docs/results/other_envs

Writes results.json and README.md with a table. Experts are trained by PPO (one seed); Learner, Guide and guided Learner are
cloned from their demonstrations. What was finished is kept, so that it may be killed and called again. Hyper-parameters:
benchmarks/other_envs_ppo.yml and benchmarks/other_envs_bc.yml.
"""

from functools import cache
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import minigrid  # noqa: F401  # registers its environments
import numpy as np
import typer
from gymnasium import spaces

from sb3_guide.envs import HistoryWrapper, TextMissionWrapper, Vocabulary
from sb3_guide.experiments.stages.ablate import ablate_agent
from sb3_guide.experiments.stages.analyze import analyze
from sb3_guide.experiments.stages.clone import clone
from sb3_guide.experiments.stages.expert import train_expert
from sb3_guide.experiments.stages.record import record_demonstrations
from sb3_guide.experiments.stages.speak import speak_to
from sb3_guide.files import read_json, write_json, write_text

HERE = Path(__file__).parent
DOOR_KEY = "MiniGrid-DoorKey-5x5-v0"
SPLITS = {"train": 2000, "validation": 50, "analysis": 50}  # episodes


@cache
def vocabulary() -> Vocabulary:
    """:return: the words of DoorKey's missions"""
    return Vocabulary.sampled(gymnasium.make(DOOR_KEY), resets=10)


class Told(gymnasium.Wrapper):
    """Says whether an episode was a success, by which a training may stop: Minigrid does not."""

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        return (
            seen,
            float(reward),
            terminated,
            truncated,
            {**info, "is_success": reward > 0} if terminated or truncated else info,
        )


def door_key(render_mode: str | None = None) -> gymnasium.Env:
    """:return: DoorKey as it is registered, its mission as tokens, with three images before the present one"""
    env = Told(gymnasium.make(DOOR_KEY, render_mode=render_mode))
    return HistoryWrapper(TextMissionWrapper(env, vocabulary()), history=3)


class Doom(gymnasium.Wrapper):
    """ViZDoom's screen, every third pixel of it, is the image. To shoot the monster is success; rewards are scaled down."""

    action_names = ("nothing", "attack", "right", "left")

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        screen = env.observation_space["screen"]
        self.observation_space = spaces.Dict({"image": spaces.Box(0, 255, self._image(screen.sample()).shape, np.uint8)})

    def _image(self, screen: np.ndarray) -> np.ndarray:
        return screen[::3, ::3]

    def reset(self, **kwargs: Any) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode."""
        seen, info = self.env.reset(**kwargs)
        return {"image": self._image(seen["screen"])}, info

    def step(self, action: Any) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Act."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        if terminated or truncated:
            info["is_success"] = not truncated
        return {"image": self._image(seen["screen"])}, reward / 100, terminated and not truncated, truncated, info


def doom(render_mode: str | None = None) -> gymnasium.Env:
    """:return: ViZDoom's Basic, four tics an action, rendered small"""
    import vizdoom.gymnasium_wrapper  # registers it

    small = vizdoom.ScreenResolution.RES_160X120
    return Doom(gymnasium.make("VizdoomBasic-v1", frame_skip=4, screen_resolution=small, render_mode=render_mode))


gymnasium.register("DoorKey-v0", door_key)
gymnasium.register("Doom-v0", doom)

ENVIRONMENTS = ("tests.toys:Pick-v0", "DoorKey-v0", "Doom-v0")


def stages(level: str, seeds: int, out: Path) -> None:
    """
    Run everything that is missing.

    :param level: id of the environment
    :param seeds: of stages 2 and 3
    :param out: folder
    """
    train_expert(level, out / "expert", 0, 1, resume=True, config_file=HERE / "other_envs_ppo.yml", algo="ppo")
    demos = out / "demos"
    for split, count in SPLITS.items():
        if not (demos / f"{split}.json").exists():
            record_demonstrations(level, out / "expert", split, count, demos / f"{split}.safetensors", 1)
    for seed in range(seeds):
        for kind in ("learner", "guide", "guided"):
            heard = str(out / f"guide{seed}") if kind == "guided" else None
            config = HERE / "other_envs_bc.yml"
            clone(kind, level, [demos], out / f"{kind}{seed}", seed, 1, resume=True, guide=heard, config_file=config)
        guide, guided = out / f"guide{seed}", out / f"guided{seed}"
        if not (guide / "speech" / "speech.json").exists():
            for agent in (guide, guided):
                analyze(agent, level, demos / "analysis.safetensors", None, agent / "analysis", 1, n_episodes=50)
            ablate_agent(guided, level, 50, guided / "ablation.json", 1)
            speak_to(guide, level, [], None, True, guide / "speech", seed, 1)


def summary(seeds: int, out: Path) -> dict[str, Any]:
    """
    :param seeds: of stages 2 and 3
    :param out: folder that :func:`stages` filled
    :return: the numbers that are worth telling, lists over the seeds that have got so far
    """

    def of(agent: str, file: str, *keys: str) -> list[Any]:
        paths = [out / f"{agent}{seed}" / file for seed in range(seeds)]
        found = [read_json(path) for path in paths if path.exists()]
        for key in keys:
            found = [content[key] for content in found]
        return found

    recorded = read_json(out / "demos" / "train.json")
    return {
        "expert": {
            "frames": read_json(out / "expert" / "run.json")["frames"],
            "seconds": read_json(out / "expert" / "run.json")["seconds"],
            "success_rate": recorded["expert_success_rate"],
            "mean_length": recorded["mean_length"],
        },
        "success_rate": {agent: of(agent, "evaluation.json", "success_rate") for agent in ("learner", "guide", "guided")},
        "communication": {
            agent: {
                name: of(agent, "analysis/analysis.json", "in_play", name, "mean")
                for name in ("cic", "uniform_cic", "message_entropy")
            }
            for agent in ("guide", "guided")
        },
        "ablation": {
            name: [found[name]["success_rate"] for found in of("guided", "ablation.json", "interventions")]
            for name in ("spoken", "silent", "uniform", "shuffled")
        },
        "obedience": of("guide", "speech/speech.json", "obedience"),
        "dictionary": of("guide", "speech/speech.json", "dictionary"),
    }


def page(found: dict[str, Any]) -> str:
    """
    :param found: :func:`summary` of each environment
    :return: a table of it
    """

    def rates(values: list[float]) -> str:
        return ", ".join(f"{value:.0%}" for value in values)

    def nats(measures: dict[str, list[float]]) -> str:
        return " / ".join(", ".join(f"{value:.2f}" for value in values) for values in measures.values() if values)

    def words(dictionaries: list[list[dict[str, Any]]]) -> str:
        meant = [
            ", ".join(f"{entry['message']}: {entry['action']}" for entry in each if entry["means_it"]) for each in dictionaries
        ]
        return "; ".join(text or "none" for text in meant)

    rows = {
        "expert (PPO, one seed): frames": lambda env: f"{env['expert']['frames']:,}",
        "its success on missions of the training split": lambda env: f"{env['expert']['success_rate']:.0%}",
        "mean length of its episodes": lambda env: f"{env['expert']['mean_length']:.1f}",
        "success of the Learner": lambda env: rates(env["success_rate"]["learner"]),
        "success of the Guide": lambda env: rates(env["success_rate"]["guide"]),
        "success of the guided Learner": lambda env: rates(env["success_rate"]["guided"]),
        "the Guide's CIC / uniform CIC / message entropy": lambda env: nats(env["communication"]["guide"]),
        "the guided Learner's": lambda env: nats(env["communication"]["guided"]),
        **{
            f"its success, {name}": lambda env, name=name: rates(env["ablation"][name])
            for name in ("spoken", "silent", "uniform", "shuffled")
        },
        "messages that the Guide obeys": lambda env: rates([each["raw"] for each in env["obedience"]]),
        "beyond chance": lambda env: rates([each["corrected"] for each in env["obedience"]]),
        "words of the Guide": lambda env: words(env["dictionary"]),
    }
    lines = ["| | " + " | ".join(found) + " |", "|---" * (len(found) + 1) + "|"]
    lines += [f"| {label} | " + " | ".join(tell(env) or "-" for env in found.values()) + " |" for label, tell in rows.items()]
    return f"""# Environments that are not ours

Made by `python -m benchmarks.other_envs`, with the settings of benchmarks/other_envs_ppo.yml and benchmarks/other_envs_bc.yml.
Success is measured on 100 missions of the analysis split, communication and ablations on 50 of them. Where there are several
numbers, each is of one seed of stages 2 and 3; a dash is a run that was not finished. CIC and entropies are in nats.

{chr(10).join(lines)}
"""


def main(
    out: Annotated[Path, typer.Option(help="Folder for all that is made.")],
    results: Annotated[Path, typer.Option(help="Folder for results.json and README.md; environments that they hold stay.")],
    seeds: Annotated[int, typer.Option(min=1, help="Of stages 2 and 3.")] = 3,
    only: Annotated[list[str] | None, typer.Option(help="Environment to run; repeat it; all if left out.")] = None,
) -> None:
    """Run all stages in all environments, and write down the numbers."""
    results.mkdir(parents=True, exist_ok=True)
    numbers = results / "results.json"
    found = read_json(numbers) if numbers.exists() else {}
    for level in only or ENVIRONMENTS:
        name = level.rpartition(":")[2]
        stages(level, seeds, out / name)
        found[name] = summary(seeds, out / name)
        write_json(numbers, found)
        write_text(results / "README.md", page(found))


if __name__ == "__main__":
    typer.run(main)
