"""A Guide that was trained before, as an ingredient of new policies."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch as th

from sb3_guide.policies.folder import Description, read_agent

UNTRAINED = {"size": "compact", "message_length": 2, "vocabulary_size": 3, "channel": "discrete"}
GUIDES = ("GuidePolicy", "RecurrentGuidePolicy")


@dataclass
class PretrainedGuide:
    """
    What a ``GuidedLearnerPolicy`` takes as ``guide``. Copies hold the weights too, the one in SB3's zip of a model
    among them: else an agent that is built of them would hear an untrained Guide.

    :param description: class and sizes of the Guide
    :param weights: of the Guide's speaker, by name; None where another source brings them
    """

    description: Description
    weights: dict[str, th.Tensor] | None = field(default=None, repr=False, compare=False)

    @classmethod
    def of(cls, guide: "PretrainedGuide | Mapping[str, Any] | str | Path | None") -> "PretrainedGuide":
        """
        :param guide: a pretrained Guide already, an agent's folder, or a description as agent.json has it
        :raises ValueError: if it is not a Guide
        :raises FileNotFoundError: if it is a path where no agent is
        """
        if isinstance(guide, str | Path):
            return cls.from_folder(guide)
        if isinstance(guide, Mapping):
            return cls(Description(**guide))
        if isinstance(guide, cls):
            return guide
        raise ValueError(
            f"guide={guide!r} is no Guide: a GuidedLearnerPolicy needs a pretrained one, "
            'such as policy_kwargs={"guide": PretrainedGuide.from_folder("runs/guide")}'
        )

    @classmethod
    def from_folder(cls, folder: str | Path) -> "PretrainedGuide":
        """
        :param folder: of an agent saved by :func:`~sb3_guide.policies.save_agent`
        :raises ValueError: if it holds no Guide
        :raises FileNotFoundError: if it is no agent's folder
        """
        description, weights = read_agent(folder)
        if description.policy not in GUIDES:
            raise ValueError(f"{folder} holds a {description.policy}: expected one of {', '.join(GUIDES)}")
        return cls(description, within(weights, "features_extractor.speaker."))

    @classmethod
    def untrained(cls, **kwargs: Any) -> "PretrainedGuide":
        """
        A Guide that was never trained: a control with the same capacity.

        :param kwargs: "message_length", "vocabulary_size", "channel" or "size", as :class:`RecurrentGuidePolicy` takes them
        """
        return cls(Description("RecurrentGuidePolicy", {**UNTRAINED, **kwargs}, history=0))

    @property
    def form(self) -> dict[str, Any]:
        """Size and form of messages, as the constructor of its network names them."""
        kwargs = {"channel": "discrete", **self.description.kwargs}  # earlier versions knew no other
        return {name: kwargs[name] for name in UNTRAINED}

    @property
    def carries_memory(self) -> bool:
        """Whether the Guide's memory goes through the episode; it remembers windows otherwise."""
        return self.description.policy == "RecurrentGuidePolicy"


def within(weights: dict[str, th.Tensor], prefix: str) -> dict[str, th.Tensor]:
    """:return: the weights below a prefix, without it"""
    return {name.removeprefix(prefix): weight for name, weight in weights.items() if name.startswith(prefix)}
