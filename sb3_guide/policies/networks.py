"""The three agents' networks, from observation to the latent that the policy's heads read."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch as th
from gymnasium import spaces
from torch import nn

from sb3_guide.policies.channel import MessageDecoder, MessageEncoder, MessageShape
from sb3_guide.policies.compiled import Views, Weights, remember_few
from sb3_guide.policies.film import FiLMExtractor
from sb3_guide.policies.interventions import Intervention, Scene
from sb3_guide.policies.memory import FEW_FRAMES, SHORT, Memory, State
from sb3_guide.policies.sequences import Observations, Sequences, Windows, windows
from sb3_guide.policies.sizes import size_of


@dataclass
class Latent:
    """
    What the heads read.

    :param memory: (K, state_size) that it comes from
    :param vf: (K, critic_dim) input of the critic
    :param listen: what ``pi`` comes from, where anyone asks for it; a Guide that explores sends no single message
    """

    memory: th.Tensor
    vf: th.Tensor
    listen: Callable[[], th.Tensor]

    @cached_property
    def pi(self) -> th.Tensor:
        """(K, features_dim) input of the action head."""
        return self.listen()


class AgentNetwork(nn.Module):
    """
    What all three networks share: ``remember``, ``step`` and ``recall`` turn frames into memory, ``latent`` turns memory into
    the heads' input. SB3 calls a network as the policy's features extractor.
    """

    state_size: int  # width of h, of c and of the memory
    features_dim: int  # width of Latent.pi
    critic_dim: int  # width of Latent.vf

    def remember(self, sequences: Sequences, state: State | None = None) -> th.Tensor:
        """
        :param sequences: B sequences of K frames in all
        :param state: (h, c), each (1, B, state_size), before the first frames; None where episodes begin
        :return: memory at each frame (K, state_size)
        """
        raise NotImplementedError

    def step(self, frames: Sequences, state: State) -> tuple[th.Tensor, State]:
        """
        :param frames: B sequences of one frame
        :param state: (h, c), each (1, B, state_size), before it; zeros where episodes begin
        :return: memory at that frame (B, state_size), and (h, c) after it
        """
        raise NotImplementedError

    def recall(self, windows: Sequences) -> th.Tensor:
        """
        :param windows: B short sequences, each seen from nothing
        :return: memory at the last frame of each (B, state_size)
        """
        raise NotImplementedError

    def look_back(self, windows: Windows) -> th.Tensor:
        """
        :param windows: of B worlds, with what was before their episodes
        :return: as :meth:`recall`
        """
        raise NotImplementedError

    def latent(self, memory: th.Tensor, scene: Scene, generator: th.Generator | None = None) -> Latent:
        """
        :param memory: (K, state_size)
        :param scene: where the K frames stand in their episodes
        :param generator: source of the noise with which messages are sampled; None means greedy messages
        """
        raise NotImplementedError

    def forward(self, observations: Observations) -> Latent:
        """
        Window memory.

        :param observations: of B worlds, see :func:`~sb3_guide.policies.sequences.windows`
        """
        seen = windows(observations)
        return self.latent(
            self.look_back(seen),
            Scene(th.arange(len(seen.images), device=seen.images.device), lambda: self._recall_before(seen.sequences())),
        )

    def _recall_before(self, seen: Sequences) -> th.Tensor:
        """
        :param seen: B windows
        :return: (B, state_size) memory at the last but one frame of each; zeros where there is none
        """
        memory = self.remember(seen)
        last = seen.lengths.cumsum(0) - 1
        return th.where((seen.lengths > 1).unsqueeze(1), memory[last - 1], 0.0)


class Learner(AgentNetwork):
    """
    Instruction GRU, convolution, FiLM and memory LSTM (paper section 3.2).

    :param observation_space: of the level
    :param size: "compact", "medium" or "paper"
    """

    def __init__(self, observation_space: spaces.Dict, size: str = "compact") -> None:
        super().__init__()
        self.film = FiLMExtractor(observation_space, size)
        self.memory = Memory(self.film.features_dim, size_of(size).memory)
        self.views: Views[Weights] = Views()
        self.state_size = self.features_dim = self.critic_dim = self.memory.hidden

    def remember(self, sequences: Sequences, state: State | None = None) -> th.Tensor:
        return self.memory(*self.film.encode(sequences), sequences.lengths, state)

    def step(self, frames: Sequences, state: State) -> tuple[th.Tensor, State]:
        images = frames.images.unsqueeze(1)
        if (after := remember_few(self.views, self.film, self.memory.lstm, images, frames.missions, state)) is not None:
            return after[0], (after[0].unsqueeze(0), after[1].unsqueeze(0))
        return self.memory.step(self.film.encode_worlds(images, frames.missions).squeeze(1), state)

    def recall(self, windows: Sequences) -> th.Tensor:
        return self.memory.last(*self.film.encode(windows), windows.lengths)

    def look_back(self, windows: Windows) -> th.Tensor:
        images, missions = windows.images, windows.missions
        if (after := remember_few(self.views, self.film, self.memory.lstm, images, missions)) is not None:
            return after[0]
        if images.shape[0] * images.shape[1] > FEW_FRAMES or images.shape[1] > SHORT:
            return self.recall(windows.sequences())
        return self.memory.last_of_windows(self.film.encode_worlds(images, missions), windows.began)

    def latent(self, memory: th.Tensor, scene: Scene, generator: th.Generator | None = None) -> Latent:
        return Latent(memory, memory, lambda: memory)


class Speaker(Learner):
    """
    The part of a Guide that a new Learner is paired with in stage 3: a Learner's trunk and the message decoder.

    :param observation_space: of the level
    :param size: "compact", "medium" or "paper"
    :param shape: form of the messages
    """

    def __init__(self, observation_space: spaces.Dict, size: str, shape: MessageShape) -> None:
        super().__init__(observation_space, size)
        self.decoder = MessageDecoder(self.state_size, size_of(size).symbol, shape)


class GuideNetwork(AgentNetwork):
    """
    What the two networks with a channel share.

    :param size: of the message encoder
    :param speaker: who speaks
    """

    def __init__(self, size: str, speaker: Speaker) -> None:
        super().__init__()
        self.speaker = speaker
        self._intervention = Intervention()
        self.chance = th.Generator().manual_seed(0)  # of interventions where messages are greedy
        self.encoder = MessageEncoder(size_of(size).symbol, size_of(size).message, speaker.decoder.shape)

    @property
    def intervention(self) -> Intervention:
        """
        What happens to messages before they are heard.

        :raises ValueError: if one is set that needs symbols, and the channel is continuous
        """
        return self._intervention

    @intervention.setter
    def intervention(self, intervention: Intervention) -> None:
        if self.encoder.shape.continuous and intervention.needs_symbols:
            raise ValueError(
                f"{type(intervention).__name__} needs symbols, of which a continuous channel has none: expected an agent with "
                'channel="discrete", or one of spoken, silent, delayed'
            )
        self._intervention = intervention

    def speaker_memory(self, memory: th.Tensor) -> th.Tensor:
        """
        :param memory: (K, state_size)
        :return: the speaker's part of it
        """
        raise NotImplementedError

    def read(self, memory: th.Tensor, encoding: th.Tensor) -> th.Tensor:
        """
        :param memory: (K, state_size)
        :param encoding: (K, message) what the message encoder made of the message
        :return: (K, features_dim) input of the action head
        """
        raise NotImplementedError

    def speak(self, memory: th.Tensor, generator: th.Generator | None = None) -> th.Tensor:
        """:return: (K, length, vocabulary_size) message at each frame"""
        return self.speaker.decoder(self.speaker_memory(memory), generator)

    def hear(self, memory: th.Tensor, scene: Scene, generator: th.Generator | None = None) -> th.Tensor:
        """:return: (K, message) encoding of what is left of the message after the intervention"""
        spoken = self.speak(scene.before() if self.intervention.speaks_from_before else memory, generator)
        return self.encoder(self.intervention(spoken, scene, generator or self.chance))

    def message_log_probs(self, memory: th.Tensor) -> th.Tensor:
        """:return: (K, M) log-probability of each message at each frame"""
        return self.speaker.decoder.log_probs(self.speaker_memory(memory))

    def latent_of_each_message(self, memory: th.Tensor) -> th.Tensor:
        """:return: (K, M, features_dim) input of the action head, were each message sent at each frame"""
        encodings = self.encoder.all()  # (M, message)
        frames, count = len(memory), len(encodings)
        latent = self.read(memory.repeat_interleave(count, dim=0), encodings.repeat(frames, 1))
        return latent.view(frames, count, -1)


class Guide(GuideNetwork):
    """
    A Learner with a bottleneck between memory and heads: the action head reads the message and nothing else
    (paper section 3.2). The critic, which reinforcement learning needs and cloning does not, reads the memory.

    :param observation_space: of the level
    :param size: "compact", "medium" or "paper"
    :param message_length: symbols in a message
    :param vocabulary_size: different symbols
    :param channel: "discrete" or "continuous"
    """

    def __init__(
        self,
        observation_space: spaces.Dict,
        size: str = "compact",
        message_length: int = 2,
        vocabulary_size: int = 3,
        channel: str = "discrete",
    ) -> None:
        super().__init__(size, Speaker(observation_space, size, MessageShape(message_length, vocabulary_size, channel)))
        self.state_size = self.critic_dim = self.speaker.state_size
        self.features_dim = size_of(size).message

    def remember(self, sequences: Sequences, state: State | None = None) -> th.Tensor:
        return self.speaker.remember(sequences, state)

    def step(self, frames: Sequences, state: State) -> tuple[th.Tensor, State]:
        return self.speaker.step(frames, state)

    def recall(self, windows: Sequences) -> th.Tensor:
        return self.speaker.recall(windows)

    def look_back(self, windows: Windows) -> th.Tensor:
        return self.speaker.look_back(windows)

    def speaker_memory(self, memory: th.Tensor) -> th.Tensor:
        return memory

    def read(self, memory: th.Tensor, encoding: th.Tensor) -> th.Tensor:
        return encoding

    def latent(self, memory: th.Tensor, scene: Scene, generator: th.Generator | None = None) -> Latent:
        return Latent(memory, memory, lambda: self.hear(memory, scene, generator))


class GuidedLearner(GuideNetwork):
    """
    A new Learner and a Guide, a memory each; the heads read the Learner's memory and the message (paper figure 2).
    The states of both travel as one, the Learner's first.

    :param observation_space: of the level
    :param size: size of the Learner
    :param guide_size: size of the Guide
    :param message_length: symbols in the Guide's messages
    :param vocabulary_size: different symbols
    :param channel: "discrete" or "continuous"
    """

    def __init__(
        self,
        observation_space: spaces.Dict,
        size: str = "compact",
        guide_size: str = "compact",
        message_length: int = 2,
        vocabulary_size: int = 3,
        channel: str = "discrete",
    ) -> None:
        super().__init__(size, Speaker(observation_space, guide_size, MessageShape(message_length, vocabulary_size, channel)))
        self.learner = Learner(observation_space, size)
        self.parts = [self.learner.state_size, self.speaker.state_size]
        self.state_size = sum(self.parts)
        self.features_dim = self.critic_dim = self.learner.state_size + size_of(size).message

    def remember(self, sequences: Sequences, state: State | None = None) -> th.Tensor:
        of_learner, of_speaker = (None, None) if state is None else self._split(state)
        learner, speaker = self.learner.remember(sequences, of_learner), self.speaker.remember(sequences, of_speaker)
        return th.cat([learner, speaker], dim=-1)

    def step(self, frames: Sequences, state: State) -> tuple[th.Tensor, State]:
        of_learner, of_speaker = self._split(state)
        learner, (learner_h, learner_c) = self.learner.step(frames, of_learner)
        speaker, (speaker_h, speaker_c) = self.speaker.step(frames, of_speaker)
        state = th.cat([learner_h, speaker_h], dim=-1), th.cat([learner_c, speaker_c], dim=-1)
        return th.cat([learner, speaker], dim=-1), state

    def recall(self, windows: Sequences) -> th.Tensor:
        return th.cat([self.learner.recall(windows), self.speaker.recall(windows)], dim=-1)

    def look_back(self, windows: Windows) -> th.Tensor:
        return th.cat([self.learner.look_back(windows), self.speaker.look_back(windows)], dim=-1)

    def _split(self, state: State) -> tuple[State, State]:
        """:return: the Learner's and the speaker's state"""
        (learner_h, speaker_h), (learner_c, speaker_c) = (both.split(self.parts, dim=-1) for both in state)
        return (learner_h.contiguous(), learner_c.contiguous()), (speaker_h.contiguous(), speaker_c.contiguous())

    def speaker_memory(self, memory: th.Tensor) -> th.Tensor:
        return memory[:, self.parts[0] :].contiguous()

    def read(self, memory: th.Tensor, encoding: th.Tensor) -> th.Tensor:
        return th.cat([memory[:, : self.parts[0]], encoding], dim=-1)

    def latent(self, memory: th.Tensor, scene: Scene, generator: th.Generator | None = None) -> Latent:
        latent = self.read(memory, self.hear(memory, scene, generator))
        return Latent(memory, latent, lambda: latent)
