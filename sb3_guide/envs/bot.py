"""
Minigrid's BabyAI bot as an expert that needs no training. It plays on Minigrid's twin of a level; thanks to parity, its
actions do the same in ours. Needs the extra `bot`.
"""

from __future__ import annotations

from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from typing import Any

import gymnasium
import numpy as np

try:
    from minigrid.envs.babyai.core.roomgrid_level import RoomGridLevel
    from minigrid.envs.babyai.core.verifier import ObjDesc, PutNextInstr
    from minigrid.envs.babyai.goto import GoTo
    from minigrid.utils.baby_ai_bot import BabyAIBot
except ImportError as error:
    raise ImportError("the bot plays on Minigrid's levels: pip install 'sb3-guide[bot]'") from error

from sb3_guide.envs.levels import level_of

_MOST_SEARCHES = 1000  # for one action; where the bot finds no plan, it would search for ever


class PutNext(RoomGridLevel):
    """BabyAI's PutNext (ICLR 2019), which Minigrid does not register: PutNextLocal in a maze, objects not unique."""

    def gen_mission(self) -> None:
        """Draw the mission, in the order of Minigrid's other mazes."""
        self.place_agent()
        self.connect_all()
        objects = self.add_distractors(num_distractors=18, all_unique=False)
        self.check_objs_reachable()
        moved, fixed = self._rand_subset(objects, 2)
        self.instrs = PutNextInstr(ObjDesc(moved.type, moved.color), ObjDesc(fixed.type, fixed.color))


def twin(level: str, **kwargs: Any) -> gymnasium.Env:
    """
    Make Minigrid's env of a level.

    :param level: name or id of the level
    :param kwargs: for the env, such as `render_mode`
    :return: the env without wrappers
    :raises ValueError: if there is no such level
    """
    rules = level_of(level)
    if rules.name == "PutNext":
        return PutNext(**kwargs)
    if f"BabyAI-{rules.name}-v0" not in gymnasium.registry:  # one of our small mazes
        sizes = {"room_size": rules.room_size, "num_rows": rules.rows, "num_cols": rules.columns}
        return GoTo(**sizes, num_dists=rules.distractors, **kwargs)
    return gymnasium.make(f"BabyAI-{rules.name}-v0", disable_env_checker=True, **kwargs).unwrapped


class _BoundedBot(BabyAIBot):
    searches = 0

    def replan(self, action_taken: int | None) -> int:
        self.searches = 0
        return super().replan(action_taken)

    def _shortest_path(self, *args: Any, **kwargs: Any) -> Any:
        self.searches += 1
        if self.searches > _MOST_SEARCHES:
            raise RuntimeError(f"no plan after {_MOST_SEARCHES} searches")
        return super()._shortest_path(*args, **kwargs)


@dataclass(frozen=True)
class BotEpisode:
    """
    What the bot did in a mission.

    :param actions: (T,) int64, to be played after a reset with the mission's seed
    :param success: whether the mission is accomplished by them
    :param failure: why not: what the bot ran into, or "out of steps"; None after a success
    """

    actions: np.ndarray
    success: bool
    failure: str | None


def play(level: str, seed: int) -> BotEpisode:
    """
    Let the bot play a mission.

    :param level: name or id of the level
    :param seed: of the mission
    :return: its actions and how they ended. The bot fails where a mission is unsolvable, and sometimes in its own plans
    :raises ValueError: if there is no such level
    """
    env = twin(level)
    with redirect_stdout(StringIO()):  # Minigrid prints every grid that it rejects
        env.reset(seed=seed)
    actions: list[int] = []
    success, over, failure = False, False, None
    try:
        bot = _BoundedBot(env)
        while not over:
            actions.append(int(bot.replan(actions[-1] if actions else None)))
            _, _, success, truncated, _ = env.step(actions[-1])
            over = success or truncated
    except Exception as error:  # whatever the bot's planning runs into belongs into the result
        failure = f"{type(error).__name__}: {error}"
    if over and not success:
        failure = "out of steps"
    return BotEpisode(np.array(actions, dtype=np.int64), bool(success), failure)
