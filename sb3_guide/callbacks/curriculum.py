"""One training that goes from level to level."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

import numpy as np
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from sb3_guide.callbacks.success import EpisodeSuccesses
from sb3_guide.envs import level_of
from sb3_guide.files import check_number, filled

SETTINGS = ("lr_schedule", "ent_coef", "gamma", "gae_lambda")  # of the model, that a part may change
RANGES = (
    *(("success_rate", 0, 1), ("n_timesteps", 1, inf), ("learning_rate", 0, inf)),
    *(("ent_coef", 0, inf), ("gamma", 0, 1), ("gae_lambda", 0, 1)),
)


@dataclass(frozen=True)
class Part:
    """
    A part of a curriculum. It is over when its level is solved so often or so many frames have passed, whichever comes first.
    What is None is as the model was made.

    :param level: name or id of the level
    :param success_rate: of the last episodes of this part, 0 to 1
    :param n_timesteps: frames in all worlds together
    :param learning_rate: a number, or such as "lin_0.001" for a rate that falls from there to 0 over n_timesteps
    :param ent_coef: weight of the entropy
    :param gamma: discount
    :param gae_lambda: of generalised advantage estimation
    :raises ValueError: if the level is unknown, a number is out of range, or the part would have no end
    """

    level: str
    success_rate: float | None = None
    n_timesteps: int | None = None
    learning_rate: float | str | None = None
    ent_coef: float | None = None
    gamma: float | None = None
    gae_lambda: float | None = None

    def __post_init__(self) -> None:
        level_of(self.level)
        if self.success_rate is None and self.n_timesteps is None:
            raise ValueError(f"the part in {self.level} has no end: expected success_rate, n_timesteps or both")
        for name, least, most in RANGES:
            value = getattr(self, name)
            if value is not None and not (name == "learning_rate" and isinstance(value, str)):
                check_number(name, value, least, most)
        if isinstance(self.learning_rate, str):
            falling(self.learning_rate)
            if self.n_timesteps is None:
                raise ValueError(f"learning_rate={self.learning_rate!r} in {self.level} has no end: expected n_timesteps too")

    def rate(self, frames: int) -> float | None:
        """
        :param frames: that have passed in this part
        :return: the learning rate
        """
        if not isinstance(self.learning_rate, str):
            return self.learning_rate
        assert self.n_timesteps is not None
        return falling(self.learning_rate) * max(0.0, 1 - frames / self.n_timesteps)


def falling(text: str) -> float:
    """
    :param text: such as "lin_0.001", as rl-zoo writes a rate that falls from there to 0
    :return: where it begins
    :raises ValueError: if it is written otherwise
    """
    kind, _, start = text.partition("_")
    try:
        if kind == "lin" and isfinite(float(start)):
            return float(start)
    except ValueError:
        pass
    raise ValueError(f"schedule {text!r} is unknown: expected a number, or lin_ and a number")


class Curriculum(EpisodeSuccesses):
    """
    Let a model learn one level after another in the worlds that it has; the training ends with the last part. Parts can change
    rates too, such as to small steps and little entropy at the end. Works with PPO, A2C and RecurrentPPO, in our VecEnv and in
    SB3's: ``model.learn(10_000_000, callback=Curriculum([{"level": "GoToObj", "success_rate": 0.99}, ...]))``.

    :param parts: arguments of a :class:`Part` each
    :param n_episodes: that must have been played of a part before its success rate counts, and over which it is taken
    :param verbose: 1 to tell when a part begins
    :raises ValueError: if a part is not possible or there is none
    """

    def __init__(self, parts: Sequence[dict[str, Any]], n_episodes: int = 1000, verbose: int = 0) -> None:
        super().__init__(verbose)
        if not parts:
            raise ValueError("a curriculum of no parts: expected at least one")
        if n_episodes < 1:
            raise ValueError(f"n_episodes={n_episodes}: expected at least 1")
        self.parts = [filled(Part, "a part of a curriculum", part) for part in parts]
        self._n_episodes = n_episodes
        self.position = -1  # of the present part; none has begun
        self.first_frame = 0  # of the present part
        self.usual: dict[str, Any] = {}  # settings of the model as it was made

    @property
    def n_episodes(self) -> int:
        return self._n_episodes

    @property
    def part(self) -> Part:
        """The present part."""
        return self.parts[self.position]

    @property
    def last(self) -> bool:
        """Whether the present part is the last one."""
        return self.position + 1 == len(self.parts)

    @property
    def frames(self) -> int:
        """That have passed in the present part."""
        return self.model.num_timesteps - self.first_frame

    @property
    def over(self) -> bool:
        """Whether the present part is."""
        rate, frames = self.part.success_rate, self.part.n_timesteps
        return (rate is not None and self.enough(rate)) or (frames is not None and self.frames >= frames)

    def _init_callback(self) -> None:
        if self.model is not self.owner:
            self.usual = {name: getattr(self.model, name) for name in SETTINGS}
        super()._init_callback()

    def _forget(self) -> None:
        super()._forget()
        self.position = -1

    def _on_training_start(self) -> None:
        super()._on_training_start()
        if self.position < 0:
            self._begin_next()

    def _on_rollout_start(self) -> None:
        if self.over and not self.last:
            self._begin_next()
        rate = self.part.rate(self.frames)
        if rate is not None:
            self.model.lr_schedule = lambda _: rate

    def _on_step(self) -> bool:
        super()._on_step()
        return not (self.over and self.last)

    def _on_rollout_end(self) -> None:
        self.logger.record("curriculum/part", self.position)

    def get_state(self) -> dict[str, Any]:
        return {**super().get_state(), "position": self.position, "first_frame": self.first_frame}

    def set_state(self, state: dict[str, Any]) -> None:
        super().set_state(state)
        self.position, self.first_frame = state["position"], state["first_frame"]
        self._apply()

    def _begin_next(self) -> None:
        self.position += 1
        self.first_frame = self.model.num_timesteps
        self.successes.clear()
        self._apply()
        assert isinstance(self.model, OnPolicyAlgorithm)
        assert self.model.env is not None
        self.model._last_obs = self.model.env.reset()  # type: ignore[assignment]
        self.model._last_episode_starts = np.ones(self.model.n_envs, dtype=bool)
        if self.verbose:
            print(f"Curriculum: {self.part.level} from frame {self.first_frame:,} on")

    def _apply(self) -> None:
        """Bring worlds and model to the present part's level and settings; rates that fall follow at each rollout."""
        assert isinstance(self.model, OnPolicyAlgorithm)
        assert self.model.env is not None
        self.model.env.env_method("set_level", self.part.level)
        for name, usual in self.usual.items():
            value = getattr(self.part, name, None)
            setattr(self.model, name, usual if value is None else value)
        self.model.rollout_buffer.gamma, self.model.rollout_buffer.gae_lambda = self.model.gamma, self.model.gae_lambda
