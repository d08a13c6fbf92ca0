"""
The memory over sequences of different lengths, beside torch's packed sequences: `python -m benchmarks.memory_speed`.

Forward and backward, on 2,048 frames in sequences as a minibatch of RecurrentPPO has them. Both give the same values.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import torch as th
from torch.nn.utils.rnn import pack_padded_sequence, pad_packed_sequence

from sb3_guide.policies.memory import Memory, State, is_frame
from sb3_guide.policies.sizes import size_of

FRAMES, LONGEST = 2048, 128


def packed(memory: Memory, features: th.Tensor, position: th.Tensor, lengths: th.Tensor, state: State) -> th.Tensor:
    """:return: what the memory returns, by a packed sequence"""
    valid = is_frame(lengths)
    frames = features[position]
    padded = frames.new_zeros(*valid.shape, frames.shape[1]).masked_scatter(valid.unsqueeze(-1), frames)
    output, _ = memory.lstm(pack_padded_sequence(padded, lengths, batch_first=True, enforce_sorted=False), state)
    return pad_packed_sequence(output, batch_first=True)[0][valid]


def draw_lengths(mean: float, rng: np.random.Generator) -> th.Tensor:
    """:return: (B,) lengths of sequences, geometrically distributed, of FRAMES frames in all"""
    lengths = np.minimum(rng.geometric(1 / mean, FRAMES), LONGEST)
    lengths = lengths[: int(np.searchsorted(lengths.cumsum(), FRAMES)) + 1]
    lengths[-1] -= lengths.sum() - FRAMES
    return th.as_tensor(lengths)


def seconds(remember: Callable[..., th.Tensor], inputs: tuple[Any, ...], repeats: int) -> float:
    """:return: the fastest of several times of forward and backward"""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        remember(*inputs).square().sum().backward()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    """Compare both for episodes of different mean lengths, and print a row for each."""
    parser = argparse.ArgumentParser(description="The memory over sequences step by step, and over packed ones.")
    parser.add_argument("--repeats", type=int, default=10, help="the fastest counts")
    arguments = parser.parse_args()
    th.set_num_threads(1)
    size, rng = size_of("compact"), np.random.default_rng(0)
    for mean in (5, 20, 60):
        lengths = draw_lengths(mean, rng)
        memory, features = Memory(size.image, size.memory), th.randn(FRAMES, size.image, requires_grad=True)
        h, c = th.randn(2, 1, len(lengths), size.memory)
        inputs = (features, th.arange(FRAMES), lengths, (h, c))
        assert th.allclose(memory(*inputs), packed(memory, *inputs), atol=1e-5)
        ours = seconds(memory, inputs, arguments.repeats)
        theirs = seconds(partial(packed, memory), inputs, arguments.repeats)
        print(f"| {mean} | {len(lengths)} | {1000 * ours:.1f} | {1000 * theirs:.1f} | {theirs / ours:.1f} |")


if __name__ == "__main__":
    main()
