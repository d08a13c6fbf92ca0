"""The memory LSTM, fed with windows or with whole episodes: one module, the same code."""

import torch as th
from torch import nn
from torch.nn.functional import embedding
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

State = tuple[th.Tensor, th.Tensor]  # h and c of shape (1, B, hidden) each


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

    def forward(self, features: th.Tensor, lengths: th.Tensor, state: State | None = None) -> tuple[th.Tensor, State]:
        """
        Sequences of any lengths.

        :param features: (K, features_dim) of all sequences, one after the other
        :param lengths: (B,) frames in each sequence
        :param state: state before each sequence; None means that nothing was seen yet
        :return: the output at each frame (K, hidden) and the state after each sequence
        """
        valid = is_frame(lengths)
        padded = features.new_zeros(*valid.shape, features.shape[1]).masked_scatter(valid.unsqueeze(-1), features)
        packed = pack_padded_sequence(padded, lengths.cpu(), batch_first=True, enforce_sorted=False)
        output, state = self.lstm(packed, state)
        return pad_packed_sequence(output, batch_first=True)[0][valid], state

    def last(self, features: th.Tensor, position: th.Tensor, lengths: th.Tensor) -> th.Tensor:
        """
        Sequences of much the same lengths, of which the last output counts: computing the padding after it costs less than
        packing the rest.

        :param features: (U, features_dim)
        :param position: (K,) which of the features belongs to each frame of the sequences
        :param lengths: (B,) frames in each sequence
        :return: the output at the last frame of each sequence (B, hidden)
        """
        valid = is_frame(lengths)
        padded = position.new_zeros(valid.shape).masked_scatter(valid, position)
        output, _ = self.lstm(embedding(padded, features))
        return output[th.arange(len(lengths), device=lengths.device), lengths - 1]


def is_frame(lengths: th.Tensor) -> th.Tensor:
    """
    :param lengths: (B,) frames in each sequence
    :return: (B, T) bool, whether there is a frame, with padding behind each sequence up to the longest
    """
    return th.arange(int(lengths.max()), device=lengths.device) < lengths.unsqueeze(1)
