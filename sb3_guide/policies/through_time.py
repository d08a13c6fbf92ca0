"""An LSTM over whole sequences, forward and backward, that computes on no padding."""

from typing import Any

import torch as th

from sb3_guide.policies.products import ROUNDED, product, product_of_columns, rounds

WIDE = 512  # hidden units from which on rounding the factors of a step costs less than it saves


class ThroughTime(th.autograd.Function):
    """
    Steps run over all sequences that still go on. What does not depend on the step before or after, which is nearly all, is
    computed for all frames at once.
    """

    @staticmethod
    def forward(  # type: ignore[override]
        ctx: Any,
        inputs: th.Tensor,
        position: th.Tensor,
        lengths: th.Tensor,
        h: th.Tensor,
        c: th.Tensor,
        weight: th.Tensor,
    ) -> th.Tensor:
        """
        :param inputs: (U, 4 * hidden) what the inputs add to the gates, in the order of torch's LSTM
        :param position: (K,) which of the inputs belongs to each frame of the sequences, one sequence after the other
        :param lengths: (B,) frames in each sequence
        :param h: (B, hidden) before each sequence
        :param c: (B, hidden)
        :param weight: (4 * hidden, hidden) of torch's LSTM
        :return: the output at each frame (K, hidden)
        """
        hidden, order = weight.shape[1], lengths.argsort(descending=True, stable=True)
        going = (lengths.unsqueeze(1) > th.arange(int(lengths.max()), device=lengths.device)).sum(dim=0)  # (T,)
        first, counts = (lengths.cumsum(0) - lengths)[order], going.tolist()
        frame = th.cat([first[:count] + step for step, count in enumerate(counts)])  # (K,) by time, then by sequence
        position, h, c = position[frame], h[order], c[order]
        gates = inputs.index_select(0, position)  # (K, 4 * hidden)
        cells, shown, outputs = gates.new_empty(3, len(frame), hidden).unbind()
        rounded = rounds() and hidden >= WIDE
        recurrent, h_now, c_now = weight.to(ROUNDED if rounded else weight.dtype).t(), h, c
        put, keep, new, show = gates.view(-1, 4, hidden).unbind(dim=1)
        views = (gates, gates[:, : 2 * hidden], put, keep, new, show, cells, shown, outputs)
        for now, put_and_keep, put, keep, new, show, cell, show_cell, output in zip(*(view.split(counts) for view in views), strict=True):
            count = len(now)
            add_product(now, h_now[:count], recurrent)
            put_and_keep.sigmoid_()
            new.tanh_()
            show.sigmoid_()
            th.mul(put, new, out=cell).addcmul_(keep, c_now[:count])
            th.mul(show, th.tanh(cell, out=show_cell), out=output)
            h_now, c_now = output, cell
        ctx.counts, ctx.n_inputs, ctx.rounds, ctx.rounded = counts, len(inputs), rounds(), rounded
        ctx.save_for_backward(position, frame, order, gates, cells, shown, outputs, h, c, weight)
        return th.empty_like(outputs).index_copy_(0, frame, outputs)

    @staticmethod
    def backward(ctx: Any, grad: th.Tensor) -> tuple[th.Tensor | None, ...]:  # type: ignore[override]
        position, frame, order, gates, cells, shown, outputs, h, c, weight = ctx.saved_tensors
        counts, hidden = ctx.counts, weight.shape[1]
        earlier = th.arange(len(h), len(frame), device=h.device) - th.tensor(counts[:-1], dtype=th.long).repeat_interleave(th.tensor(counts[1:], dtype=th.long))
        h_before, c_before = th.cat([h, outputs[earlier]]), th.cat([c, cells[earlier]])
        put, keep, new, show = gates.view(-1, 4, hidden).unbind(dim=1)
        to_cell = th.addcmul(show, show * shown, shown, value=-1)  # show * (1 - shown^2)
        through = th.addcmul(gates, gates, gates, value=-1)  # slopes of the gates, then what comes through them
        by_gate = through.view(-1, 4, hidden)
        by_gate[:, 0] *= new
        by_gate[:, 1] *= c_before
        th.addcmul(put, put * new, new, value=-1, out=by_gate[:, 2])
        by_gate[:, 3] *= shown
        dh, dc = grad[frame], th.zeros_like(c)
        recurrent = weight
        if ctx.rounded:
            recurrent = weight.to(ROUNDED).t().contiguous().t()  # a few rows times this layout is three times as fast
        views = (through, by_gate[:, :3], by_gate[:, 3], dh, to_cell, keep)
        later = through[:0]
        for out, by_cell, by_output, dh_now, slope, forget in zip(*(reversed(view.split(counts)) for view in views), strict=True):
            if len(later):
                add_product(dh_now[: len(later)], later, recurrent)
            dc_now = dc[: len(out)].addcmul_(dh_now, slope)
            by_cell.mul_(dc_now.unsqueeze(1))
            by_output.mul_(dh_now)
            dc_now *= forget
            later = out
        d_h = add_product(th.zeros_like(h), later, recurrent)
        d_weight = product_of_columns(through, h_before) if ctx.rounds else through.t() @ h_before
        d_inputs = through.new_zeros(ctx.n_inputs, through.shape[1]).index_add_(0, position, through)
        unsorted = order.argsort()
        return d_inputs, None, None, d_h[unsorted], dc[unsorted], d_weight


def add_product(total: th.Tensor, a: th.Tensor, b: th.Tensor) -> th.Tensor:
    """:return: total, to which a @ b was added, rounded where b is"""
    return total.addmm_(a, b) if b.dtype == total.dtype else total.add_(product(a, b))
