"""
How an agent fails in a maze: `python -m benchmarks.failures sb3_guide/experts/GoToObjMaze --level GoToObjMaze`.

Plays validation missions and tells of those that failed how many rooms were entered, whether the target was ever in view, and
whether the last 40 actions went round in a circle.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from stable_baselines3.common.utils import set_random_seed

from sb3_guide.cloning import mission_seeds, play
from sb3_guide.cloning.episodes import Episodes
from sb3_guide.envs import GuideGridEnv, decode, level_of
from sb3_guide.envs.engine.cells import BALL, BOX, KEY
from sb3_guide.policies import load_agent

TYPES = {"key": KEY, "ball": BALL, "box": BOX}
COLOURS = ("red", "green", "blue", "purple", "yellow", "grey")
LAST = 40  # steps


def places(level: str, seed: int, actions: np.ndarray) -> np.ndarray:
    """:return: (T, 3) column, row and direction of the agent before each of its actions"""
    env = GuideGridEnv(level)
    env.reset(seed=seed)
    visited = []
    for action in actions:
        visited.append((*env.agent_pos, env.agent_dir))
        env.step(action)
    return np.array(visited)


def in_a_circle(tail: np.ndarray) -> bool:
    """:return: whether what is done (T, 3) repeats itself exactly, at least twice"""
    return any((tail[period:] == tail[:-period]).all() for period in range(1, len(tail) // 2 + 1))


def saw_target(images: np.ndarray, mission: str) -> bool:
    """:return: whether an object like the one of a go-to mission was ever in view; images are (T, 7, 7, 3)"""
    *_, colour, kind = mission.split()
    of_kind = images[..., 0] == TYPES[kind]
    return bool((of_kind & (images[..., 1] == COLOURS.index(colour))).any()) if colour in COLOURS else bool(of_kind.any())


def row(level: str, episodes: Episodes) -> str:
    """:return: of the table: successes, and of the failures the mean of rooms entered, and the shares of the rest"""
    size, found = level_of(level).room_size - 1, []
    for episode in np.flatnonzero(~episodes.successes):
        frames = slice(*episodes.offsets[episode : episode + 2])
        visited = places(level, int(episodes.seeds[episode]), episodes.actions[frames])
        rooms = len(np.unique(visited[:, :2] // size, axis=0))
        seen = saw_target(episodes.images[frames], decode(episodes.missions[episode]))
        found.append((rooms, seen, in_a_circle(visited[-LAST:])))
    rooms, seen, circles = np.mean(found, axis=0) if found else (np.nan,) * 3
    return f"{episodes.successes.mean():.1%} | {episodes.lengths.mean():.1f} | {rooms:.1f} | {seen:.0%} | {circles:.0%} |"


def main() -> None:
    """Play with drawn and with greedy actions and print a row for each."""
    parser = argparse.ArgumentParser(description="Tell how an agent fails in a maze.")
    parser.add_argument("agent", type=Path, help="folder of the agent")
    parser.add_argument("--level", required=True)
    parser.add_argument("--episodes", type=int, default=400)
    arguments = parser.parse_args()
    policy, seeds = load_agent(arguments.agent), mission_seeds("validation", arguments.episodes)
    print("| actions | success | mean length | rooms entered | target seen | in a circle |\n|---|---|---|---|---|---|")
    for name, deterministic in (("drawn", False), ("greedy", True)):
        set_random_seed(0)
        print(
            f"| {name} | {row(arguments.level, play(policy, arguments.level, seeds, deterministic=deterministic))}", flush=True
        )


if __name__ == "__main__":
    main()
