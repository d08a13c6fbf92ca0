"""The channel."""

import pytest
import torch as th

from sb3_guide.policies.channel import MessageDecoder, MessageEncoder, MessageShape

SHAPE = MessageShape(length=2, vocabulary_size=3)
NUMBERS = MessageShape(length=2, vocabulary_size=3, channel="continuous")


@pytest.fixture
def decoder() -> MessageDecoder:
    th.manual_seed(0)
    decoder = MessageDecoder(memory=8, symbol=4, shape=SHAPE)
    th.nn.init.normal_(decoder.logits.weight)
    th.nn.init.normal_(decoder.inverse_temperature.weight)
    return decoder


def test_all_messages_are_equally_probable_at_first():
    assert MessageDecoder(8, 4, SHAPE).log_probs(th.randn(5, 8)).exp().flatten().tolist() == pytest.approx([1 / 9] * 45)


def test_messages_are_enumerated_in_the_order_of_their_index():
    assert SHAPE.names() == ["w0 w0", "w0 w1", "w0 w2", "w1 w0", "w1 w1", "w1 w2", "w2 w0", "w2 w1", "w2 w2"]
    assert SHAPE.index(SHAPE.all()).tolist() == list(range(9))


@pytest.mark.parametrize(("length", "vocabulary_size"), [(1, 2), (3, 2), (1, 5)])
def test_other_shapes(length, vocabulary_size):
    shape = MessageShape(length, vocabulary_size)
    decoder, encoder = MessageDecoder(8, 4, shape), MessageEncoder(4, 6, shape)
    memory = th.randn(5, 8)
    assert decoder(memory).shape == (5, length, vocabulary_size)
    assert decoder.log_probs(memory).exp().sum(dim=1).tolist() == pytest.approx([1.0] * 5)
    assert encoder(decoder(memory)).shape == (5, 6)
    assert encoder.all().shape == (vocabulary_size**length, 6)


@pytest.mark.parametrize("generator", [None, th.Generator()])
def test_messages_are_one_hot_and_let_gradients_through(decoder, generator):
    memory = th.randn(4, 8, requires_grad=True)
    symbols = decoder(memory, generator)
    assert symbols.detach().sum(dim=-1).flatten().tolist() == pytest.approx([1.0] * 8)
    assert symbols.detach().max(dim=-1).values.flatten().tolist() == pytest.approx([1.0] * 8)
    (symbols * th.randn(3)).sum().backward()
    assert memory.grad is not None
    assert memory.grad.abs().sum() > 0
    assert decoder.inverse_temperature.weight.grad.abs().sum() > 0  # the temperature is learned


def test_without_a_generator_the_most_probable_symbols_are_sent(decoder):
    memory = th.randn(50, 8)
    w0 = th.tensor([1.0, 0.0, 0.0]).expand(50, 3)  # which stands before the first symbol
    logits = decoder.logits(decoder.cell(decoder.embedding(w0), memory))
    assert decoder(memory)[:, 0].argmax(dim=-1).tolist() == logits.argmax(dim=-1).tolist()


def test_sampled_messages_follow_the_log_probs(decoder):
    memory = th.randn(1, 8)
    sent = decoder(memory.expand(20_000, 8), th.Generator().manual_seed(1)).argmax(dim=-1)
    frequency = SHAPE.index(sent).bincount(minlength=9) / 20_000
    assert frequency.tolist() == pytest.approx(decoder.log_probs(memory)[0].exp().tolist(), abs=0.015)


def test_sampling_is_a_function_of_the_generator(decoder):
    memory = th.randn(100, 8)
    first, same, other = (decoder(memory, th.Generator().manual_seed(seed)) for seed in (1, 1, 2))
    assert th.equal(first, same)
    assert not th.equal(first, other)


def test_the_encoder_is_torchs_gru_over_embedded_symbols(decoder):
    encoder, symbols = MessageEncoder(4, 6, SHAPE), decoder(th.randn(50, 8), th.Generator().manual_seed(0))
    expected = encoder.gru(encoder.embedding(symbols))[1].squeeze(0)
    th.testing.assert_close(encoder(symbols), expected)


@pytest.mark.parametrize(("length", "vocabulary_size"), [(0, 3), (2, 1)])
def test_a_channel_needs_symbols(length, vocabulary_size):
    with pytest.raises(ValueError, match=f"message_length={length} and vocabulary_size={vocabulary_size} make no channel"):
        MessageShape(length, vocabulary_size)


def test_too_many_messages_are_not_enumerated():
    with pytest.raises(ValueError, match=r"3\^7 = 2187 messages are too many.*at most 1024"):
        MessageShape(7, 3).all()


def test_a_continuous_message_is_as_wide_and_has_no_noise():
    decoder, encoder, memory = MessageDecoder(8, 4, NUMBERS), MessageEncoder(4, 6, NUMBERS), th.randn(5, 8)
    message = decoder(memory)
    assert message.shape == (5, 2, 3)
    assert th.equal(message, decoder(memory, th.Generator()))
    assert len(message.unique(dim=0)) == 5
    assert encoder(message).shape == (5, 6)


def test_a_continuous_channel_has_the_gradients_of_its_numbers():
    decoder, encoder = MessageDecoder(8, 4, NUMBERS).double(), MessageEncoder(4, 6, NUMBERS).double()
    memory = th.randn(3, 8, dtype=th.double, requires_grad=True)
    assert th.autograd.gradcheck(lambda memory: encoder(decoder(memory)), memory)
    encoder(decoder(memory)).sum().backward()
    assert all(weight.grad is not None and weight.grad.abs().sum() > 0 for weight in decoder.parameters())


@pytest.mark.parametrize(
    "ask",
    [
        lambda: NUMBERS.count,
        NUMBERS.all,
        NUMBERS.names,
        lambda: MessageDecoder(8, 4, NUMBERS).log_probs(th.randn(5, 8)),
        MessageEncoder(4, 6, NUMBERS).all,
    ],
)
def test_numbers_are_not_enumerated(ask):
    with pytest.raises(ValueError, match=r"continuous channel are not made of symbols.*: expected .*channel=\"discrete\""):
        ask()


def test_an_unknown_channel():
    with pytest.raises(ValueError, match="channel='analog' is unknown: expected one of discrete, continuous"):
        MessageShape(channel="analog")
