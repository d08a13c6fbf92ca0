"""
What happens to a Guide's message before it is heard. Training controls, ablations and speaking are all interventions: nothing
else overwrites a message.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import torch as th
import torch.nn.functional as F


class Scene(NamedTuple):
    """
    Where K frames stand in their episodes; the frames of an episode follow one another.

    :param episode: (K,) int64, equal for frames of the same episode
    :param before: returns (K, state_size), the memory one frame earlier; zeros where an episode begins
    """

    episode: th.Tensor
    before: Callable[[], th.Tensor]


@dataclass(frozen=True)
class Intervention:
    """The message is heard as it was spoken. Others override :meth:`__call__`."""

    speaks_from_before: ClassVar[bool] = False  # the Guide speaks from its memory of the frame before
    needs_symbols: ClassVar[bool] = False  # it draws or replaces them, so it has no meaning in a continuous channel

    def __call__(self, spoken: th.Tensor, scene: Scene, generator: th.Generator) -> th.Tensor:
        """
        :param spoken: (K, length, vocabulary_size) one-hot, or numbers in a continuous channel
        :param scene: of the K frames
        :param generator: of whatever is drawn
        :return: the same for what is heard
        """
        return spoken


class Silent(Intervention):
    """The same message at every frame, w0 w0, whatever was spoken."""

    def __call__(self, spoken: th.Tensor, scene: Scene, generator: th.Generator) -> th.Tensor:
        return one_hot(spoken.new_zeros(spoken.shape[:2], dtype=th.long), spoken)


class Uniform(Intervention):
    """Any message, all of them equally probable, whatever was spoken."""

    needs_symbols = True

    def __call__(self, spoken: th.Tensor, scene: Scene, generator: th.Generator) -> th.Tensor:
        return one_hot(th.randint(spoken.shape[2], spoken.shape[:2], generator=generator), spoken)


@dataclass(frozen=True)
class Marginal(Intervention):
    """
    A message as often as the Guide uses it, whatever was spoken.

    :param probabilities: (M,) of each message, in the order of its index
    """

    needs_symbols: ClassVar[bool] = True

    probabilities: tuple[float, ...]

    def __call__(self, spoken: th.Tensor, scene: Scene, generator: th.Generator) -> th.Tensor:
        frames, length, vocabulary_size = spoken.shape
        if len(self.probabilities) != vocabulary_size**length:
            raise ValueError(
                f"{len(self.probabilities)} probabilities: expected one for each of {vocabulary_size**length} messages"
            )
        drawn = th.multinomial(th.tensor(self.probabilities), frames, replacement=True, generator=generator)
        place_value = vocabulary_size ** th.arange(length).flip(0)
        return one_hot(drawn.unsqueeze(1) // place_value % vocabulary_size, spoken)


class Shuffled(Intervention):
    """
    What was spoken at some frame of another episode of the batch, or any message where there is no other. No gradient goes
    back to the Guide, whose words reached somebody else.
    """

    needs_symbols = True  # where there is no other

    def __call__(self, spoken: th.Tensor, scene: Scene, generator: th.Generator) -> th.Tensor:
        _, own, lengths = scene.episode.unique_consecutive(return_inverse=True, return_counts=True)
        if len(lengths) == 1:
            return Uniform()(spoken, scene, generator)
        first, length = (lengths.cumsum(0) - lengths)[own], lengths[own]
        others = len(spoken) - length  # (K,) frames of other episodes
        drawn = (th.rand(len(spoken), generator=generator, dtype=th.float64).to(spoken.device) * others).long()
        return spoken.detach()[drawn + length * (drawn >= first)]


class Delayed(Intervention):
    """What the Guide would have said one frame earlier; at the first frame, what it says having seen nothing."""

    speaks_from_before = True


@dataclass(frozen=True)
class Swapped(Intervention):
    """
    One symbol is replaced by another one, all others being equally probable.

    :param position: of the symbol, from 0
    """

    needs_symbols: ClassVar[bool] = True

    position: int = 0

    def __call__(self, spoken: th.Tensor, scene: Scene, generator: th.Generator) -> th.Tensor:
        frames, length, vocabulary_size = spoken.shape
        if not 0 <= self.position < length:
            raise ValueError(f"position={self.position}: expected 0 to {length - 1}, as messages have {length} symbols")
        shift = 1 + th.randint(vocabulary_size - 1, (frames,), generator=generator).to(spoken.device)
        symbols = spoken.detach().argmax(dim=-1)[:, self.position]
        heard = spoken.clone()
        heard[:, self.position] = F.one_hot((symbols + shift) % vocabulary_size, vocabulary_size).to(spoken)
        return heard


@dataclass(frozen=True)
class Chosen(Intervention):
    """
    A message that the caller has chosen, whatever was spoken.

    :param symbols: of the message, such as (0, 2), or (K, length) int64 with a message for each frame
    """

    needs_symbols: ClassVar[bool] = True

    symbols: Sequence[int] | np.ndarray

    def __call__(self, spoken: th.Tensor, scene: Scene, generator: th.Generator) -> th.Tensor:
        frames, length, vocabulary_size = spoken.shape
        symbols = np.asarray(self.symbols, dtype=np.int64)
        if symbols.shape not in ((length,), (frames, length)) or not ((symbols >= 0) & (symbols < vocabulary_size)).all():
            raise ValueError(f"message {self.symbols}: expected {length} symbols from 0 to {vocabulary_size - 1}")
        return one_hot(th.as_tensor(symbols).expand(frames, -1), spoken)


def one_hot(symbols: th.Tensor, like: th.Tensor) -> th.Tensor:
    """
    :param symbols: (K, length)
    :param like: (K, length, vocabulary_size)
    :return: the symbols in the form of ``like``, on its device
    """
    return F.one_hot(symbols, like.shape[2]).to(like)


INTERVENTIONS: dict[str, type[Intervention]] = {
    "spoken": Intervention,
    "silent": Silent,
    "uniform": Uniform,
    "shuffled": Shuffled,
    "delayed": Delayed,
    "swapped": Swapped,
}  # those that need no more than a name, in policy_kwargs and conditions


def intervention_of(name: str) -> Intervention:
    """
    :param name: such as "silent"
    :raises ValueError: if there is no such intervention
    """
    if name not in INTERVENTIONS:
        raise ValueError(f"intervention {name!r} is unknown: expected one of {', '.join(INTERVENTIONS)}")
    return INTERVENTIONS[name]()
