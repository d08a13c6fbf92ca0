"""A wide LSTM over whole sequences, forward and backward, that computes on no padding."""

from typing import Any

import torch as th

from sb3_guide.policies.products import ROUNDED, product


class ThroughTime(th.autograd.Function):
    """
    Steps run over all sequences that still go on. What does not depend on the step before, which are the products with the
    inputs and those that make the weights' gradients, is computed for all frames at once.
    """

    @staticmethod
    def forward(  # type: ignore[override]
        ctx: Any,
        features: th.Tensor,
        position: th.Tensor,
        lengths: th.Tensor,
        h: th.Tensor,
        c: th.Tensor,
        input_weight: th.Tensor,
        weight: th.Tensor,
        bias: th.Tensor,
    ) -> th.Tensor:
        """
        :param features: (U, features_dim)
        :param position: (K,) which of the features belongs to each frame of the sequences, one sequence after the other
        :param lengths: (B,) frames in each sequence
        :param h: (B, hidden) before each sequence
        :param c: (B, hidden)
        :param input_weight: (4 * hidden, features_dim) of torch's LSTM, in its order of gates
        :param weight: (4 * hidden, hidden)
        :param bias: (4 * hidden,)
        :return: the output at each frame (K, hidden)
        """
        order = lengths.argsort(descending=True, stable=True)
        going = (lengths.unsqueeze(1) > th.arange(int(lengths.max()), device=lengths.device)).sum(dim=0)  # (T,)
        first, counts = (lengths.cumsum(0) - lengths)[order], going.tolist()
        frame = th.cat([first[:count] + step for step, count in enumerate(counts)])  # (K,) by time, then by sequence
        gates = (product(features, input_weight.t()) + bias)[position[frame]]  # (K, 4 * hidden)
        recurrent = weight.t().to(ROUNDED)
        h, c, outputs, cells = h[order], c[order], [], []
        befores = []
        for now, count in zip(gates.split(counts), counts, strict=True):
            befores.append((h[:count], c[:count]))
            now += product(h[:count], recurrent)
            put, keep, new, show = now.chunk(4, dim=1)  # views
            for gate in (put, keep, show):
                gate.sigmoid_()
            new.tanh_()
            c = th.addcmul(put * new, keep, c[:count])
            h = show * c.tanh()
            outputs.append(h)
            cells.append(c)
        h_before, c_before = (th.cat(parts) for parts in zip(*befores, strict=True))
        ctx.counts = counts
        ctx.save_for_backward(
            features, position[frame], frame, order, gates, th.cat(cells), h_before, c_before, input_weight, weight
        )
        return th.cat(outputs).new_empty(len(frame), weight.shape[1]).index_copy_(0, frame, th.cat(outputs))

    @staticmethod
    def backward(ctx: Any, grad: th.Tensor) -> tuple[th.Tensor | None, ...]:  # type: ignore[override]
        features, position, frame, order, gates, cells, h_before, c_before, input_weight, weight = ctx.saved_tensors
        counts, grad = ctx.counts, grad[frame]
        recurrent = weight.to(ROUNDED).t().contiguous().t()  # a few rows times this layout is three times as fast
        through = th.empty_like(gates)
        dh, dc = grad.new_zeros(len(order), weight.shape[1]), grad.new_zeros(len(order), weight.shape[1])
        parts = [part.split(counts) for part in (gates, cells, c_before, grad, through)]
        for now, cell, before, from_output, out in zip(*(reversed(part) for part in parts), strict=True):
            count = len(now)
            put, keep, new, show = now.chunk(4, dim=1)
            shown, dh_now = cell.tanh(), dh[:count] + from_output
            dc_now = dc[:count] + dh_now * show * (1 - shown * shown)
            d_put, d_keep, d_new, d_show = out.chunk(4, dim=1)
            th.mul(dc_now * new, put * (1 - put), out=d_put)
            th.mul(dc_now * before, keep * (1 - keep), out=d_keep)
            th.mul(dc_now * put, 1 - new * new, out=d_new)
            th.mul(dh_now * shown, show * (1 - show), out=d_show)
            dc[:count] = dc_now * keep
            dh[:count] = product(out, recurrent)
        d_weight = product(through.t(), h_before)
        at_input = through.new_zeros(len(features), through.shape[1]).index_add_(0, position, through)
        d_features = product(at_input, input_weight)
        d_input_weight = product(at_input.t(), features)
        unsorted = order.argsort()
        return d_features, None, None, dh[unsorted], dc[unsorted], d_input_weight, d_weight, through.sum(dim=0)
