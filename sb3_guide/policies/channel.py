"""The discrete channel: a decoder speaks a message, an encoder reads it."""

from dataclasses import dataclass
from itertools import product

import torch as th
import torch.nn.functional as F
from torch import nn

from sb3_guide.policies.gru import input_gates, next_hidden

MAX_LENGTH, MAX_VOCABULARY = 100, 10_000
MAX_MESSAGES = 256  # enumerating more than these for the metrics would need too much memory


@dataclass(frozen=True)
class MessageShape:
    """
    Form of all messages of a Guide.

    :param length: symbols in a message
    :param vocabulary_size: different symbols
    :raises ValueError: if there are no such messages
    """

    length: int = 2
    vocabulary_size: int = 3

    def __post_init__(self) -> None:
        whole = isinstance(self.length, int) and isinstance(self.vocabulary_size, int)
        if not whole or not 1 <= self.length <= MAX_LENGTH or not 2 <= self.vocabulary_size <= MAX_VOCABULARY:
            raise ValueError(
                f"message_length={self.length} and vocabulary_size={self.vocabulary_size} make no channel: "
                f"expected a length of 1 to {MAX_LENGTH} and 2 to {MAX_VOCABULARY} symbols"
            )

    @property
    def count(self) -> int:
        """Number of different messages."""
        return self.vocabulary_size**self.length

    def all(self) -> th.Tensor:
        """
        :return: (M, length) int64, every message, in the order of its index (w0 w0, w0 w1, ...)
        :raises ValueError: if there are more than 256
        """
        if self.count > MAX_MESSAGES:
            raise ValueError(
                f"{self.vocabulary_size}^{self.length} = {self.count} messages are too many to enumerate: "
                f"expected at most {MAX_MESSAGES}; use shorter messages or fewer symbols to measure communication"
            )
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
        self.inverse_temperature = nn.Linear(memory, 1)
        # All messages are equally probable at first, and the temperature is high (4.0, of at most 5), so that gradients reach
        # every symbol. Else all frames tend to agree on one message before it can mean anything, and stay there.
        for weights in (self.logits.weight, self.logits.bias, self.inverse_temperature.weight):
            nn.init.zeros_(weights)
        nn.init.constant_(self.inverse_temperature.bias, -3.0)

    def forward(self, memory: th.Tensor, generator: th.Generator | None = None) -> th.Tensor:
        """
        Speak. The result is one-hot going forward and relaxed going backward.

        :param memory: (K, memory)
        :param generator: source of the Gumbel noise; None means the most probable symbols, without noise
        :return: (K, length, vocabulary_size)
        """
        gates, hidden = input_gates(self.embedding.weight.t(), self.cell), memory
        symbols: list[th.Tensor] = []
        for _ in range(self.shape.length):
            before = symbols[-1] @ gates if symbols else gates[:1]  # w0 stands before the first
            hidden = next_hidden(before, hidden, self.cell)
            logits = self.logits(hidden).log_softmax(dim=-1)
            if generator is not None:
                uniform = th.rand(logits.shape, generator=generator).clamp(min=th.finfo(th.float32).tiny)
                logits = logits - (-uniform.log()).log().to(logits.device)
            relaxed = (logits * (F.softplus(self.inverse_temperature(hidden)) + 0.2)).softmax(dim=-1)
            hard = F.one_hot(relaxed.argmax(dim=-1), self.shape.vocabulary_size).float()
            symbols.append(hard + relaxed - relaxed.detach())
        return th.stack(symbols, dim=1)

    def log_probs(self, memory: th.Tensor) -> th.Tensor:
        """
        Log-probability of every message, at temperature 1 and without noise.

        :param memory: (K, memory)
        :return: (K, M)
        """
        messages = self.shape.all().to(memory.device)  # (M, length)
        count, frames = len(messages), len(memory)
        spoken = F.one_hot(messages, self.shape.vocabulary_size).float().repeat(frames, 1, 1)  # (K * M, length, V)
        gates = input_gates(self.embedding.weight.t(), self.cell)
        hidden, before, total = memory.repeat_interleave(count, dim=0), gates[:1], memory.new_zeros(frames * count)
        for symbol in spoken.unbind(dim=1):
            hidden, before = next_hidden(before, hidden, self.cell), symbol @ gates
            total = total + (self.logits(hidden).log_softmax(dim=-1) * symbol).sum(dim=-1)
        return total.view(frames, count)


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

    def forward(self, symbols: th.Tensor) -> th.Tensor:
        """
        :param symbols: (K, length, vocabulary_size) one-hot
        :return: (K, message)
        """
        gates, hidden = input_gates(self.embedding.weight.t(), self.gru), symbols.new_zeros(1, self.gru.hidden_size)
        for symbol in symbols.unbind(dim=1):
            hidden = next_hidden(symbol @ gates, hidden, self.gru)
        return hidden

    def all(self) -> th.Tensor:
        """:return: (M, message) the encoding of every message, in the order of its index"""
        messages = self.shape.all().to(self.embedding.weight.device)
        return self(F.one_hot(messages, self.shape.vocabulary_size).float())
