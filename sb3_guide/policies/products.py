"""
Matrix products of 16 bits, summed up in 32: four times as fast on a core with units for bfloat16, and several times slower on
any other, where they are emulated. So the processor decides.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import torch as th
from llvmlite.binding import get_host_cpu_features
from torch.nn.functional import linear

from sb3_guide.policies.rows import add_rows, is_plain

ARITHMETICS = ("float32", "bfloat16")
UNITS = ("avx512bf16", "amx-bf16")  # that multiply bfloat16, as LLVM names them
WITHOUT_UNITS = ("SSE41", "AVX", "AVX2", "AVX2_VNNI", "AVX2_VNNI_2", "AVX512_CORE", "AVX512_CORE_VNNI")  # as oneDNN names them
ROUNDED = th.bfloat16
MANY = 128  # rows from which on rounding them costs less than it saves
SIZES_AN_OCTAVE = 8  # of numbers of rows: a kernel for one more of them takes longer to make than to run

_rounds: ContextVar[bool] = ContextVar("rounds", default=False)


def has_units() -> bool:
    """
    :return: whether this processor multiplies bfloat16 in hardware, and torch's oneDNN may use that: the environment variable
        ONEDNN_MAX_CPU_ISA can forbid it
    """
    features = get_host_cpu_features()
    allowed = os.environ.get("ONEDNN_MAX_CPU_ISA", "").upper() not in WITHOUT_UNITS
    return allowed and any(features.get(unit, False) for unit in UNITS)


def usual_arithmetic(device: th.device) -> str:
    """:return: "bfloat16" on a CPU with units for it, "float32" elsewhere; always the same on the same machine"""
    return "bfloat16" if device.type == "cpu" and has_units() else "float32"


def check_arithmetic(arithmetic: str) -> None:
    """
    :raises ValueError: if there is no such arithmetic
    """
    if arithmetic not in ARITHMETICS:
        raise ValueError(f"arithmetic={arithmetic!r}: expected one of {', '.join(ARITHMETICS)}")


@contextmanager
def computing_in(arithmetic: str) -> Iterator[None]:
    """
    Within a block of "bfloat16", the large products of the networks, which have many rows, have factors and results of 16
    bits, forward and backward. Made for cloning: under PPO, collecting and training must compute the same.

    :param arithmetic: "float32" or "bfloat16"
    """
    before = _rounds.set(arithmetic == "bfloat16")
    try:
        yield
    finally:
        _rounds.reset(before)


def rounds() -> bool:
    """:return: whether this is within a block of bfloat16"""
    return _rounds.get()


def transform(x: th.Tensor, weight: th.Tensor, bias: th.Tensor) -> th.Tensor:
    """
    :param x: (N, in)
    :param weight: (out, in)
    :param bias: (out,)
    :return: (N, out) x @ weight.T + bias
    """
    return RoundedProduct.apply(x, weight) + bias if rounds() and len(x) >= MANY else linear(x, weight, bias)


def transform_looked_up(table: th.Tensor, index: th.Tensor, weight: th.Tensor, bias: th.Tensor) -> th.Tensor:
    """
    :param table: (R, width)
    :param index: (N, P) rows of the table
    :param weight: (out, P * width)
    :param bias: (out,)
    :return: (N, out) the same of x = P rows side by side
    """
    if rounds() and len(index) >= MANY:
        return RoundedLookup.apply(table, index, weight) + bias  # type: ignore[no-any-return]
    looked_up: th.Tensor = Lookup.apply(table, index)
    return linear(looked_up, weight, bias)


class RoundedProduct(th.autograd.Function):
    """x @ weight.T, rounded."""

    @staticmethod
    def forward(ctx: Any, x: th.Tensor, weight: th.Tensor) -> th.Tensor:  # type: ignore[override]
        x16, weight16 = rounded(x), weight.to(ROUNDED)
        ctx.save_for_backward(x16, weight16)
        return th.mm(x16, weight16.t())[: len(x)].float()

    @staticmethod
    def backward(ctx: Any, grad: th.Tensor) -> tuple[th.Tensor, th.Tensor]:  # type: ignore[override]
        x16, weight16 = ctx.saved_tensors
        grad16 = rounded(grad)
        return th.mm(grad16, weight16)[: len(grad)].float(), th.mm(grad16.t(), x16).float()


class Lookup(th.autograd.Function):
    """Rows of a table side by side. Torch's own indexing takes several times as long, forward and backward."""

    @staticmethod
    def forward(ctx: Any, table: th.Tensor, index: th.Tensor) -> th.Tensor:  # type: ignore[override]
        ctx.save_for_backward(index)
        ctx.shape = table.shape
        return table.index_select(0, index.flatten()).view(len(index), -1)

    @staticmethod
    def backward(ctx: Any, grad: th.Tensor) -> tuple[th.Tensor, None]:  # type: ignore[override]
        return added_up(grad, ctx.saved_tensors[0], ctx.shape), None


def added_up(grad: th.Tensor, index: th.Tensor, shape: th.Size) -> th.Tensor:
    """
    :param grad: (N, P * width) of rows that were looked up
    :param index: (N, P) which rows they were
    :param shape: (R, width) of the table
    :return: the table's gradient
    """
    rows, total = grad.reshape(-1, shape[1]), grad.new_zeros(shape)
    if is_plain(grad) and grad.dtype == th.float32:
        add_rows(rows.numpy(), index.flatten().numpy(), total.numpy())
        return total
    return total.index_add_(0, index.flatten(), rows)


class RoundedLookup(th.autograd.Function):
    """The same of rows of a table side by side, which are never held in 32 bits."""

    @staticmethod
    def forward(ctx: Any, table: th.Tensor, index: th.Tensor, weight: th.Tensor) -> th.Tensor:  # type: ignore[override]
        x16, weight16 = weight.new_zeros(repeating(len(index)), weight.shape[1], dtype=ROUNDED), weight.to(ROUNDED)
        x16[: len(index)] = table.to(ROUNDED).index_select(0, index.flatten()).view(len(index), -1)
        ctx.save_for_backward(x16, index, weight16)
        ctx.shape = table.shape
        return th.mm(x16, weight16.t())[: len(index)].float()

    @staticmethod
    def backward(ctx: Any, grad: th.Tensor) -> tuple[th.Tensor, None, th.Tensor]:  # type: ignore[override]
        x16, index, weight16 = ctx.saved_tensors
        grad16 = rounded(grad)
        at_table = added_up(th.mm(grad16, weight16)[: len(grad)].float(), index, ctx.shape)
        return at_table, None, th.mm(grad16.t(), x16).float()


def product(a: th.Tensor, b: th.Tensor) -> th.Tensor:
    """:return: a @ b, rounded"""
    return th.mm(rounded(a), b.to(ROUNDED))[: len(a)].float()


def product_of_columns(a: th.Tensor, b: th.Tensor) -> th.Tensor:
    """:return: a.T @ b, rounded"""
    return th.mm(rounded(a).t(), rounded(b)).float()


def rounded(x: th.Tensor) -> th.Tensor:
    """
    :param x: (N, width)
    :return: (N', width) in 16 bits, with zeros below
    """
    x16 = x.new_empty(repeating(len(x)), x.shape[1], dtype=ROUNDED)
    x16[: len(x)] = x
    x16[len(x) :] = 0.0
    return x16


def repeating(n_rows: int) -> int:
    """:return: the number, rounded up to one of a few"""
    step = max(1, 2 ** (n_rows - 1).bit_length() // (2 * SIZES_AN_OCTAVE))
    return -(-n_rows // step) * step
