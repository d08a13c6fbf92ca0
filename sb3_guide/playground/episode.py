"""One episode of an agent, moment by moment: a person may speak in the Guide's place, and time goes back as well."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch as th

from sb3_guide.playground.cast import Speaker
from sb3_guide.playground.scenes import Observation, Outcome, Scene, scene_of

HIGHEST_SEED = 2**53 - 1  # the highest number that a browser counts up to
LONGEST_MISSION = 400  # characters


@dataclass(frozen=True)
class Beginning:
    """
    Where an episode begins. All that follows depends on the messages alone.

    :param level: name of the level, or id of another environment
    :param seed: of the world
    :param mission: of a person's own; "" for the world's
    :raises ValueError: if the seed or the mission is too long
    """

    level: str
    seed: int
    mission: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.seed <= HIGHEST_SEED:
            raise ValueError(f"world {self.seed}: expected a number from 0 to {HIGHEST_SEED}")
        if len(self.mission) > LONGEST_MISSION:
            raise ValueError(f"the mission has {len(self.mission)} characters: expected at most {LONGEST_MISSION}")


class Moment(NamedTuple):
    """
    M messages, A actions.

    :param world: its exact state, as the scene takes it
    :param observation: what the agent sees
    :param memory: what it remembers of the time before, as ``predict`` takes it
    :param spoken: index of the message that the Guide speaks
    :param message_probabilities: (M,) of each message
    :param action_probabilities: (M, A) of each action, were each message heard
    :param outcome: how the episode ended, if it did
    """

    world: Any
    observation: Observation
    memory: tuple[np.ndarray, ...] | None
    spoken: int
    message_probabilities: np.ndarray
    action_probabilities: np.ndarray
    outcome: Outcome


class Turn(NamedTuple):
    """
    What happened between two moments.

    :param heard: index of the message
    :param by_person: whether a person said it in the Guide's place
    :param action: that the agent took
    """

    heard: int
    by_person: bool
    action: int


class Episode:
    """
    An episode up to the present moment.

    :param speaker: who plays
    :param beginning: where
    :raises ValueError: if the agent can't play there, or the mission is none
    """

    def __init__(self, speaker: Speaker, beginning: Beginning) -> None:
        self.speaker = speaker
        speaker.check_level(beginning.level)
        self._place = (beginning.level, speaker.seen)
        self.scene = scene_of(*self._place)
        observation = self.scene.begin(beginning.seed, beginning.mission)
        self.turns: list[Turn] = []
        self.moments = [self._moment(observation, None, "")]

    @property
    def now(self) -> Moment:
        """The present moment."""
        return self.moments[-1]

    def step(self, message: int | None = None) -> None:
        """
        Let the agent hear a message and act.

        :param message: index of what a person says; None for what the Guide speaks
        :raises ValueError: if the episode has ended
        """
        now = self.now
        if now.outcome:
            raise ValueError(f"the episode has ended ({now.outcome}): expected a step before its end")
        heard = now.spoken if message is None else message
        action, memory = self.speaker.tell(now.observation, now.memory, heard)
        observation, outcome = self.scene.step(action)
        self.turns.append(Turn(heard, message is not None, action))
        self.moments.append(self._moment(observation, memory, outcome))

    def back(self) -> Turn:
        """
        Undo the last turn, to the bit.

        :return: that turn
        :raises IndexError: if there was none
        """
        turn = self.turns.pop()
        self.moments.pop()
        self.scene.restore(self.now.world)
        return turn

    def pictures(self) -> "Pictures":
        """:return: the world at each moment up to now"""
        return Pictures(scene_of(*self._place), [moment.world for moment in self.moments])

    def _moment(self, observation: Observation, memory: tuple[np.ndarray, ...] | None, outcome: Outcome) -> Moment:
        policy, channel = self.speaker.policy, self.speaker.policy.channel
        state = None if memory is None else (th.as_tensor(memory[0]), th.as_tensor(memory[1]))
        with th.no_grad():
            remembered = policy.memory(policy.obs_to_tensor(observation)[0], state)  # type: ignore[arg-type]
            spoken = self.speaker.shape.index(channel.speak(remembered).argmax(dim=-1))
            messages, actions = channel.message_log_probs(remembered), policy.listen(remembered)
        world = self.scene.state()
        return Moment(world, observation, memory, int(spoken), messages[0].exp().numpy(), actions[0].exp().numpy(), outcome)


class Pictures(Sequence[np.ndarray]):
    """
    Pictures of worlds, (height, width, 3) uint8 each, which are drawn when they are asked for: those of a long way through a
    maze would fill the memory.

    :param scene: of its own, as it is played to and fro
    :param worlds: their states
    """

    def __init__(self, scene: Scene, worlds: list[Any]) -> None:
        self._scene = scene
        self._worlds = worlds

    def __len__(self) -> int:
        return len(self._worlds)

    def __getitem__(self, index: Any) -> Any:
        self._scene.restore(self._worlds[index])
        return self._scene.world()
