"""What brings other environments' observations into the form that agents see: "image", "mission" as tokens, "history"."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs

from sb3_guide.envs.vocabulary import Vocabulary

Observation = dict[str, np.ndarray]


class TextMissionWrapper(gymnasium.ObservationWrapper, RecordConstructorArgs):
    """
    Observe the image, and the mission as tokens instead of text; everything else is left out.

    :param env: that observes a Dict with "image" and with "mission" as text, such as Minigrid's
    :param vocabulary: that has the words of all its missions
    :raises ValueError: if the environment does not observe these two
    """

    def __init__(self, env: gymnasium.Env, vocabulary: Vocabulary) -> None:
        RecordConstructorArgs.__init__(self, vocabulary=vocabulary)
        gymnasium.ObservationWrapper.__init__(self, env)
        seen = env.observation_space
        if not isinstance(seen, spaces.Dict) or not {"image", "mission"} <= set(seen.spaces):
            raise ValueError(f"{env} observes {seen}: expected a Dict with 'image' and 'mission'")
        self.vocabulary = vocabulary
        self.observation_space = spaces.Dict({"image": seen["image"], "mission": vocabulary.space})

    def observation(self, observation: dict[str, Any]) -> Observation:
        """
        :param observation: of the environment
        :return: "image" as it is, "mission" (length,) tokens
        :raises ValueError: if a word of the mission is unknown, or there are too many
        """
        return {"image": observation["image"], "mission": self.vocabulary.encode(observation["mission"])}


class HistoryWrapper(gymnasium.ObservationWrapper, RecordConstructorArgs):
    """
    Observe the images before the present one too, as "history": what policies with window memory remember.

    :param env: that observes a Dict with "image"
    :param history: how many
    :raises ValueError: if there is no image, or a number of them that is not positive
    """

    def __init__(self, env: gymnasium.Env, history: int) -> None:
        RecordConstructorArgs.__init__(self, history=history)
        gymnasium.ObservationWrapper.__init__(self, env)
        seen = env.observation_space
        if not isinstance(seen, spaces.Dict) or not isinstance(seen.spaces.get("image"), spaces.Box) or history < 1:
            raise ValueError(f"history={history}, and {env} observes {seen}: expected at least 1, and a Dict with 'image'")
        image = seen["image"]
        assert isinstance(image, spaces.Box)
        low, high = (np.repeat(bound[None], history, axis=0) for bound in (np.minimum(image.low, 0), image.high))
        self.observation_space = spaces.Dict({**seen.spaces, "history": spaces.Box(low, high, low.shape, low.dtype.type)})
        self._seen = np.zeros((history + 1, *image.shape), dtype=image.dtype)

    def reset(self, **kwargs: Any) -> tuple[Observation, dict[str, Any]]:
        """
        Begin an episode, before which there is nothing but zeros.

        :param kwargs: as the environment takes them
        """
        self._seen = np.zeros_like(self._seen)
        return super().reset(**kwargs)

    def observation(self, observation: Observation) -> Observation:
        """
        :param observation: of the environment
        :return: the same and "history" (history, ...)
        """
        self._seen = np.concatenate([self._seen[1:], observation["image"][None]])
        return {**observation, "history": self._seen[:-1]}
