"""The memory LSTM, fed with windows or with whole episodes: one module, the same code."""

import torch as th
from torch import nn
from torch.nn.functional import embedding, linear

from sb3_guide.policies.interventions import Scene
from sb3_guide.policies.products import rounds, transform
from sb3_guide.policies.short_sequences import WindowsLSTM
from sb3_guide.policies.through_time import WIDE, ThroughTime

State = tuple[th.Tensor, th.Tensor]  # h and c of shape (1, B, hidden) each
FEW = 24  # sequences, up to which padding costs less than steps of our own
FEW_FRAMES, SHORT = 512, 8  # in all windows and in each, up to which steps of our own cost less than padding


class Memory(nn.Module):
    """
    LSTM over sequences of different lengths.

    :param features_dim: width of its input
    :param hidden: width of its state and output
    """

    def __init__(self, features_dim: int, hidden: int) -> None:
        super().__init__()
        self.hidden = hidden
        self.lstm = nn.LSTM(features_dim, hidden, batch_first=True)

    def forward(self, features: th.Tensor, position: th.Tensor, lengths: th.Tensor, state: State | None = None) -> th.Tensor:
        """
        Sequences of any lengths. Torch's packed sequences would need quadratic time in the number of steps for the gradients.

        :param features: (U, features_dim)
        :param position: (K,) which of the features belongs to each frame of the sequences, one sequence after the other
        :param lengths: (B,) frames in each sequence
        :param state: state before each sequence; None means that nothing was seen yet
        :return: the output at each frame (K, hidden)
        """
        if len(lengths) <= FEW and self.hidden < WIDE and not rounds():
            return self._padded(features, position, lengths, state)[is_frame(lengths)]
        none = features.new_zeros(len(lengths), self.hidden)
        h, c = (none, none) if state is None else (state[0].squeeze(0), state[1].squeeze(0))
        input_weight, weight, input_bias, bias = self.lstm.parameters()
        inputs = transform(features, input_weight, input_bias + bias)
        output: th.Tensor = ThroughTime.apply(inputs, position, lengths, h, c, weight)
        return output

    def step(self, features: th.Tensor, state: State) -> tuple[th.Tensor, State]:
        """
        :param features: (B, features_dim) of one frame in each world
        :param state: before it
        :return: the output (B, hidden) and the state after it
        """
        before = state[0].squeeze(0), state[1].squeeze(0)
        with th.autocast("cpu", enabled=False):  # under which the cell would mix types
            h, c = th.lstm_cell(features.to(before[0].dtype), before, *self.lstm.parameters())
        return h, (h.unsqueeze(0), c.unsqueeze(0))

    def last_of_windows(self, features: th.Tensor, began: th.Tensor) -> th.Tensor:
        """
        As :meth:`last`, of a few short windows.

        :param features: (B, T, features_dim)
        :param began: (B, T) bool, from when on frames count
        :return: the output at the last frame (B, hidden)
        """
        input_weight, weight, input_bias, bias = self.lstm.parameters()
        inputs = linear(features.transpose(0, 1), input_weight, input_bias + bias)  # (T, B, 4 * hidden)
        # gates of minus infinity keep the state at zero until the episode begins
        output: th.Tensor = WindowsLSTM.apply(inputs.masked_fill(~began.t().unsqueeze(2), -th.inf), weight)
        return output

    def last(self, features: th.Tensor, position: th.Tensor, lengths: th.Tensor) -> th.Tensor:
        """
        Short sequences, each seen from nothing, of which the last output counts.

        :param features: (U, features_dim)
        :param position: (K,) which of the features belongs to each frame of the sequences
        :param lengths: (B,) frames in each sequence
        :return: the output at the last frame of each sequence (B, hidden)
        """
        output = self._padded(features, position, lengths)
        return output[th.arange(len(lengths), device=lengths.device), lengths - 1]

    def _padded(self, features: th.Tensor, position: th.Tensor, lengths: th.Tensor, state: State | None = None) -> th.Tensor:
        """:return: the output at each step of each sequence, with padding up to the longest (B, T, hidden)"""
        valid = is_frame(lengths)
        padded = position.new_zeros(valid.shape).masked_scatter(valid, position)
        output: th.Tensor = self.lstm(embedding(padded, features), state)[0]
        return output


def is_frame(lengths: th.Tensor) -> th.Tensor:
    """
    :param lengths: (B,) frames in each sequence
    :return: (B, T) bool, whether there is a frame, with padding behind each sequence up to the longest
    """
    return th.arange(int(lengths.max()), device=lengths.device) < lengths.unsqueeze(1)


def scene_of(memory: th.Tensor, lengths: th.Tensor, first: th.Tensor | None = None) -> Scene:
    """
    :param memory: (K, state_size) at each frame of B sequences, one sequence after the other
    :param lengths: (B,) frames in each sequence
    :param first: (B, state_size) memory before each sequence; None where episodes begin
    :return: where those frames stand in their episodes
    """

    def before() -> th.Tensor:
        earlier = memory.roll(1, dims=0)
        earlier[lengths.cumsum(0) - lengths] = 0.0 if first is None else first
        return earlier

    return Scene(th.arange(len(lengths), device=lengths.device).repeat_interleave(lengths), before)
