"""Pictures of a language while it emerges."""

import torch as th
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Figure

from sb3_guide.cloning import mission_seeds
from sb3_guide.language import learn, read
from sb3_guide.policies import AgentPolicy

FORMATS = ("stdout", "log", "json", "csv")  # SB3's, which show no pictures


class LanguageCallback(BaseCallback):
    """
    Let the agent play validation missions now and then, and show in TensorBoard how often each message is sent
    (``guide/messages``) and which actions follow it (``guide/actions``, the paper's figure A.1). Works with PPO, A2C and
    RecurrentPPO and our policies with a channel, and changes nothing in their training. Needs matplotlib and tensorboard,
    which the extra ``experiments`` brings.

    :param level: name or id of the level to play, or id of another environment
    :param n_episodes: missions to play
    :param every_n_rollouts: after one rollout in so many
    :param verbose: as in SB3
    :raises ValueError: if a number is not positive
    """

    def __init__(self, level: str, n_episodes: int = 100, every_n_rollouts: int = 10, verbose: int = 0) -> None:
        super().__init__(verbose)
        if n_episodes < 1 or every_n_rollouts < 1:
            raise ValueError(f"n_episodes={n_episodes} and every_n_rollouts={every_n_rollouts}: expected at least 1 of each")
        self.level = level
        self.seeds = mission_seeds("validation", n_episodes)
        self.every_n_rollouts = every_n_rollouts
        self.n_rollouts = 0

    def _init_callback(self) -> None:
        if not isinstance(self.model.policy, AgentPolicy):
            raise ValueError(
                f"{type(self.model.policy).__name__} sends no messages: expected GuidePolicy or GuidedLearnerPolicy"
            )
        assert self.model.policy.channel  # raises where the agent has none

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self.n_rollouts += 1
        if self.n_rollouts % self.every_n_rollouts:
            return
        from sb3_guide.language.pictures import conditional_bars  # needs matplotlib, which trainings without pictures don't

        assert isinstance(self.model.policy, AgentPolicy)
        reading = read(self.model.policy, self.level, self.seeds)
        figure = conditional_bars(reading.shape.names(), list(reading.actions), learn(reading).counts)
        self.logger.record("guide/messages", th.as_tensor(reading.messages), exclude=FORMATS)
        self.logger.record("guide/actions", Figure(figure, close=False), exclude=FORMATS)
