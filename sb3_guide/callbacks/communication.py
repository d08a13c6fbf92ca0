"""Causal Influence of Communication while an agent with a channel is trained."""

import numpy as np
import torch as th
from stable_baselines3.common.buffers import DictRolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from sb3_guide.callbacks.rollouts import is_due
from sb3_guide.cloning.validation import measure_communication
from sb3_guide.policies import AgentPolicy
from sb3_guide.policies.memory import State


class CICCallback(BaseCallback):
    """
    Log ``guide/cic``, ``guide/uniform_cic``, ``guide/message_entropy`` and ``guide/tempered_cic`` over frames of the latest
    rollout. Works with PPO, A2C and RecurrentPPO and our policies with a channel, and changes nothing in their training.

    :param n_frames: frames that are drawn of each rollout
    :param every_n_rollouts: measure one rollout in so many
    :param seed: of the draw
    :param verbose: as in SB3
    :raises ValueError: if a number is not positive
    """

    def __init__(self, n_frames: int = 2048, every_n_rollouts: int = 1, seed: int = 0, verbose: int = 0) -> None:
        super().__init__(verbose)
        if n_frames < 1 or every_n_rollouts < 1:
            raise ValueError(f"n_frames={n_frames} and every_n_rollouts={every_n_rollouts}: expected at least 1 of each")
        self.n_frames = n_frames
        self.every_n_rollouts = every_n_rollouts
        self.seed = seed

    def _init_callback(self) -> None:
        policy = self.model.policy
        if not (isinstance(self.model, OnPolicyAlgorithm) and isinstance(policy, AgentPolicy)):
            raise ValueError(
                f"CICCallback can't measure {type(policy).__name__} in {type(self.model).__name__}: expected an on-policy "
                "algorithm with GuidePolicy or GuidedLearnerPolicy"
            )
        policy.channel.encoder.shape.check_enumerable()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        if is_due(self, self.every_n_rollouts):
            for name, value in measure_communication(self.model.policy, self._memory()).items():  # type: ignore[arg-type]
                self.logger.record(f"guide/{name}", value)

    def _memory(self) -> th.Tensor:
        """:return: (n_frames, state_size) what the agent remembered at frames of the rollout"""
        policy, buffer = self.model.policy, self.model.rollout_buffer  # type: ignore[attr-defined]
        assert isinstance(policy, AgentPolicy)
        assert isinstance(buffer, DictRolloutBuffer)
        size = buffer.buffer_size * buffer.n_envs
        rng = np.random.default_rng([self.seed, self.num_timesteps])  # the same in a run that was resumed
        chosen = rng.choice(size, min(size, self.n_frames), replace=False)
        step, world = np.unravel_index(chosen, (buffer.buffer_size, buffer.n_envs))
        obs = {name: th.as_tensor(part[step, world], device=policy.device) for name, part in buffer.observations.items()}
        with th.no_grad():
            return policy.memory(obs, carried_state(policy, buffer, step, world))


def carried_state(policy: AgentPolicy, buffer: DictRolloutBuffer, step: np.ndarray, world: np.ndarray) -> State | None:
    """
    :param policy: that filled the buffer
    :param buffer: not yet flattened
    :param step: (K,)
    :param world: (K,)
    :return: (h, c) before each frame, (1, K, state_size) each; None if the policy remembers windows
    """
    if not policy.carries_memory:
        return None
    goes_on = 1.0 - buffer.episode_starts[step, world]
    h, c = (
        th.as_tensor(part[step, 0, world] * goes_on[:, None], dtype=th.float32, device=policy.device).unsqueeze(0)
        for part in (buffer.hidden_states_pi, buffer.cell_states_pi)  # type: ignore[attr-defined]
    )
    return h, c
