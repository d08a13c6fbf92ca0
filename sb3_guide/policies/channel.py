"""The channel: a decoder speaks a message, an encoder reads it."""

from dataclasses import dataclass
from functools import cache
from itertools import product

import torch as th
import torch.nn.functional as F
from torch import nn

from sb3_guide.policies import compiled
from sb3_guide.policies.compiled import FEW_MESSAGES, Linear, Symbols, Views, is_few, linear, symbol_weights
from sb3_guide.policies.gru import input_gates, next_hidden

MAX_LENGTH, MAX_VOCABULARY = 100, 10_000
MAX_MESSAGES = 1024  # enumerating more than these for the metrics would need too much memory
ENUMERATED_AT_ONCE = 36_864  # frames times messages: bounds the memory that enumerating takes
CHANNELS = ("discrete", "continuous")


@dataclass(frozen=True)
class MessageShape:
    """
    Form of all messages of a Guide.

    :param length: symbols in a message
    :param vocabulary_size: different symbols
    :param channel: "discrete", where a message is made of symbols; or "continuous", where it is as wide and made of numbers:
        ``vocabulary_size`` of them stand in the place of each symbol
    :raises ValueError: if there are no such messages
    """

    length: int = 2
    vocabulary_size: int = 3
    channel: str = "discrete"

    def __post_init__(self) -> None:
        if self.channel not in CHANNELS:
            raise ValueError(f"channel={self.channel!r} is unknown: expected one of {', '.join(CHANNELS)}")
        whole = isinstance(self.length, int) and isinstance(self.vocabulary_size, int)
        if not whole or not 1 <= self.length <= MAX_LENGTH or not 2 <= self.vocabulary_size <= MAX_VOCABULARY:
            raise ValueError(
                f"message_length={self.length} and vocabulary_size={self.vocabulary_size} make no channel: "
                f"expected a length of 1 to {MAX_LENGTH} and 2 to {MAX_VOCABULARY} symbols"
            )

    @property
    def continuous(self) -> bool:
        """Whether messages are numbers, not symbols."""
        return self.channel == "continuous"

    @property
    def count(self) -> int:
        """
        Number of different messages.

        :raises ValueError: if the channel is continuous
        """
        if self.continuous:
            raise ValueError(
                "the messages of a continuous channel are not made of symbols, so they can't be enumerated, read or chosen: "
                'expected an agent with channel="discrete"'
            )
        return self.vocabulary_size**self.length

    def check_enumerable(self) -> None:
        """
        :raises ValueError: if there are more than 1024 messages, or the channel is continuous
        """
        if self.count > MAX_MESSAGES:
            raise ValueError(
                f"{self.vocabulary_size}^{self.length} = {self.count} messages are too many to enumerate: "
                f"expected at most {MAX_MESSAGES}; use shorter messages or fewer symbols to measure communication"
            )

    @property
    def frames_at_once(self) -> int:
        """At how many frames all messages may be enumerated together."""
        return max(1, ENUMERATED_AT_ONCE // self.count)

    def all(self) -> th.Tensor:
        """
        :return: (M, length) int64, every message, in the order of its index (w0 w0, w0 w1, ...)
        :raises ValueError: if there are more than 1024, or the channel is continuous
        """
        self.check_enumerable()
        return th.tensor(list(product(range(self.vocabulary_size), repeat=self.length)))

    def index(self, messages: th.Tensor) -> th.Tensor:
        """
        :param messages: (..., length) symbols
        :return: (...) index of each message
        """
        weights = self.vocabulary_size ** th.arange(self.length - 1, -1, -1, device=messages.device)
        return (messages * weights).sum(dim=-1)

    def names(self) -> list[str]:
        """:return: every message as the paper writes it, such as "w0 w2" """
        return [" ".join(f"w{symbol}" for symbol in message) for message in self.all().tolist()]


class MessageDecoder(nn.Module):
    """
    GRU that speaks a message of fixed length, starting from the Guide's memory. Symbols are chosen by the straight-through
    Gumbel-softmax (Jang et al. 2017) with a temperature that is learned and depends on the state, as in the authors' code.
    A continuous channel sends the logits themselves, without noise (as Foerster et al. 2016, who add some, do in training).

    :param memory: width of the Guide's memory
    :param symbol: width of a symbol's embedding
    :param shape: form of the messages
    """

    def __init__(self, memory: int, symbol: int, shape: MessageShape) -> None:
        super().__init__()
        self.shape = shape
        self.embedding = nn.Linear(shape.vocabulary_size, symbol, bias=False)  # takes one-hot symbols, to be differentiable
        self.cell = nn.GRUCell(symbol, memory)
        self.logits = nn.Linear(memory, shape.vocabulary_size)
        self.symbols: Views[Symbols] = Views()
        self.to_logits: Views[Linear] = Views()
        if not shape.continuous:
            self.inverse_temperature = nn.Linear(memory, 1)
            self._begin_undecided()

    def _begin_undecided(self) -> None:
        """
        All messages are equally probable at first, and the temperature is high (4.0, of at most 5), so that gradients reach
        every symbol. Else all frames tend to agree on one message before it can mean anything, and stay there.
        """
        for weights in (self.logits.weight, self.logits.bias, self.inverse_temperature.weight):
            nn.init.zeros_(weights)
        nn.init.constant_(self.inverse_temperature.bias, -3.0)

    def forward(self, memory: th.Tensor, generator: th.Generator | None = None) -> th.Tensor:
        """
        Speak. Symbols are one-hot going forward and relaxed going backward.

        :param memory: (K, memory)
        :param generator: source of the Gumbel noise; None means the most probable symbols, without noise
        :return: (K, length, vocabulary_size), one-hot or, in a continuous channel, any numbers
        """
        if generator is None and (weights := self._views(memory)) is not None:
            said = compiled.say(*weights, memory.numpy(), self.shape.length, self.shape.continuous)
            return th.from_numpy(said)
        gates, hidden = input_gates(self.embedding.weight.t(), self.cell), memory
        symbols: list[th.Tensor] = []
        for _ in range(self.shape.length):
            before = symbols[-1] @ gates if symbols else gates[:1]  # w0 stands before the first
            hidden = next_hidden(before, hidden, self.cell)
            symbols.append(self.logits(hidden) if self.shape.continuous else self.choose(hidden, generator))
        return th.stack(symbols, dim=1)

    def _views(self, memory: th.Tensor) -> tuple[Symbols, Linear] | None:
        """:return: views of the weights that messages depend on; None where torch has to compute them"""
        if not is_few(memory, th.float32) or memory.shape[1] != self.cell.hidden_size:
            return None
        symbols, logits = self.symbols.get(symbol_weights, self.embedding, self.cell), self.to_logits.get(linear, self.logits)
        return None if symbols is None or logits is None else (symbols, logits)

    def choose(self, hidden: th.Tensor, generator: th.Generator | None) -> th.Tensor:
        """
        :param hidden: (K, memory) of the GRU
        :param generator: see :meth:`forward`
        :return: (K, vocabulary_size) one-hot symbol
        """
        logits = self.logits(hidden).log_softmax(dim=-1)
        if generator is not None:
            uniform = th.rand(logits.shape, generator=generator).clamp(min=th.finfo(th.float32).tiny)
            logits = logits - (-uniform.log()).log().to(logits.device)
        relaxed = (logits * (F.softplus(self.inverse_temperature(hidden)) + 0.2)).softmax(dim=-1)
        hard = F.one_hot(relaxed.argmax(dim=-1), self.shape.vocabulary_size).float()
        return hard + relaxed - relaxed.detach()

    def log_probs(self, memory: th.Tensor) -> th.Tensor:
        """
        Log-probability of every message, at temperature 1 and without noise. Messages that begin alike share what was computed
        of their beginning.

        :param memory: (K, memory)
        :return: (K, M)
        :raises ValueError: as :meth:`MessageShape.all`
        """
        self.shape.check_enumerable()
        if (weights := self._views(memory)) is not None:
            return th.from_numpy(compiled.log_probs(*weights, memory.numpy(), self.shape.length))
        gates, hidden = input_gates(self.embedding.weight.t(), self.cell), memory
        before, total = gates[:1], memory.new_zeros(len(memory))  # of every beginning: (K * beginnings,)
        for position in range(self.shape.length):
            if position:
                before, hidden = gates.repeat(len(hidden), 1), hidden.repeat_interleave(self.shape.vocabulary_size, dim=0)
            hidden = next_hidden(before, hidden, self.cell)
            total = (total.unsqueeze(1) + self.logits(hidden).log_softmax(dim=-1)).flatten()
        return total.view(len(memory), -1)


class MessageEncoder(nn.Module):
    """
    GRU that reads a message.

    :param symbol: width of a symbol's embedding
    :param message: width of the encoding
    :param shape: form of the messages
    """

    def __init__(self, symbol: int, message: int, shape: MessageShape) -> None:
        super().__init__()
        self.shape = shape
        self.embedding = nn.Linear(shape.vocabulary_size, symbol, bias=False)
        self.gru = nn.GRU(symbol, message, batch_first=True)
        self.views: Views[Symbols] = Views()

    def forward(self, symbols: th.Tensor) -> th.Tensor:
        """
        :param symbols: (K, length, vocabulary_size), as :class:`MessageDecoder` speaks them
        :return: (K, message)
        """
        if (
            is_few(symbols, th.float32, FEW_MESSAGES)
            and symbols.shape[2] == self.shape.vocabulary_size
            and (weights := self.views.get(symbol_weights, self.embedding, self.gru)) is not None
        ):
            return th.from_numpy(compiled.hear(weights, symbols.numpy()))
        gates, hidden = input_gates(self.embedding.weight.t(), self.gru), symbols.new_zeros(1, self.gru.hidden_size)
        for symbol in symbols.unbind(dim=1):
            hidden = next_hidden(symbol @ gates, hidden, self.gru)
        return hidden

    def all(self) -> th.Tensor:
        """:return: (M, message) the encoding of every message, in the order of its index"""
        return self(every_message(self.shape).to(self.embedding.weight.device))


@cache
def every_message(shape: MessageShape) -> th.Tensor:
    """:return: (M, length, vocabulary_size) one-hot symbols of every message, in the order of its index; not to be changed"""
    with th.inference_mode(False):  # else it could not take part in training later
        return F.one_hot(shape.all(), shape.vocabulary_size).float()
