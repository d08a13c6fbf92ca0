"""Pictures of a language while it emerges."""

import io

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

from sb3_guide.callbacks.rollouts import is_due
from sb3_guide.cloning import mission_seeds
from sb3_guide.language import Reading, learn, read
from sb3_guide.policies import AgentPolicy


class LanguagePictures:
    """
    Let an agent play validation missions, and show in TensorBoard how often each message is sent (``guide/messages``), which
    actions follow it (``guide/actions``, the paper's figure A.1) and, where the environment draws itself, an episode as a clip
    (``guide/episode``). Called without arguments,
    as by ``BC.train(on_epoch_end=...)``, it counts the epochs. Needs matplotlib, pillow and tensorboard, which the extra
    ``experiments`` brings.

    :param policy: with a channel
    :param level: name or id of the level to play, or id of another environment
    :param logger: SB3's or imitation's; where it does not write for TensorBoard, nothing is played
    :param n_episodes: missions to play
    :raises ValueError: if the policy has no channel, or a continuous one, or no mission is to be played
    """

    def __init__(self, policy: AgentPolicy, level: str, logger: Logger, n_episodes: int = 100) -> None:
        policy.channel.encoder.shape.check_enumerable()
        self.policy = policy
        self.level = level
        self.logger = logger
        self.seeds = mission_seeds("validation", n_episodes)
        self.calls = 0

    def __call__(self) -> None:
        self.calls += 1
        self.show(self.calls)

    def show(self, step: int) -> None:
        """
        :param step: of the training, on TensorBoard's axis
        """
        outputs = getattr(self.logger, "default_logger", self.logger).output_formats  # imitation's logger wraps one of SB3's
        boards = [output for output in outputs if isinstance(output, TensorBoardOutputFormat)]
        if not boards:
            return
        training, chance = self.policy.training, self.policy.channel.chance.get_state()
        reading = read(self.policy, self.level, self.seeds)
        self.policy.set_training_mode(training)
        self.policy.channel.chance.set_state(chance)
        for board in boards:
            show(board, reading, self.level, step)


def show(board: TensorBoardOutputFormat, reading: Reading, level: str, step: int) -> None:
    """
    :param board: where to show
    :param reading: what
    :param level: name or id of the level that was played
    :param step: of the training
    """
    from PIL import Image  # needed here alone, as what the pictures are drawn with
    from tensorboard.compat.proto.summary_pb2 import Summary

    from sb3_guide.language.animation import animation, replay, worth_watching
    from sb3_guide.language.pictures import conditional_bars

    figure = conditional_bars(reading.shape.names(), list(reading.actions), learn(reading).counts)
    board.writer.add_histogram("guide/messages", reading.messages, step, bins=np.arange(reading.shape.count + 1))  # type: ignore[arg-type]
    board.writer.add_figure("guide/actions", figure, step, close=False)
    # A GIF, which TensorBoard plays: torch's add_video would need moviepy, and the releases before 2.0 of that
    if (shown := replay(reading, level, worth_watching(reading))) is not None:
        clip = animation(*shown)
        width, height = Image.open(io.BytesIO(clip)).size
        image = Summary.Image(height=height, width=width, colorspace=3, encoded_image_string=clip)
        summary = Summary(value=[Summary.Value(tag="guide/episode", image=image)])
        board.writer.file_writer.add_summary(summary, step)  # type: ignore[attr-defined]  # torch types it as None
    board.writer.flush()


class LanguageCallback(BaseCallback):
    """
    Show :class:`LanguagePictures` now and then. Works with PPO, A2C and RecurrentPPO and our policies with a channel, and
    changes nothing in their training.

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
        self.n_episodes = n_episodes
        self.every_n_rollouts = every_n_rollouts

    def _init_callback(self) -> None:
        if not isinstance(self.model.policy, AgentPolicy):
            raise ValueError(
                f"{type(self.model.policy).__name__} sends no messages: expected GuidePolicy or GuidedLearnerPolicy"
            )
        self.pictures = LanguagePictures(self.model.policy, self.level, self.logger, self.n_episodes)

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        if is_due(self, self.every_n_rollouts):
            self.pictures.show(self.num_timesteps)
