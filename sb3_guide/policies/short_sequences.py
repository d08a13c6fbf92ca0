"""
A GRU over a few missions' words and an LSTM over a few short windows, forward and backward.

Autograd would record a dozen nodes for each step. Here the backward pass does what does not depend on the step
before for all steps at once, and three to five products for each step.
"""

from typing import Any

import torch as th
from torch.amp import custom_bwd, custom_fwd
from torch.autograd.function import once_differentiable


class WordsGRU(th.autograd.Function):
    """
    h is the hidden state before a word and x what the word adds to the gates, W and b are the GRU's:

        [r_h, u_h, n_h] = W h + b            r = sigmoid(r_x + r_h)          u = sigmoid(u_x + u_h)
        n = tanh(n_x + r n_h)                h' = n + u (h - n)              h' = h where there is no word
    """

    @staticmethod
    @custom_fwd(device_type="cpu", cast_inputs=th.float32)
    def forward(  # type: ignore[override]
        ctx: Any, inputs: th.Tensor, is_word: th.Tensor, weight: th.Tensor, bias: th.Tensor
    ) -> th.Tensor:
        """
        :param inputs: (L, N, 3 * hidden) what the words add to the gates: reset, update, new
        :param is_word: (L, N, 1) bool
        :param weight: (3 * hidden, hidden) of torch's GRU
        :param bias: (3 * hidden,)
        :return: (N, hidden) after the last word
        """
        n_words, n_missions, size = *inputs.shape[:2], weight.shape[1]
        before, new = inputs.new_zeros(2, n_words + 1, n_missions, size)  # before[t] is h before word t
        recurrent, gates = th.empty_like(inputs), inputs.new_empty(n_words, n_missions, 2 * size)
        for step, (x, of_h, gate) in enumerate(zip(inputs, recurrent, gates, strict=True)):
            h = before[step]
            th.addmm(bias, h, weight.t(), out=of_h)
            th.add(x[:, : 2 * size], of_h[:, : 2 * size], out=gate).sigmoid_()
            th.addcmul(x[:, 2 * size :], gate[:, :size], of_h[:, 2 * size :], out=new[step]).tanh_()
            th.where(is_word[step], th.lerp(new[step], h, gate[:, size:]), h, out=before[step + 1])
        ctx.save_for_backward(is_word, weight, before[:-1], gates, recurrent[:, :, 2 * size :], new[:-1])
        return before[-1].clone()

    @staticmethod
    @once_differentiable
    @custom_bwd(device_type="cpu")
    def backward(ctx: Any, dh: th.Tensor) -> tuple[th.Tensor | None, ...]:  # type: ignore[override]
        is_word, weight, before, gates, of_hidden, new = ctx.saved_tensors
        reset, update = gates.chunk(2, dim=2)  # (L, N, hidden)
        to_new = (1.0 - update) * (1.0 - new * new) * is_word
        to_reset = to_new * of_hidden * reset * (1.0 - reset)
        to_update = (before - new) * update * (1.0 - update) * is_word
        slopes = th.stack([to_reset, to_update, to_new * reset], dim=2)  # by h' of what W h + b is
        kept = th.where(is_word, update, 1.0)
        through = th.empty_like(slopes)
        for step in reversed(range(len(kept))):
            th.mul(slopes[step], dh.unsqueeze(1), out=through[step])
            to_new[step] *= dh
            dh = th.addmm(dh * kept[step], through[step].flatten(1), weight)
        d_recurrent = through.flatten(2)  # (L, N, 3 * hidden)
        d_inputs = th.cat([d_recurrent[:, :, : -new.shape[2]], to_new], dim=2)
        d_weight = d_recurrent.flatten(0, 1).t() @ before.flatten(0, 1)
        return d_inputs, None, d_weight, d_recurrent.sum(dim=(0, 1))


class WindowsLSTM(th.autograd.Function):
    """
    h and c are the state before a frame and x what the frame adds to the gates, W is the LSTM's:

        [i, f, g, o] = x + W h               c' = sigmoid(f) c + sigmoid(i) tanh(g)          h' = sigmoid(o) tanh(c')
    """

    @staticmethod
    @custom_fwd(device_type="cpu", cast_inputs=th.float32)
    def forward(ctx: Any, inputs: th.Tensor, weight: th.Tensor) -> th.Tensor:  # type: ignore[override]
        """
        :param inputs: (T, B, 4 * hidden); where they are minus infinity the state stays zero
        :param weight: (4 * hidden, hidden) of torch's LSTM
        :return: (B, hidden) h after the last frame
        """
        size = weight.shape[1]
        gates = inputs.clone(memory_format=th.contiguous_format)
        hs, cs, shown = gates.new_zeros(3, len(inputs) + 1, inputs.shape[1], size)  # hs[t] and cs[t] before step t
        for step, gate in enumerate(gates):
            if step:
                gate.addmm_(hs[step], weight.t())
            put, keep, new, show = gate.chunk(4, dim=1)
            gate[:, : 2 * size].sigmoid_()
            new.tanh_()
            show.sigmoid_()
            c = th.mul(put, new, out=cs[step + 1]).addcmul_(keep, cs[step])
            th.mul(show, th.tanh(c, out=shown[step]), out=hs[step + 1])
        ctx.save_for_backward(weight, hs[:-1], cs[:-1], gates, shown[:-1])
        return hs[-1].clone()

    @staticmethod
    @once_differentiable
    @custom_bwd(device_type="cpu")
    def backward(ctx: Any, dh: th.Tensor) -> tuple[th.Tensor, th.Tensor]:  # type: ignore[override]
        weight, h, c, gates, shown = ctx.saved_tensors
        put, keep, new, show = gates.chunk(4, dim=2)  # (T, B, hidden)
        to_cell = show * (1.0 - shown * shown)
        slopes = gates * (1.0 - gates)  # of the sigmoids; by c' of i, f and g, and by h' of o
        at_put, at_keep, at_new, at_show = slopes.chunk(4, dim=2)
        at_put *= new
        at_keep *= c
        th.mul(put, 1.0 - new * new, out=at_new)
        at_show *= shown
        by_gate = slopes.unflatten(2, (4, -1))  # (T, B, 4, hidden), which become the gradients
        dc = th.zeros_like(dh)
        for step in reversed(range(len(h))):
            dc = th.addcmul(dc, dh, to_cell[step])
            by_gate[step, :, :3] *= dc.unsqueeze(1)
            at_show[step] *= dh
            dc = dc * keep[step]
            dh = slopes[step] @ weight
        return slopes, slopes.flatten(0, 1).t() @ h.flatten(0, 1)
