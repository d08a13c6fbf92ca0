"""Agents to disk and back, without pickle."""

import inspect
from pathlib import Path
from textwrap import shorten
from typing import Any

import torch as th
from gymnasium import spaces
from torch import nn

from sb3_guide.envs import ACTIONS, observation_space
from sb3_guide.policies.agents import GuideAgent, LearnerAgent
from sb3_guide.policies.base import AgentPolicy
from sb3_guide.policies.folder import Description, actions_of, described, package_versions, read_agent, space_of, write_agent
from sb3_guide.policies.pretrained import within
from sb3_guide.policies.recurrent import RecurrentGuidedLearnerPolicy, RecurrentGuidePolicy, RecurrentLearnerPolicy
from sb3_guide.policies.sequences import history_of
from sb3_guide.policies.window import GuidedLearnerPolicy, GuidePolicy, LearnerPolicy

POLICIES: dict[str, type[AgentPolicy]] = {
    policy.__name__: policy
    for policy in (
        LearnerPolicy,
        GuidePolicy,
        GuidedLearnerPolicy,
        RecurrentLearnerPolicy,
        RecurrentGuidePolicy,
        RecurrentGuidedLearnerPolicy,
    )
}
ALIASES = ("pi_features_extractor.", "vf_features_extractor.")  # SB3's second and third name of the features extractor


def weights_of(policy: AgentPolicy) -> dict[str, th.Tensor]:
    """:return: every weight of a policy once, by name"""
    return {name: weight for name, weight in policy.state_dict().items() if not name.startswith(ALIASES)}


def load_weights(policy: AgentPolicy, weights: dict[str, th.Tensor]) -> None:
    """
    :param policy: to be changed
    :param weights: as :func:`weights_of` returns them
    :raises RuntimeError: if names or shapes are not the policy's
    """
    if unknown := weights.keys() - weights_of(policy).keys():
        raise RuntimeError(f"there is no place for {', '.join(sorted(unknown))}")
    for name, module in policy.named_children():
        if f"{name}." not in ALIASES:
            module.load_state_dict({k.removeprefix(f"{name}."): w for k, w in weights.items() if k.startswith(f"{name}.")})


def save_agent(policy: AgentPolicy, folder: str | Path, level: str | None = None) -> None:
    """
    Write an agent's folder: network.safetensors and agent.json.

    :param policy: of one of POLICIES' classes
    :param folder: made if need be; an agent that is there is replaced
    :param level: where the agent was trained, for the record
    :raises ValueError: if :func:`load_agent` could not build it
    """
    name = type(policy).__name__
    if POLICIES.get(name) is not type(policy):
        raise ValueError(
            f"{name} could not be loaded again: expected one of {', '.join(POLICIES)}, such as model.policy; your own can "
            "be, with an entry in sb3_guide.policies.saving.POLICIES"
        )
    activation = getattr(policy.activation_fn, "__name__", repr(policy.activation_fn))
    if getattr(nn.modules.activation, activation, None) is not policy.activation_fn:
        raise ValueError(f"activation_fn={activation} can't be loaded again: expected one of torch.nn's activation functions")
    kwargs: dict[str, Any] = {
        **policy.agent_kwargs,
        "net_arch": policy.net_arch,
        "activation_fn": activation,
    }
    assert isinstance(policy.observation_space, spaces.Dict)
    description = Description(
        name,
        kwargs,
        history_of(policy.observation_space),
        level,
        package_versions(),
        observation_space=described(policy.observation_space),
        actions=int(policy.action_space.n),  # type: ignore[attr-defined]
    )
    write_agent(folder, description, weights_of(policy))


def load_agent(folder: str | Path, kind: type[AgentPolicy] | None = None) -> AgentPolicy:
    """
    Build the policy that an agent's folder describes. Nothing in the folder can execute code.

    :param folder: written by :func:`save_agent`
    :param kind: class that the policy must be of; None takes any
    :raises FileNotFoundError: if the folder is no agent's
    :raises ValueError: if its files are damaged, or describe another kind of agent
    """
    description, weights = read_agent(folder)
    policy_class = POLICIES.get(description.policy)
    expected = [name for name, policy in POLICIES.items() if kind is None or issubclass(policy, kind)]
    if policy_class is None or description.policy not in expected:
        raise ValueError(f"{folder} holds a {description.policy}: expected one of {', '.join(expected)}")
    try:
        policy = build(policy_class, description)
        load_weights(policy, weights)
    except (AssertionError, AttributeError, LookupError, OverflowError, RuntimeError, TypeError, ValueError) as error:
        reason = shorten(str(error), 200)  # torch names every weight
        raise ValueError(f"{folder} is damaged: its weights and its description don't fit ({reason})") from error
    policy.set_training_mode(False)
    return policy


def start_from(policy: AgentPolicy, folder: str | Path) -> None:
    """
    Copy weights of another agent: all of them of a Learner, and a Guide's trunk, which is a Learner's without heads.

    :param policy: a Learner, to be changed
    :param folder: of a Learner or a Guide
    :raises ValueError: if it holds another agent, or one of another size
    """
    description, weights = read_agent(folder)
    source = POLICIES.get(description.policy)
    if source is None or not issubclass(source, LearnerAgent | GuideAgent):
        raise ValueError(f"{folder} holds a {description.policy}: expected a Learner or a Guide to start from")
    try:
        if issubclass(source, LearnerAgent):
            load_weights(policy, weights)
        else:
            speaker = within(weights, "features_extractor.speaker.")
            trunk = {name: weight for name, weight in speaker.items() if not name.startswith("decoder.")}
            policy.network.load_state_dict(trunk)
    except RuntimeError as error:
        raise ValueError(f"{folder} holds an agent of another size or observation space ({error})") from error


def build(policy_class: type[AgentPolicy], description: Description) -> AgentPolicy:
    """
    :return: the policy with fresh weights
    :raises TypeError: if it takes no such arguments
    :raises ValueError: if one is out of range
    """
    kwargs = dict(description.kwargs)
    name = kwargs.pop("activation_fn")
    if name not in nn.modules.activation.__all__:
        raise ValueError(f"activation_fn={name!r} is no activation function of torch")
    own = inspect.signature(policy_class.__init__).parameters  # SB3's own may do more than is meant here
    if unknown := kwargs.keys() - own.keys() - {"net_arch"}:
        raise TypeError(f"{policy_class.__name__} takes no {', '.join(sorted(unknown))}")
    if not isinstance(kwargs.get("guide", {}), dict):
        raise TypeError(f"guide={kwargs['guide']!r} is no description")
    of_levels = observation_space(description.history)
    return policy_class(
        of_levels if description.observation_space is None else space_of(description.observation_space),
        actions_of(len(ACTIONS) if description.actions is None else description.actions),
        lambda _: 0.0,
        activation_fn=getattr(nn, name),
        **kwargs,
    )
