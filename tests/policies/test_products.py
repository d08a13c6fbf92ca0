"""Products of factors with 16 bits."""

import pytest
import torch as th
from torch import nn

from sb3_guide.policies.products import (
    MANY,
    computing_in,
    product,
    repeating,
    transform,
    transform_looked_up,
    usual_arithmetic,
)

ROUNDING = 2.0**-8  # of a factor, relative: bfloat16 keeps eight bits


def gradients(output: th.Tensor, *parts: th.Tensor) -> list[th.Tensor]:
    """:return: of the output's sum of squares"""
    return list(th.autograd.grad(output.square().sum(), parts))


def test_factors_and_result_are_rounded_and_the_sum_is_not():
    ones = th.ones(1, 300)
    assert product(ones[:, :1], th.tensor([[1.0 + 2.0**-10]])).tolist() == [[1.0]]  # a factor that 16 bits can't hold
    assert product(ones, ones.t()).tolist() == [[300.0]]  # 256 + 1 would be 256 for ever
    assert product(ones[:, :257], ones[:, :257].t()).tolist() == [[256.0]]  # a result that they can't hold


@pytest.mark.parametrize("n_rows", [1, MANY - 1])
def test_of_few_rows_nothing_is_rounded(n_rows):
    layer, x = nn.Linear(40, 30), th.randn(n_rows, 40)
    with computing_in("bfloat16"):
        assert th.equal(transform(x, layer.weight, layer.bias), layer(x))


@pytest.mark.parametrize("n_rows", [MANY, MANY + 1, 200, 517])
def test_within_the_block_a_layer_is_the_same_up_to_rounding(n_rows):
    layer, x = nn.Linear(40, 30), th.randn(n_rows, 40, requires_grad=True)
    exact = transform(x, layer.weight, layer.bias)
    assert th.equal(exact, layer(x))
    with computing_in("bfloat16"):
        close = transform(x, layer.weight, layer.bias)
    assert not th.equal(close, exact)
    expected = gradients(exact, x, layer.weight, layer.bias)
    th.testing.assert_close(close, exact, rtol=0, atol=3 * ROUNDING)
    for found, wanted in zip(gradients(close, x, layer.weight, layer.bias), expected, strict=True):
        assert found.dtype == th.float32
        assert (found - wanted).norm() < 2 * ROUNDING * wanted.norm()


def test_looking_rows_up_first_is_the_same_as_a_layer_on_them():
    layer, table, index = nn.Linear(3 * 4, 5), th.randn(6, 4, requires_grad=True), th.randint(6, (MANY, 3))
    exact = transform_looked_up(table, index, layer.weight, layer.bias)
    assert th.equal(exact, layer(table[index].flatten(1)))
    with computing_in("bfloat16"):
        close = transform_looked_up(table, index, layer.weight, layer.bias)
    expected = gradients(exact, table, layer.weight, layer.bias)
    for found, wanted in zip(gradients(close, table, layer.weight, layer.bias), expected, strict=True):
        assert (found - wanted).norm() < 2 * ROUNDING * wanted.norm()


def test_after_the_block_products_are_exact_again_even_if_it_failed():
    layer, x = nn.Linear(4, 4), th.randn(3, 4)
    with pytest.raises(RuntimeError, match="stop"), computing_in("bfloat16"):
        raise RuntimeError("stop")
    assert th.equal(transform(x, layer.weight, layer.bias), layer(x))


@pytest.mark.parametrize(
    ("features", "forbidden", "expected"),
    [
        ({"avx2": True}, "", "float32"),
        ({"avx512bf16": True, "amx-bf16": False}, "", "bfloat16"),
        ({"amx-bf16": True}, "ALL", "bfloat16"),
        ({"amx-bf16": True, "avx512bf16": True}, "avx2", "float32"),
        ({"amx-bf16": True, "avx512bf16": True}, "AVX512_CORE_VNNI", "float32"),
    ],
)
def test_the_processor_decides_in_what_is_computed(monkeypatch, features, forbidden, expected):
    monkeypatch.setattr("sb3_guide.policies.products.get_host_cpu_features", lambda: features)
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", forbidden)
    assert usual_arithmetic(th.device("cpu")) == expected
    assert usual_arithmetic(th.device("meta")) == "float32"


def test_numbers_of_rows_are_few_and_little_too_large():
    sizes = [repeating(n) for n in range(1, 5000)]
    assert all(n <= size <= 1.13 * n + 1 for n, size in enumerate(sizes, start=1))
    assert len(set(sizes)) < 100
