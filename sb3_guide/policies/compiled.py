"""
A few worlds' frames on their way through an agent's network, compiled: cells, words, memory and messages, without gradients.

One step of one world takes hundreds of torch's operators, each of which costs more than its arithmetic. This is the arithmetic
of film.py, memory.py and channel.py in a few calls, equal up to the order of sums (tests/policies/test_compiled.py). It reads
the weights where torch keeps them, so it needs no telling when they change.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

import numpy as np
import torch as th
from numba import njit
from torch import nn
from torch.nn.modules.module import _global_forward_hooks, _global_forward_pre_hooks
from torch.nn.utils.parametrize import is_parametrized

from sb3_guide.policies.film import CompactVision, FiLMExtractor

Array: TypeAlias = np.ndarray

FEW_WORLDS = 8  # of more worlds torch is faster, as it computes them together
FEW_MESSAGES = 64  # likewise, of messages that are read
EPSILON = 1e-5  # of layer normalisation, as torch has it
# Sums may be reordered, which makes them several times as fast
OPTIONS: dict[str, Any] = {"nogil": True, "cache": True, "fastmath": {"reassoc", "contract", "nsz"}, "error_model": "numpy"}


class Linear(NamedTuple):
    """
    Weights of a linear layer, or of what either the input or the hidden state adds to the gates.

    :param weight: (out, in)
    :param bias: (out,)
    """

    weight: Array
    bias: Array


class Weights(NamedTuple):
    """
    Weights of a trunk, float32.

    :param words: (vocabulary, word) embedding
    :param read_word: what a word adds to the instruction GRU's gates: reset, update, new
    :param read_hidden: what its hidden state adds
    :param parts: for each channel of a cell (values, cell), its embedding
    :param kinds: (kinds, cell) embedding of all channels together
    :param gammas: of the three modulations: of cells, of cells again, of the view
    :param betas: the same
    :param mix: between the two modulations of cells
    :param convolution: over the whole view
    :param out: the features
    :param remember_input: what the features add to the LSTM's gates: input, forget, new, output
    :param remember_hidden: what its hidden state adds
    """

    words: Array
    read_word: Linear
    read_hidden: Linear
    parts: tuple[Array, ...]
    kinds: Array
    gammas: tuple[Linear, Linear, Linear]
    betas: tuple[Linear, Linear, Linear]
    mix: Linear
    convolution: Linear
    out: Linear
    remember_input: Linear
    remember_hidden: Linear


@njit(inline="always")
def sigmoid(x: np.float32) -> np.float32:
    """:return: of one number"""
    return np.float32(1.0) / (np.float32(1.0) + np.float32(math.exp(-x)))


@njit(**OPTIONS)
def apply(layer: Linear, x: Array, out: Array) -> None:
    """Write the layer's output for one input."""
    for row in range(len(out)):
        total = np.float32(0.0)
        for column in range(len(x)):
            total += layer.weight[row, column] * x[column]
        out[row] = total + layer.bias[row]


@njit(**OPTIONS)
def gru_step(layer: Linear, of_input: Array, before: Array, after: Array) -> None:
    """
    Write the hidden state after a step of a GRU.

    :param layer: of its hidden state
    :param of_input: (3 * hidden,) what the input adds to the gates: reset, update, new
    :param before: (hidden,)
    :param after: (hidden,), may be the same array
    """
    size = len(before)
    of_hidden = np.empty(3 * size, np.float32)
    apply(layer, before, of_hidden)
    for unit in range(size):
        reset = sigmoid(of_input[unit] + of_hidden[unit])
        update = sigmoid(of_input[size + unit] + of_hidden[size + unit])
        new = np.float32(math.tanh(of_input[2 * size + unit] + reset * of_hidden[2 * size + unit]))
        after[unit] = new + update * (before[unit] - new)


@njit(**OPTIONS)
def read_mission(weights: Weights, mission: Array) -> Array:
    """:return: (instruction,) the GRU's hidden state after the last word; padding is skipped, but for a first word"""
    hidden = np.zeros(weights.read_hidden.weight.shape[1], np.float32)
    of_word = np.empty(3 * len(hidden), np.float32)
    for place in range(len(mission)):
        if place == 0 or mission[place] != 0:
            apply(weights.read_word, weights.words[mission[place]], of_word)
            gru_step(weights.read_hidden, of_word, hidden, hidden)
    return hidden


@njit(**OPTIONS)
def modulation(layer: Linear, instruction: Array) -> Array:
    """:return: (channels,) factors or summands of a FiLM layer"""
    found = np.empty(len(layer.bias), np.float32)
    apply(layer, instruction, found)
    return found


@njit(**OPTIONS)
def normalise(x: Array) -> None:
    """Layer normalisation, in place."""
    mean, square = np.float32(0.0), np.float32(0.0)
    for value in x:
        mean += value
    mean /= np.float32(len(x))
    for value in x:
        square += (value - mean) * (value - mean)
    scale = np.float32(1.0) / np.float32(math.sqrt(square / np.float32(len(x)) + np.float32(EPSILON)))
    for place in range(len(x)):
        x[place] = (x[place] - mean) * scale


@njit(**OPTIONS)
def film(gamma: Array, beta: Array, x: Array) -> None:
    """Modulate and rectify, in place."""
    for channel in range(len(x)):
        value = beta[channel] + gamma[channel] * x[channel]
        x[channel] = np.float32(0.0) if value < 0.0 else value  # NaN stays NaN


@njit(**OPTIONS)
def see(weights: Weights, images: Array, instruction: Array) -> Array:
    """
    :param images: (T, cells, channels) of one world
    :param instruction: (instruction,)
    :return: (T, image) features
    """
    steps, n_cells, channels = images.shape
    gammas = [modulation(layer, instruction) for layer in weights.gammas]
    betas = [modulation(layer, instruction) for layer in weights.betas]
    width = len(weights.mix.bias)
    known = np.zeros(len(weights.kinds), np.bool_)
    table = np.empty((len(weights.kinds), width), np.float32)  # each kind that occurs, modulated once
    cell = np.empty(weights.kinds.shape[1], np.float32)
    views = np.empty((steps, n_cells * width), np.float32)
    for step in range(steps):
        for place in range(n_cells):
            kind = 0
            for channel in range(channels):
                kind = kind * len(weights.parts[channel]) + images[step, place, channel]
            if not known[kind]:
                known[kind] = True
                for unit in range(len(cell)):
                    cell[unit] = weights.kinds[kind, unit]
                for channel in range(channels):
                    part = weights.parts[channel][images[step, place, channel]]
                    for unit in range(len(cell)):
                        cell[unit] += part[unit]
                film(gammas[0], betas[0], cell)
                apply(weights.mix, cell, table[kind])
                film(gammas[1], betas[1], table[kind])
            for unit in range(width):
                views[step, place * width + unit] = table[kind, unit]
    convolved = np.empty((steps, len(weights.convolution.bias)), np.float32)
    for row in range(convolved.shape[1]):  # its large weight is read once for all steps
        for step in range(steps):
            total = np.float32(0.0)
            for column in range(views.shape[1]):
                total += weights.convolution.weight[row, column] * views[step, column]
            convolved[step, row] = total + weights.convolution.bias[row]
    features = np.empty((steps, len(weights.out.bias)), np.float32)
    for step in range(steps):
        normalise(convolved[step])
        film(gammas[2], betas[2], convolved[step])
        apply(weights.out, convolved[step], features[step])
        normalise(features[step])
    return features


@njit(**OPTIONS)
def remember(weights: Weights, features: Array, h: Array, c: Array) -> None:
    """
    Step the LSTM through the features (T, image) of one world; its state h and c, (hidden,) each, is changed in place.
    """
    size = len(h)
    of_input, of_hidden = np.empty(4 * size, np.float32), np.empty(4 * size, np.float32)
    for step in range(len(features)):
        apply(weights.remember_input, features[step], of_input)
        apply(weights.remember_hidden, h, of_hidden)
        for unit in range(size):
            put = sigmoid(of_input[unit] + of_hidden[unit])
            keep = sigmoid(of_input[size + unit] + of_hidden[size + unit])
            new = np.float32(math.tanh(of_input[2 * size + unit] + of_hidden[2 * size + unit]))
            show = sigmoid(of_input[3 * size + unit] + of_hidden[3 * size + unit])
            c[unit] = keep * c[unit] + put * new
            h[unit] = show * np.float32(math.tanh(c[unit]))


@njit(**OPTIONS)
def known_values(weights: Weights, images: Array, missions: Array) -> bool:
    """:return: whether every cell and every word has an embedding"""
    for cell in images.reshape(-1, images.shape[-1]):
        for channel in range(len(cell)):
            if cell[channel] >= len(weights.parts[channel]):
                return False
    return missions.max() < len(weights.words)


@njit(**OPTIONS)
def run(weights: Weights, images: Array, missions: Array, h: Array, c: Array) -> bool:
    """
    :param images: (B, T, cells, channels) uint8; blank ones before the first that is not are left out, but for the last
    :param missions: (B, words) uint8
    :param h: (B, hidden) before the first frame, and after the last
    :param c: the same
    :return: False, and nothing is done, if there are cells or words without embedding
    """
    if not known_values(weights, images, missions):
        return False
    for world in range(len(images)):
        first = 0
        while first < images.shape[1] - 1 and not images[world, first].any():
            first += 1
        features = see(weights, images[world, first:], read_mission(weights, missions[world]))
        remember(weights, features, h[world], c[world])
    return True


class Symbols(NamedTuple):
    """
    Weights of a GRU over symbols: of a message's decoder, or of its encoder.

    :param embedding: (symbol, vocabulary)
    :param of_symbol: what a symbol adds to the GRU's gates
    :param of_hidden: what its hidden state adds
    """

    embedding: Array
    of_symbol: Linear
    of_hidden: Linear


@njit(**OPTIONS)
def symbol_gates(weights: Symbols) -> Array:
    """:return: (vocabulary, 3 * hidden) what each symbol adds to the gates"""
    embedded = weights.embedding.T.copy()
    gates = np.empty((len(embedded), len(weights.of_symbol.bias)), np.float32)
    for symbol in range(len(gates)):
        apply(weights.of_symbol, embedded[symbol], gates[symbol])
    return gates


@njit(**OPTIONS)
def mixed(symbol: Array, gates: Array, out: Array) -> None:
    """Write what a symbol (vocabulary,) adds to the gates: one-hot, or numbers of a continuous channel."""
    out[:] = 0.0
    for each in range(len(symbol)):
        for gate in range(len(out)):
            out[gate] += symbol[each] * gates[each, gate]


@njit(**OPTIONS)
def say(weights: Symbols, logits: Linear, memory: Array, length: int, continuous: bool) -> Array:
    """
    :param logits: of the symbols
    :param memory: (B, hidden)
    :return: (B, length, vocabulary) the most probable symbols, one-hot; or, in a continuous channel, their logits
    """
    gates, hidden = symbol_gates(weights), memory.copy()
    said = np.empty((len(memory), length, len(gates)), np.float32)
    before = np.empty(gates.shape[1], np.float32)
    for world in range(len(memory)):
        before[:] = gates[0]  # w0 stands before the first
        for place in range(length):
            symbol = said[world, place]
            gru_step(weights.of_hidden, before, hidden[world], hidden[world])
            apply(logits, hidden[world], symbol)
            if not continuous and not np.isnan(symbol).any():
                best = symbol.argmax()
                symbol[:] = 0.0
                symbol[best] = 1.0
            mixed(symbol, gates, before)
    return said


@njit(**OPTIONS)
def log_probs(weights: Symbols, logits: Linear, memory: Array, length: int) -> Array:
    """
    :param logits: of the symbols
    :param memory: (B, hidden)
    :return: (B, M) log-probability of every message; beginnings in common are computed once
    """
    gates, vocabulary = symbol_gates(weights), len(weights.embedding[0])
    found = np.zeros((len(memory), vocabulary**length), np.float32)
    row = np.empty(vocabulary, np.float32)
    for world in range(len(memory)):
        total, hidden = np.zeros(1, np.float32), memory[world : world + 1]
        for place in range(length):
            longer = np.empty(len(total) * vocabulary, np.float32)
            after = np.empty((len(total), memory.shape[1]), np.float32)
            for beginning in range(len(total)):
                last, parent = (beginning % vocabulary, beginning // vocabulary) if place else (0, 0)
                gru_step(weights.of_hidden, gates[last], hidden[parent], after[beginning])
                apply(logits, after[beginning], row)
                highest, summed = row.max(), np.float32(0.0)
                for symbol in range(vocabulary):
                    summed += np.float32(math.exp(row[symbol] - highest))
                norm = highest + np.float32(math.log(summed))
                for symbol in range(vocabulary):
                    longer[beginning * vocabulary + symbol] = total[beginning] + row[symbol] - norm
            total, hidden = longer, after
        found[world] = total
    return found


@njit(**OPTIONS)
def hear(weights: Symbols, symbols: Array) -> Array:
    """
    :param symbols: (K, length, vocabulary)
    :return: (K, hidden) the encoding of each message
    """
    gates = symbol_gates(weights)
    hidden = np.zeros((len(symbols), weights.of_hidden.weight.shape[1]), np.float32)
    of_symbol = np.empty(gates.shape[1], np.float32)
    for message in range(len(symbols)):
        for place in range(symbols.shape[1]):
            mixed(symbols[message, place], gates, of_symbol)
            gru_step(weights.of_hidden, of_symbol, hidden[message], hidden[message])
    return hidden


T = TypeVar("T")


class Views(Generic[T]):
    """
    Views of modules' weights, which show every change in place. Each call looks whether they still are the modules' own.
    Copies of a module begin with none.
    """

    def __init__(self) -> None:
        self._kept: tuple[Any, T | None] = (None, None)

    def __deepcopy__(self, memo: Any) -> "Views[T]":
        return Views()

    def __reduce__(self) -> tuple[type, tuple[()]]:
        return Views, ()

    def get(self, build: Callable[..., T | None], *modules: nn.Module) -> T | None:
        """
        :param build: makes the views from the modules, None where it can't
        :param modules: whose weights they are
        :return: the views; None where torch has to compute, as a weight is not one of the CPU's, 32 bits wide and
            contiguous, or somebody has hooked in
        """
        places = places_of(modules)
        if places is None or _global_forward_hooks or _global_forward_pre_hooks:
            return None
        if self._kept[0] != places:
            self._kept = places, build(*modules) if all(map(are_plain, modules)) else None
        return self._kept[1]


def places_of(modules: Sequence[nn.Module]) -> list[Any] | None:
    """
    What tells whether views are still those of the modules' weights. Walks through the modules by itself, as ``parameters()``
    takes ten times as long.

    :return: every module, and the address and contiguity of its weights; None if one has hooks, so that it has to be called
    """
    places: list[Any] = []
    left = list(modules)
    while left:
        module = left.pop()
        if module._forward_hooks or module._forward_pre_hooks:
            return None
        places.append(id(module))
        places += [(weight.data_ptr(), weight.is_contiguous()) for weight in module._parameters.values() if weight is not None]
        left += module._modules.values()  # type: ignore[arg-type]
    return places


def are_plain(module: nn.Module) -> bool:
    """:return: whether all weights are 32 bits wide, contiguous and on the CPU, and none is computed from others"""
    plain = all(
        weight.dtype == th.float32 and weight.device.type == "cpu" and weight.is_contiguous() for weight in module.parameters()
    )
    return plain and not any(map(is_parametrized, module.modules()))


def trunk_weights(film: FiLMExtractor, lstm: nn.LSTM) -> Weights | None:
    """:return: views of a trunk's weights; None where it looks at images in another way"""
    vision = film.vision
    if type(vision) is not CompactVision or vision.whole is None or film.picture.channels_first:
        return None
    films = (vision.film_cells, vision.film_mixed, vision.film_view)
    layers = [vision.mix, vision.convolution, vision.out, *(half for each in films for half in (each.gamma, each.beta))]
    ours = all(type(layer) is nn.Linear and layer.bias is not None and "forward" not in vars(layer) for layer in layers)
    norm = vision.normalise
    if not (ours and type(norm) is nn.LayerNorm and not norm.elementwise_affine and norm.eps == EPSILON):
        return None  # somebody has put modules of their own there
    read_word, read_hidden = halves(film.instruction.gru)
    remember_input, remember_hidden = halves(lstm)
    return Weights(
        words=view(film.instruction.embedding.weight),
        read_word=read_word,
        read_hidden=read_hidden,
        parts=tuple(view(part.weight) for part in vision.parts),  # type: ignore[arg-type]
        kinds=view(vision.whole.weight),  # type: ignore[arg-type]
        gammas=tuple(linear(each.gamma) for each in films),  # type: ignore[arg-type]  # three of them
        betas=tuple(linear(each.beta) for each in films),  # type: ignore[arg-type]
        mix=linear(vision.mix),
        convolution=linear(vision.convolution),
        out=linear(vision.out),
        remember_input=remember_input,
        remember_hidden=remember_hidden,
    )


def symbol_weights(embedding: Any, gru: nn.GRU | nn.GRUCell) -> Symbols:
    """:return: views of the weights of a message's decoder or encoder"""
    return Symbols(view(embedding.weight), *halves(gru))


def halves(recurrent: nn.RNNBase | nn.RNNCellBase) -> tuple[Linear, Linear]:
    """:return: what its input and what its hidden state add to the gates"""
    input_weight, weight, input_bias, bias = map(view, recurrent.parameters())
    return Linear(input_weight, input_bias), Linear(weight, bias)


def linear(layer: Any) -> Linear:
    """:return: views of its weights"""
    return Linear(view(layer.weight), view(layer.bias))


def view(weight: th.Tensor) -> Array:
    """:return: the weight, whose memory it shares"""
    return weight.detach().numpy()


def remember_few(
    views: Views[Weights],
    film: FiLMExtractor,
    lstm: nn.LSTM,
    images: th.Tensor,
    missions: th.Tensor,
    state: tuple[th.Tensor, th.Tensor] | None = None,
) -> tuple[th.Tensor, th.Tensor] | None:
    """
    :param views: of the trunk's weights
    :param film: from cells and words to features
    :param lstm: from features to the memory
    :param images: (B, T, height, width, channels)
    :param missions: (B, words)
    :param state: (h, c) before, each (1, B, hidden); None where nothing was seen yet
    :return: h and c after the last frame, each (B, hidden); None where torch has to compute them
    """
    if not (is_few(images, th.uint8) and is_few(missions, th.uint8)):
        return None
    weights = views.get(trunk_weights, film, lstm)
    form = (film.picture.height, film.picture.width, film.picture.channels)
    if weights is None or images.shape[2:] != form or len(missions) != len(images):
        return None
    size = weights.remember_hidden.weight.shape[1]
    if state is not None and any(part.shape != (1, len(images), size) or part.dtype != th.float32 for part in state):
        return None
    h, c = np.zeros((2, len(images), size), np.float32) if state is None else (part[0].numpy().copy() for part in state)
    if not run(weights, images.flatten(2, 3).numpy(), missions.numpy(), h, c):
        return None  # so that torch's way says what is wrong
    return th.from_numpy(h), th.from_numpy(c)


def is_few(part: th.Tensor, dtype: th.dtype, most: int = FEW_WORLDS) -> bool:
    """
    :param part: (B, ...)
    :param dtype: that it is to have
    :param most: rows
    :return: whether compiled code may compute with it: it has few rows, is on the CPU and contiguous; and gradients are off,
        as are tracing, torch.compile and autocast
    """
    if type(part) is not th.Tensor or part.dtype != dtype or len(part) > most or part.device.type != "cpu":
        return False
    recorded = th.jit.is_tracing() or th.compiler.is_compiling() or th.is_autocast_enabled("cpu")
    return part.is_contiguous() and not (th.is_grad_enabled() or recorded)
