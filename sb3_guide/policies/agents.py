"""The three agents as policies, whichever way their memory is fed."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gymnasium import spaces
from stable_baselines3.common.type_aliases import Schedule

from sb3_guide.policies.base import AgentPolicy
from sb3_guide.policies.networks import Guide, GuidedLearner, Learner
from sb3_guide.policies.pretrained import PretrainedGuide


class LearnerAgent(AgentPolicy):
    """
    An agent that acts alone.

    :param size: "compact" or "paper" (Table A.2)
    """

    network_class = Learner

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.Discrete,
        lr_schedule: Schedule,
        *,
        size: str = "compact",
        **kwargs: Any,
    ) -> None:
        own = {"size": size}
        super().__init__(observation_space, action_space, lr_schedule, network_kwargs=own, agent_kwargs=own, **kwargs)


class GuideAgent(AgentPolicy):
    """
    An agent that acts through messages of its own.

    :param size: "compact" or "paper" (Table A.2)
    :param message_length: symbols in a message
    :param vocabulary_size: different symbols
    :param ortho_init: SB3's orthogonal initialisation, which would undo the channel's own
    """

    network_class = Guide

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.Discrete,
        lr_schedule: Schedule,
        *,
        size: str = "compact",
        message_length: int = 2,
        vocabulary_size: int = 3,
        ortho_init: bool = False,
        **kwargs: Any,
    ) -> None:
        own = {"size": size, "message_length": message_length, "vocabulary_size": vocabulary_size}
        kwargs = {**kwargs, "ortho_init": ortho_init}
        super().__init__(observation_space, action_space, lr_schedule, network_kwargs=own, agent_kwargs=own, **kwargs)


class GuidedLearnerAgent(AgentPolicy):
    """
    A new Learner that hears a pretrained Guide. The Guide's trunk, decoder and temperature are copied into the policy and
    belong to it from then on; the message encoder is new.

    :param guide: an agent's folder, a :class:`PretrainedGuide` or its description
    :param freeze_guide: keep the Guide as it is; it is trained along otherwise
    :param size: of the Learner, "compact" or "paper" (Table A.2)
    :param ortho_init: SB3's orthogonal initialisation
    :raises ValueError: if there is no Guide, or one of the other memory mode
    """

    network_class = GuidedLearner

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.Discrete,
        lr_schedule: Schedule,
        *,
        guide: PretrainedGuide | Mapping[str, Any] | str | Path | None = None,
        freeze_guide: bool = False,
        size: str = "compact",
        ortho_init: bool = False,
        **kwargs: Any,
    ) -> None:
        guide = PretrainedGuide.of(guide)
        if guide.carries_memory != self.carries_memory:
            raise ValueError(
                f"{type(self).__name__} can't hear a {guide.description.policy}: one carries its memory through the episode, "
                "the other remembers a window; expected a Guide of the same kind (both Recurrent or neither)"
            )
        of_guide = guide.description.kwargs
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            network_kwargs={
                "size": size,
                "guide_size": of_guide["size"],
                "message_length": of_guide["message_length"],
                "vocabulary_size": of_guide["vocabulary_size"],
            },
            agent_kwargs={"size": size, "guide": asdict(guide.description), "freeze_guide": freeze_guide},
            ortho_init=ortho_init,
            **kwargs,
        )
        if guide.weights is not None:
            self.channel.speaker.load_state_dict(guide.weights)
        self.channel.speaker.requires_grad_(not freeze_guide)
