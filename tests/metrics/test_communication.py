"""CIC and its companions on values worked out by hand."""

import math

import pytest
import torch as th
from hypothesis import given
from hypothesis import strategies as st

from sb3_guide.metrics import (
    cic,
    cic_as_published,
    influence,
    message_entropy,
    positive_signalling,
    tempered,
    uniform_cic,
)

CERTAIN_OF_FIRST = th.tensor([[1.0, 0.0, 0.0]]).log()
UNIFORM = th.full((1, 3), 1 / 3).log()
OBEYS = th.eye(3).unsqueeze(0).log()  # message m is always followed by action m


def test_a_learner_that_ignores_messages_has_no_cic():
    deaf = th.tensor([0.5, 0.3, 0.2]).log().expand(1, 3, 3)
    assert cic(UNIFORM, deaf).item() == pytest.approx(0.0, abs=1e-7)
    assert uniform_cic(deaf).item() == pytest.approx(0.0, abs=1e-7)


def test_perfect_obedience_to_uniform_messages_is_log_of_their_number():
    assert cic(UNIFORM, OBEYS).item() == pytest.approx(math.log(3))


def test_cic_is_capped_by_the_number_of_actions():
    two_actions = th.tensor([[[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]]]).log()
    # I(A; M) = H(A) - H(A|M) = log 2 - (1/3) log 2
    assert cic(UNIFORM, two_actions).item() == pytest.approx(2 / 3 * math.log(2))


def test_a_guide_that_is_certain_has_no_cic_under_perfect_obedience():
    assert cic(CERTAIN_OF_FIRST, OBEYS).item() == 0.0
    assert uniform_cic(OBEYS).item() == pytest.approx(math.log(3))


def test_worked_example_with_unequal_messages():
    message = th.tensor([[0.25, 0.75]]).log()
    action = th.tensor([[[0.8, 0.2], [0.4, 0.6]]]).log()
    # p(a) = (0.25 * 0.8 + 0.75 * 0.4, 0.25 * 0.2 + 0.75 * 0.6) = (0.5, 0.5)
    expected = (
        0.25 * (0.8 * math.log(0.8 / 0.5) + 0.2 * math.log(0.2 / 0.5))
        + 0.75 * (0.4 * math.log(0.4 / 0.5) + 0.6 * math.log(0.6 / 0.5))
    )  # fmt: skip
    assert cic(message, action).item() == pytest.approx(expected, rel=1e-5)


def test_each_frame_has_its_own_value():
    both = cic(th.cat([UNIFORM, CERTAIN_OF_FIRST]), OBEYS.expand(2, 3, 3))
    assert both.tolist() == pytest.approx([math.log(3), 0.0])


def test_message_entropy():
    assert message_entropy(th.cat([UNIFORM, CERTAIN_OF_FIRST])).tolist() == pytest.approx([math.log(3), 0.0])


def test_positive_signalling_is_what_messages_tell_of_observations():
    one_message_each = th.eye(3).log()
    assert positive_signalling(one_message_each) == pytest.approx(math.log(3))
    assert positive_signalling(UNIFORM.expand(5, 3)) == pytest.approx(0.0, abs=1e-6)
    assert positive_signalling(CERTAIN_OF_FIRST.expand(5, 3)) == pytest.approx(0.0, abs=1e-6)


def test_positive_signalling_of_frames_that_count_several_times():
    frames = th.randn(5, 3, generator=th.Generator().manual_seed(0)).log_softmax(-1)
    often = th.tensor([2, 0, 1, 3, 1])
    repeated = positive_signalling(frames.repeat_interleave(often, dim=0))
    assert positive_signalling(frames, often.float()) == pytest.approx(repeated, abs=1e-6)


@given(seed=st.integers(0, 10_000), messages=st.integers(2, 9), actions=st.integers(2, 7), sharpness=st.floats(0, 200))
def test_cic_lies_between_zero_and_its_bounds(seed, messages, actions, sharpness):
    generator = th.Generator().manual_seed(seed)
    guide = (th.randn(4, messages, generator=generator) * sharpness).log_softmax(-1)
    learner = (th.randn(4, messages, actions, generator=generator) * sharpness).log_softmax(-1)
    value = cic(guide, learner)
    assert value.isfinite().all()
    assert (value > -1e-4).all()
    assert (value <= message_entropy(guide).clamp(max=math.log(actions)) + 1e-4).all()


@pytest.mark.parametrize("shape", [(2, 3), (3, 3, 3), (2, 4, 3)])
def test_shapes_that_do_not_fit_are_refused(shape):
    with pytest.raises(ValueError, match=r"message_log_probs has shape \(2, 3\).*expected \(frames, messages\)"):
        cic(th.zeros(2, 3), th.zeros(shape))


def test_no_frames_are_refused():
    with pytest.raises(ValueError, match="at least one frame"):
        cic(th.zeros(0, 3), th.zeros(0, 3, 2))


def test_uniform_cic_refuses_other_shapes():
    with pytest.raises(ValueError, match=r"shape \(2, 3\): expected \(frames, messages, actions\)"):
        uniform_cic(th.zeros(2, 3))


@given(st.integers(0, 2**31), st.integers(2, 5), st.integers(2, 4))
def test_the_expected_influence_of_the_guides_messages_is_cic(seed, n_messages, n_actions):
    generator = th.Generator().manual_seed(seed)
    message = th.randn(3, n_messages, generator=generator).log_softmax(-1)
    action = th.randn(3, n_messages, n_actions, generator=generator).log_softmax(-1)
    each = [influence(th.full((3,), heard), message, action) for heard in range(n_messages)]
    assert th.allclose((message.exp() * th.stack(each, dim=1)).sum(dim=1), cic(message, action), atol=1e-5)


def test_the_published_code_is_log_of_the_messages_too_high():
    assert cic_as_published(UNIFORM, OBEYS).item() == pytest.approx(2 * math.log(3))


def test_a_tempered_guide_has_the_entropy_that_was_asked_for_and_the_same_preferences():
    sure = (th.randn(50, 9, generator=th.Generator().manual_seed(0)) * 20).log_softmax(-1)
    softer = tempered(sure, entropy=1.0)
    assert message_entropy(softer).mean().item() == pytest.approx(1.0, abs=1e-3)
    assert softer.exp().sum(dim=1).tolist() == pytest.approx([1.0] * 50)
    assert th.equal(softer.argsort(dim=1), sure.argsort(dim=1))


def test_tempering_by_hand():
    # odds of 16 to 1 at temperature 1 are odds of 4 to 1 at temperature 2
    sixteen = th.tensor([[16 / 17, 1 / 17]]).log()
    asked = -(0.8 * math.log(0.8) + 0.2 * math.log(0.2))
    assert tempered(sixteen, asked).exp()[0].tolist() == pytest.approx([0.8, 0.2], abs=1e-4)


@pytest.mark.parametrize("entropy", [0, -1, math.log(3), 5])
def test_no_messages_have_such_an_entropy(entropy):
    with pytest.raises(ValueError, match=r"expected a number of nats above 0 and below 1\.10"):
        tempered(UNIFORM, entropy)
