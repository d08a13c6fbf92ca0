"""
What SB3's own defaults give with one call: `python -m benchmarks.first_call --out runs/first_call`.

Trains `PPO(policy, "GuideGrid-GoToLocal-v0")`, beside SB3's MultiInputPolicy, and plays fresh missions after so many steps,
drawn and greedily. Writes first_call.csv after each training and prints a table. What is there is not run again; with
--seeds 0, nothing is.
"""

import time
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecMonitor

from sb3_guide import GuideGridVecEnv
from sb3_guide.cloning import mission_seeds, play
from sb3_guide.experiments.stages.runs import read_table, use_threads, write_table
from sb3_guide.policies import AgentPolicy

ENV_ID, LEVEL = "GuideGrid-GoToLocal-v0", "GoToLocal"
POLICIES = ("LearnerPolicy", "GuidePolicy", "MultiInputPolicy")
STEPS = (50_000, 100_000, 200_000)
N_ENVS = 50  # to evaluate SB3's policy in


def success_rate(model: PPO, n_episodes: int, deterministic: bool) -> float:
    """:return: on fresh missions; SB3's policies play as many in worlds that SB3 seeds"""
    set_random_seed(0)
    if isinstance(model.policy, AgentPolicy):
        seeds = mission_seeds("analysis", n_episodes)
        return float(play(model.policy, LEVEL, seeds, deterministic=deterministic).successes.mean())
    env = VecMonitor(GuideGridVecEnv(ENV_ID, N_ENVS, seed=2**31))
    rewards, _ = evaluate_policy(model, env, n_episodes, deterministic=deterministic, return_episode_rewards=True)
    return sum(reward > 0 for reward in rewards) / len(rewards)  # type: ignore[arg-type,operator]


def run(policy: str, seed: int, steps: list[int], n_episodes: int) -> list[dict[str, Any]]:
    """:return: a row for each number of steps"""
    model, rows, cpu = PPO(policy, ENV_ID, seed=1000 * seed), [], 0.0
    for goal in sorted(steps):
        started = time.process_time()
        model.learn(goal - model.num_timesteps, reset_num_timesteps=model.num_timesteps == 0)
        cpu += time.process_time() - started
        rates = {way: round(success_rate(model, n_episodes, way == "greedy"), 4) for way in ("drawn", "greedy")}
        done = {"steps": goal, "frames": model.num_timesteps, "cpu_seconds": round(cpu, 1), "episodes": n_episodes}
        rows.append({"policy": policy, "seed": seed, **done, **rates})
    return rows


def table(rows: pd.DataFrame) -> list[str]:
    """:return: lines of Markdown: every seed's success, and the steps a second"""
    lines = ["| policy | steps | seeds | drawn | greedy | steps a CPU second |", "|---" * 6 + "|"]
    for (policy, steps), runs in rows.groupby(["policy", "steps"], sort=False):
        rates = [", ".join(f"{100 * rate:.1f} %" for rate in runs[way]) for way in ("drawn", "greedy")]
        speed = f"{runs['frames'].sum() / runs['cpu_seconds'].sum():,.0f}"
        lines.append(f"| {' | '.join([policy, f'{steps:,}', str(len(runs)), *rates, speed])} |")
    return lines


def main(
    out: Annotated[Path, typer.Option(help="Folder of the table.")],
    seeds: Annotated[int, typer.Option(help="How many, from 0 on.")] = 3,
    policies: Annotated[list[str] | None, typer.Option(help="All if left out.")] = None,
    steps: Annotated[
        list[int] | None, typer.Option(help="After how many to play; 50, 100 and 200 thousand if left out.")
    ] = None,
    episodes: Annotated[int, typer.Option(help="Missions to play.")] = 1000,
) -> None:
    """Run what is missing, one seed of all policies after the other, and print the table."""
    use_threads(1)
    path = out / "first_call.csv"
    for seed in range(seeds):
        for policy in policies or POLICIES:
            before = read_table(path) if path.is_file() else []
            if (policy, str(seed)) not in [(row["policy"], row["seed"]) for row in before]:
                out.mkdir(parents=True, exist_ok=True)
                write_table(path, [*before, *run(policy, seed, steps or list(STEPS), episodes)])
    print("\n".join(table(pd.read_csv(path))))


if __name__ == "__main__":
    typer.run(main)
