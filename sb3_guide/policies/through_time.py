"""An LSTM over whole sequences, forward and backward, that computes on no padding."""

from collections.abc import Iterable, Iterator
from typing import Any

import torch as th

from sb3_guide.policies.products import ROUNDED, product, product_of_columns, rounds

WIDE = 512  # hidden units from which on arithmetic costs more than the calls that ask for it


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
        hidden, rounded = weight.shape[1], rounds() and weight.shape[1] >= WIDE
        order, counts, frame = by_time(lengths)
        position, h, c = position[frame], h[order], c[order]
        gates = inputs.index_select(0, position)  # (K, 4 * hidden)
        cells, shown, outputs = gates.new_empty(3, len(frame), hidden).unbind()
        recurrent, befores = weight.to(ROUNDED if rounded else weight.dtype).t(), []
        parts = (gates, gates[:, : 2 * hidden], *gates.chunk(4, dim=1), cells, shown, outputs)
        for now, put_and_keep, put, keep, new, show, cell, show_cell, output in together(parts, counts):
            h, c = h[: len(now)], c[: len(now)]
            befores.append((h, c))
            add_product(now, h, recurrent)
            put_and_keep.sigmoid_()
            new.tanh_()
            show.sigmoid_()
            c = th.mul(put, new, out=cell).addcmul_(keep, c)
            h = th.mul(show, th.tanh(cell, out=show_cell), out=output)
        h_before, c_before = (th.cat(part) for part in zip(*befores, strict=True))
        ctx.counts, ctx.n_inputs, ctx.rounds, ctx.rounded = counts, len(inputs), rounds(), rounded
        ctx.save_for_backward(position, frame, order, gates, shown, h_before, c_before, weight)
        return th.empty_like(outputs).index_copy_(0, frame, outputs)

    @staticmethod
    def backward(ctx: Any, grad: th.Tensor) -> tuple[th.Tensor | None, ...]:  # type: ignore[override]
        position, frame, order, gates, shown, h_before, c_before, weight = ctx.saved_tensors
        keep, show = gates.chunk(4, dim=1)[1::2]
        to_cell = th.addcmul(show, show * shown, shown, value=-1)  # show * (1 - shown^2)
        through = slopes(gates, shown, c_before)  # at first; then the gradient that comes through each gate
        by_gate = through.view(len(frame), 4, -1)
        at_output, dc = grad[frame], c_before.new_zeros(len(order), c_before.shape[1])
        recurrent = weight
        if ctx.rounded:
            recurrent = weight.to(ROUNDED).t().contiguous().t()  # a few rows times this layout is three times as fast
        parts, later = (through, by_gate[:, :3], by_gate[:, 3], at_output, to_cell, keep), through[:0]
        for now, through_cell, through_show, dh, slope, kept in reversed(list(together(parts, ctx.counts))):
            if len(later):
                add_product(dh[: len(later)], later, recurrent)
            dc_now = dc[: len(now)].addcmul_(dh, slope)
            through_cell *= dc_now.unsqueeze(1)
            through_show *= dh
            dc_now *= kept
            later = now
        dh = add_product(th.zeros_like(dc), later, recurrent)
        d_weight = product_of_columns(through, h_before) if ctx.rounds else through.t() @ h_before
        d_inputs = through.new_zeros(ctx.n_inputs, through.shape[1]).index_add_(0, position, through)
        unsorted = order.argsort()
        return d_inputs, None, None, dh[unsorted], dc[unsorted], d_weight


def by_time(lengths: th.Tensor) -> tuple[th.Tensor, list[int], th.Tensor]:
    """
    :param lengths: (B,) frames in each sequence
    :return: the sequences from the longest to the shortest (B,); how many of them go on at each time step; and the frames by
        time, then in that order (K,)
    """
    order = lengths.argsort(descending=True, stable=True)
    going = (lengths.unsqueeze(1) > th.arange(int(lengths.max()), device=lengths.device)).sum(dim=0)  # (T,)
    first, counts = (lengths.cumsum(0) - lengths)[order], going.cpu().tolist()
    return order, counts, th.cat([first[:count] + step for step, count in enumerate(counts)])


def together(parts: Iterable[th.Tensor], counts: list[int]) -> Iterator[tuple[th.Tensor, ...]]:
    """
    :param parts: (K, ...) by time
    :param counts: how many rows of each a time step has
    :return: views of the rows of each time step, of one part after the other
    """
    return zip(*(part.split(counts) for part in parts), strict=True)


def slopes(gates: th.Tensor, shown: th.Tensor, c_before: th.Tensor) -> th.Tensor:
    """
    :param gates: (K, 4 * hidden) after their sigmoids and tanh
    :param shown: (K, hidden) tanh of the cells
    :param c_before: (K, hidden) the cells before the step
    :return: (K, 4 * hidden) by how much each gate's sum changes the cell, or, the last one's, the output
    """
    put, _, new, _ = gates.chunk(4, dim=1)
    found = th.addcmul(gates, gates, gates, value=-1)  # of the sigmoids: gate * (1 - gate)
    at_put, at_keep, at_new, at_show = found.chunk(4, dim=1)
    at_put *= new
    at_keep *= c_before
    th.addcmul(put, put * new, new, value=-1, out=at_new)  # put * (1 - new^2)
    at_show *= shown
    return found


def add_product(total: th.Tensor, a: th.Tensor, b: th.Tensor) -> th.Tensor:
    """:return: total, to which a @ b was added, rounded where b is"""
    return total.addmm_(a, b) if b.dtype == total.dtype else total.add_(product(a, b))
