"""What all policies share: SB3's heads on one of the agents' networks."""

import reprlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

import torch as th
from gymnasium import spaces
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import MlpExtractor
from stable_baselines3.common.type_aliases import Schedule
from torch import nn

from sb3_guide.policies.interventions import Intervention
from sb3_guide.policies.memory import State
from sb3_guide.policies.networks import AgentNetwork, GuideNetwork, Latent
from sb3_guide.policies.picture import check_spaces
from sb3_guide.policies.sequences import Observations

TWO_LAYERS = {"pi": [64], "vf": [64]}  # one hidden layer and SB3's linear head: the paper's two-layered policy module
MAX_UNITS, MAX_LAYERS = 2048, 8
EXTRACTOR = {"features_extractor_class", "features_extractor_kwargs", "share_features_extractor"}


class Heads(MlpExtractor):
    """
    SB3's ``mlp_extractor`` on a :class:`Latent`, where actor and critic may read different things.

    :param network: whose latent is read
    :param net_arch: as in SB3
    :param activation_fn: as in SB3
    :param device: as in SB3
    :raises ValueError: if a layer has too many units, or there are too many layers
    """

    def __init__(
        self,
        network: AgentNetwork,
        net_arch: list[int] | dict[str, list[int]],
        activation_fn: type[nn.Module],
        device: th.device | str = "auto",
    ) -> None:
        for layers in net_arch.values() if isinstance(net_arch, dict) else [net_arch]:
            if len(layers) > MAX_LAYERS or not all(isinstance(units, int) and 1 <= units <= MAX_UNITS for units in layers):
                raise ValueError(
                    f"net_arch={reprlib.repr(net_arch)}: expected ints, at most {MAX_LAYERS} layers of 1 to {MAX_UNITS} units"
                )
        super().__init__(network.features_dim, net_arch, activation_fn, device)
        critic = MlpExtractor(network.critic_dim, net_arch, activation_fn, device)
        self.value_net, self.latent_dim_vf = critic.value_net, critic.latent_dim_vf

    def forward(self, latent: Latent) -> tuple[th.Tensor, th.Tensor]:  # type: ignore[override]
        return self.forward_actor(latent), self.forward_critic(latent)

    def forward_actor(self, latent: Latent) -> th.Tensor:  # type: ignore[override]
        return self.policy_net(latent.pi)

    def forward_critic(self, latent: Latent) -> th.Tensor:  # type: ignore[override]
        return self.value_net(latent.vf)


class AgentPolicy(ActorCriticPolicy):
    """
    Actor-critic policy on one of the three networks, which SB3 calls as its features extractor.

    :param observation_space: "image" of cells or pixels and, where they exist, "mission" (tokens) and "history"
    :param action_space: Discrete
    :param lr_schedule: as in SB3
    :param net_arch: layers between latent and heads, as in SB3; one layer of 64 for each by default
    :param optimizer_kwargs: as in SB3; None takes SB3's Adam with fused updates, which are several times as fast
    :param network_kwargs: sizes and message shape, as the network's constructor names them
    :param agent_kwargs: what a constructor of a subclass was called with beyond SB3's own arguments
    :param kwargs: as in SB3's ``ActorCriticPolicy``
    :raises ValueError: if an agent can't see or act there, or for a features extractor of one's own
    """

    network_class: ClassVar[type[AgentNetwork]]
    carries_memory: ClassVar[bool]  # through the episode; a window is remembered anew at every step otherwise

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.Discrete,
        lr_schedule: Schedule,
        *,
        net_arch: list[int] | dict[str, list[int]] | None = None,
        optimizer_kwargs: dict[str, Any] | None = None,
        network_kwargs: dict[str, Any],
        agent_kwargs: dict[str, Any],
        **kwargs: Any,
    ) -> None:
        check_spaces(observation_space, action_space)
        check_left_out(kwargs, EXTRACTOR)
        self.agent_kwargs = agent_kwargs
        if optimizer_kwargs is None and kwargs.get("optimizer_class", th.optim.Adam) is th.optim.Adam:
            optimizer_kwargs = {"eps": 1e-5, "fused": True}
        kwargs = {**kwargs, "normalize_images": False}  # networks do it themselves, for they see images on other ways too
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            net_arch=TWO_LAYERS if net_arch is None else net_arch,
            optimizer_kwargs=optimizer_kwargs,
            features_extractor_class=self.network_class,  # type: ignore[arg-type]  # SB3 asks no more than features_dim of it
            features_extractor_kwargs=network_kwargs,
            **kwargs,
        )

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = Heads(self.network, self.net_arch, self.activation_fn, self.device)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        data = super()._get_constructor_parameters()
        for name in ("features_extractor_class", "features_extractor_kwargs"):
            del data[name]
        return {**data, **self.agent_kwargs}

    def set_training_mode(self, mode: bool) -> None:
        if self.training != mode:  # SB3 asks at every prediction, and telling forty modules takes as long as a prediction
            super().set_training_mode(mode)

    @property
    def network(self) -> AgentNetwork:
        """The agent's network, from observation to latent."""
        assert isinstance(self.features_extractor, AgentNetwork)
        return self.features_extractor

    def action_distribution(self, latent: Latent) -> Distribution:
        """
        :param latent: of K frames
        :return: distribution of K actions
        """
        return self._get_action_dist_from_latent(self.mlp_extractor.forward_actor(latent))  # type: ignore[arg-type]

    def exploring_distribution(self, latent: Latent) -> Distribution:
        """
        What reinforcement learning draws actions from while it trains.

        :param latent: of K frames
        :return: distribution of K actions
        """
        return self.action_distribution(latent)

    def memory(self, obs: Observations, state: State | None = None) -> th.Tensor:
        """
        :param obs: of B worlds
        :param state: what a policy with carried memory remembers of the time before; None for one with window memory
        :return: (B, state_size) what the agent remembers, the present observation included
        """
        raise NotImplementedError

    @property
    def channel(self) -> GuideNetwork:
        """
        The network of an agent with a channel.

        :raises ValueError: if the agent has none
        """
        if not isinstance(self.network, GuideNetwork):
            raise ValueError(f"{type(self).__name__} sends no messages: expected a GuidePolicy or a GuidedLearnerPolicy")
        return self.network

    @property
    def has_symbols(self) -> bool:
        """Whether the agent has a channel, and its messages are made of symbols."""
        return isinstance(self.network, GuideNetwork) and not self.network.encoder.shape.continuous

    @contextmanager
    def hearing(self, intervention: Intervention, seed: int = 0) -> Iterator[None]:
        """
        Let the agent hear its Guide's messages through another intervention for a while.

        :param intervention: what happens to each message
        :param seed: of what it draws while messages are greedy
        :raises ValueError: if the agent has no channel, or a continuous one where the intervention needs symbols
        """
        channel, usual, chance = self.channel, self.channel.intervention, self.channel.chance
        channel.intervention, channel.chance = intervention, th.Generator().manual_seed(seed)
        try:
            yield
        finally:
            channel.intervention, channel.chance = usual, chance

    def message_log_probs(self, obs: Observations, state: State | None = None) -> th.Tensor:
        """
        :param obs: of B worlds
        :param state: see :meth:`memory`
        :return: (B, M) log-probability that the Guide sends each message
        :raises ValueError: if the agent has no channel
        """
        return self.channel.message_log_probs(self.memory(obs, state))

    def action_log_probs_given_messages(self, obs: Observations, state: State | None = None) -> th.Tensor:
        """
        :param obs: of B worlds
        :param state: see :meth:`memory`
        :return: (B, M, A) log-probability of each action, were each message sent and the memory as it is
        :raises ValueError: if the agent has no channel
        """
        return self.listen(self.memory(obs, state))

    def listen(self, memory: th.Tensor) -> th.Tensor:
        """
        :param memory: (K, state_size)
        :return: (K, M, A) log-probability of each action given each message
        """
        latent = self.channel.latent_of_each_message(memory)
        return self.action_net(self.mlp_extractor.policy_net(latent)).log_softmax(dim=-1)


def check_left_out(policy_kwargs: dict[str, Any], names: set[str]) -> None:
    """
    :param policy_kwargs: that a user gave
    :param names: of settings that SB3 or sb3-contrib knows, and that an agent's network leaves no choice of
    :raises ValueError: if any of them is given
    """
    if given := sorted(policy_kwargs.keys() & names):
        raise ValueError(
            f"policy_kwargs have {', '.join(given)}, which the agent's own network decides: leave that out; "
            "size='compact', 'medium' or 'paper' chooses how wide the network is"
        )
