"""The memory LSTM over sequences of different lengths."""

from contextlib import nullcontext
from unittest.mock import patch

import pytest
import torch as th
from hypothesis import given
from hypothesis import strategies as st

from sb3_guide.policies.memory import FEW, WIDE, Memory
from sb3_guide.policies.products import computing_in


@pytest.mark.parametrize("few", [0, FEW], ids=["step by step", "padded"])
@given(lengths=st.lists(st.integers(1, 20), min_size=1, max_size=6), seed=st.integers(0, 2**31))
def test_each_sequence_is_remembered_as_if_it_were_alone(few, lengths, seed):
    with patch("sb3_guide.policies.memory.FEW", few):
        compare_with_alone(lengths, seed)


@given(lengths=st.lists(st.integers(1, 20), min_size=1, max_size=6), seed=st.integers(0, 2**31))
def test_and_so_it_is_while_products_are_rounded(lengths, seed):
    with computing_in("bfloat16"):
        compare_with_alone(lengths, seed)  # of so few rows, only the weights' gradients are rounded


def compare_with_alone(lengths, seed):
    th.manual_seed(seed)
    memory, features, frames = Memory(3, 4), th.randn(5, 3, requires_grad=True), sum(lengths)
    position, weight = th.randint(5, (frames,)), th.randn(frames, 4)
    state = (th.randn(1, len(lengths), 4), th.randn(1, len(lengths), 4))

    together = memory(features, position, th.tensor(lengths), state)
    alone = [
        memory.lstm(features[part].unsqueeze(0), (state[0][:, [row]], state[1][:, [row]]))[0].squeeze(0)
        for row, part in enumerate(position.split(lengths))
    ]
    assert th.allclose(together, th.cat(alone), atol=1e-5)
    gradients = [th.autograd.grad((output * weight).sum(), features)[0] for output in (together, th.cat(alone))]
    assert th.allclose(*gradients, atol=1e-4)


def test_step_by_step_equals_the_sequence():
    memory, features, lengths = Memory(3, 4), th.randn(6, 3), th.tensor([3, 3])
    state = (th.randn(1, 2, 4), th.randn(1, 2, 4))
    with th.no_grad():
        together = memory(features, th.arange(6), lengths, state)
        for step in range(3):
            output, state = memory.step(features[[step, 3 + step]], state)
            assert th.allclose(output, together[[step, 3 + step]], atol=1e-6)


@pytest.mark.parametrize(("precision", "tolerance"), [(th.float32, 1e-4), (th.bfloat16, 0.05)])
def test_a_wide_memory_has_torchs_outputs_and_gradients(precision, tolerance):
    """Of features, state and weights; bfloat16 has eight bits."""
    th.manual_seed(0)
    lengths = [3, 1, 7, 7]
    memory, features, frames = Memory(3, WIDE), th.randn(5, 3, requires_grad=True), sum(lengths)
    position, weight = th.randint(5, (frames,)), th.randn(frames, WIDE)
    h, c = (th.randn(1, len(lengths), WIDE, requires_grad=True) for _ in range(2))
    inputs = [features, h, c, *memory.parameters()]
    found = []
    for wide in (WIDE, WIDE + 1):
        with (
            computing_in("bfloat16") if wide == WIDE else nullcontext(),
            patch("sb3_guide.policies.memory.WIDE", wide),
            patch("sb3_guide.policies.products.ROUNDED", precision),
            patch("sb3_guide.policies.through_time.ROUNDED", precision),
        ):
            output = memory(features, position, th.tensor(lengths), (h, c))
            found.append([output, *th.autograd.grad((output * weight).sum(), inputs)])
    for ours, torchs in zip(*found, strict=True):
        assert (ours - torchs).norm() <= tolerance * torchs.norm()
