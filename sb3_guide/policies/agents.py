"""The three agents as policies, whichever way their memory is fed."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gymnasium import spaces
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.type_aliases import Schedule

from sb3_guide.policies.base import AgentPolicy
from sb3_guide.policies.channel import MAX_MESSAGES
from sb3_guide.policies.interventions import Intervention, intervention_of
from sb3_guide.policies.networks import Guide, GuidedLearner, Latent, Learner
from sb3_guide.policies.pretrained import PretrainedGuide


class LearnerAgent(AgentPolicy):
    """
    An agent that acts alone.

    :param size: "compact", "medium" or "paper" (Table A.2)
    :param ortho_init: SB3's orthogonal initialisation, which would undo FiLM's own
    """

    network_class = Learner

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.Discrete,
        lr_schedule: Schedule,
        *,
        size: str = "compact",
        ortho_init: bool = False,
        **kwargs: Any,
    ) -> None:
        own, kwargs = {"size": size}, {**kwargs, "ortho_init": ortho_init}
        super().__init__(observation_space, action_space, lr_schedule, network_kwargs=own, agent_kwargs=own, **kwargs)


class SpeakingAgent(AgentPolicy):
    """What the two agents with a channel share: a pretrained Guide may speak in them."""

    def _adopt(self, guide: PretrainedGuide, freeze: bool) -> None:
        """
        :param guide: whose weights are copied, unless they come from elsewhere
        :param freeze: keep them as they are
        :raises ValueError: if they don't fit what this agent observes
        """
        if guide.weights is not None:
            try:
                self.channel.speaker.load_state_dict(guide.weights)
            except RuntimeError as error:
                raise ValueError(
                    f"the Guide was trained on other observations than {self.observation_space} ({error})"
                ) from error
        self.channel.speaker.requires_grad_(not freeze)

    @classmethod
    def _guide(cls, guide: PretrainedGuide | Mapping[str, Any] | str | Path | None) -> PretrainedGuide:
        """
        :return: the Guide, whatever it was named by
        :raises ValueError: if there is no Guide, or one of the other memory mode
        """
        pretrained = PretrainedGuide.of(guide)
        if pretrained.carries_memory != cls.carries_memory:
            raise ValueError(
                f"{cls.__name__} can't hear a {pretrained.description.policy}: one carries its memory through the episode, "
                "the other remembers a window; expected a Guide of the same kind (both Recurrent or neither)"
            )
        return pretrained


class GuideAgent(SpeakingAgent):
    """
    An agent that acts through messages of its own; or, given a pretrained Guide, one that reads that Guide's messages and
    nothing else.

    :param size: "compact", "medium" or "paper" (Table A.2)
    :param message_length: symbols in a message
    :param vocabulary_size: different symbols
    :param channel: "discrete", or "continuous" for messages without symbols, of as many numbers
        (:class:`~sb3_guide.policies.MessageShape`)
    :param guide: an agent's folder, a :class:`PretrainedGuide` or its description: who speaks; None makes a new Guide
    :param freeze_guide: keep that Guide as it is; it is trained along otherwise
    :param ortho_init: SB3's orthogonal initialisation, which would undo FiLM's own and the channel's
    :raises ValueError: if the Guide is of another memory mode, size or message shape
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
        channel: str = "discrete",
        guide: PretrainedGuide | Mapping[str, Any] | str | Path | None = None,
        freeze_guide: bool = False,
        ortho_init: bool = False,
        **kwargs: Any,
    ) -> None:
        shape = {"message_length": message_length, "vocabulary_size": vocabulary_size, "channel": channel}
        own: dict[str, Any] = {"size": size, **shape}
        pretrained = None if guide is None else self._guide(guide)
        of_guide = {} if pretrained is None else {"guide": asdict(pretrained.description), "freeze_guide": freeze_guide}
        if pretrained is not None and pretrained.form != own:
            raise ValueError(f"the Guide has {pretrained.form}: expected {own}")
        kwargs = {**kwargs, "ortho_init": ortho_init}
        super().__init__(
            observation_space, action_space, lr_schedule, network_kwargs=own, agent_kwargs={**own, **of_guide}, **kwargs
        )
        if pretrained is not None:
            self._adopt(pretrained, freeze_guide)

    def exploring_distribution(self, latent: Latent) -> Distribution:
        """
        Messages are drawn as well as actions: P(a) is the sum over all messages of P(m) P(a | m), exactly, so that nothing has
        to go through the straight-through gradient, which dies where messages are certain. Where messages can't be enumerated,
        or don't arrive as they were spoken, they are the most probable ones.

        :param latent: of K frames
        :return: distribution of K actions
        """
        encoder = self.channel.encoder
        heard_as_spoken = self.channel.intervention == Intervention()
        if not (self.has_symbols and encoder.shape.count <= MAX_MESSAGES and heard_as_spoken):
            return self.action_distribution(latent)
        spoken = self.channel.message_log_probs(latent.memory).unsqueeze(2)  # (K, M, 1)
        heard = self.action_net(self.mlp_extractor.policy_net(encoder.all())).log_softmax(dim=-1)  # (M, A)
        return self.action_dist.proba_distribution(action_logits=(spoken + heard).logsumexp(dim=1))  # type: ignore[arg-type,call-arg]


class GuidedLearnerAgent(SpeakingAgent):
    """
    A new Learner that hears a pretrained Guide. The Guide's trunk, decoder and temperature are copied into the policy and
    belong to it from then on; the message encoder is new.

    :param guide: an agent's folder, a :class:`PretrainedGuide` or its description
    :param freeze_guide: keep the Guide as it is; it is trained along otherwise
    :param hears: name of the intervention that its messages pass through, such as "silent"
        (:data:`~sb3_guide.policies.interventions.INTERVENTIONS`)
    :param size: of the Learner, "compact", "medium" or "paper" (Table A.2)
    :param ortho_init: SB3's orthogonal initialisation, which would undo FiLM's own and the channel's
    :raises ValueError: if there is no Guide or one of the other memory mode, or no such intervention in its channel
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
        hears: str = "spoken",
        size: str = "compact",
        ortho_init: bool = False,
        **kwargs: Any,
    ) -> None:
        pretrained, intervention = self._guide(guide), intervention_of(hears)
        form = pretrained.form
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            network_kwargs={**form, "size": size, "guide_size": form["size"]},
            agent_kwargs={
                "size": size,
                "guide": asdict(pretrained.description),
                "freeze_guide": freeze_guide,
                "hears": hears,
            },
            ortho_init=ortho_init,
            **kwargs,
        )
        self._adopt(pretrained, freeze_guide)
        self.channel.intervention = intervention
