"""Steps of a GRU whose inputs are few: what each of them adds to the gates is computed once."""

import torch as th
from torch import nn
from torch.nn.functional import linear

from sb3_guide.policies.products import transform


def input_gates(inputs: th.Tensor, gru: nn.GRU | nn.GRUCell) -> th.Tensor:
    """
    :param inputs: (U, in)
    :param gru: with one layer
    :return: (U, 3 * hidden) what each input adds to the gates: reset, update, new
    """
    weight, _, bias, _ = gru.parameters()
    return linear(inputs, weight, bias)


def next_hidden(from_input: th.Tensor, hidden: th.Tensor, gru: nn.GRU | nn.GRUCell) -> th.Tensor:
    """
    :param from_input: (K or 1, 3 * hidden) what the input adds to the gates
    :param hidden: (K or 1, hidden) before the step
    :param gru: with one layer
    :return: (K, hidden) after it
    """
    _, weight, _, bias = gru.parameters()
    reset_in, update_in, new_in = from_input.chunk(3, dim=1)
    reset, update, new = transform(hidden, weight, bias).chunk(3, dim=1)
    new = th.addcmul(new_in, (reset_in + reset).sigmoid(), new).tanh()
    return th.lerp(new, hidden, (update_in + update).sigmoid())
