"""Demonstrations as imitation's trajectories, and back."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from imitation.data.types import DictObs, TrajectoryWithRew

from sb3_guide.cloning.demonstrations import Demonstrations
from sb3_guide.cloning.exchange import NO_SEED, WholeEpisode, demonstrations_of, whole_episodes


def to_trajectories(demonstrations: Demonstrations) -> list[TrajectoryWithRew]:
    """
    Every episode is played again for its rewards and last observation. The last info of each holds "is_success", "seed",
    "level" and "provenance".

    :param demonstrations: of one level
    :raises ValueError: if an episode is another one when it is played again
    """
    origin = {"level": demonstrations.level, "provenance": demonstrations.provenance}
    return [_trajectory(whole, origin) for whole in whole_episodes(demonstrations)]


def _trajectory(whole: WholeEpisode, origin: dict[str, Any]) -> TrajectoryWithRew:
    last = {"is_success": bool(whole.terminations[-1]), "seed": whole.seed, **origin}
    infos = np.array([{}] * (len(whole.actions) - 1) + [last], dtype=object)
    return TrajectoryWithRew(DictObs(whole.observations), whole.actions, infos, terminal=True, rews=whole.rewards)


def from_trajectories(trajectories: Sequence[TrajectoryWithRew], level: str | None = None) -> Demonstrations:
    """
    Failed episodes are left out.

    :param trajectories: of one level, whose observations have "image" and "mission"; other parts are not looked at
    :param level: of trajectories that do not tell, such as those of imitation's own rollouts
    :raises ValueError: if nothing tells the level, no episode has succeeded, or they can't be of our levels
    """
    lasts = [{} if trajectory.infos is None else trajectory.infos[-1] for trajectory in trajectories]
    levels = {last.get("level", level) for last in lasts}
    if len(levels) != 1 or None in levels:
        raise ValueError(f"trajectories of the levels {sorted(map(str, levels))}: expected those of one level, or level=...")
    wholes = [_whole(trajectory, last) for trajectory, last in zip(trajectories, lasts, strict=True)]
    return demonstrations_of(wholes, levels.pop(), lasts[0].get("provenance", {"imitation": "trajectories"}))


def _whole(trajectory: TrajectoryWithRew, last: dict[str, Any]) -> WholeEpisode:
    ends = np.arange(len(trajectory)) == len(trajectory) - 1
    success = last.get("is_success", False)
    return WholeEpisode(
        observations=dict(trajectory.obs.items()),  # type: ignore[union-attr]  # a DictObs
        actions=trajectory.acts,
        rewards=trajectory.rews,
        terminations=ends & success,
        truncations=ends & (not success),
        seed=last.get("seed", NO_SEED),
    )
