"""Observation and instruction become one vector: instruction GRU, convolution, FiLM (Perez et al. 2018)."""

import math

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.preprocessing import is_image_space
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from sb3_guide.policies.gru import input_gates, next_hidden
from sb3_guide.policies.picture import Picture, check_values, picture_of, words_of
from sb3_guide.policies.products import transform, transform_looked_up
from sb3_guide.policies.rows import is_plain, number_cells
from sb3_guide.policies.sequences import Observations, Sequences, distinct, frames
from sb3_guide.policies.short_sequences import WordsGRU
from sb3_guide.policies.sizes import Size, size_of

KINDS = 4096  # of cells, up to which each that there may be has an embedding of its own
CELLS = "cells of images"  # to name them in an error
SMALLEST = 8  # pixels on a side, to which convolutions reduce pictures
PIXEL_CHANNELS = (16, 32)  # after the first convolution, and after all others
PICTURES_AT_ONCE = 1024  # bounds the memory that whole sets of episodes take
FEW_WORDS = 2048  # in missions, up to which reading them all at once costs less than reading each beginning once


class InstructionEncoder(nn.Module):
    """
    Embedding and GRU over a mission's words: the hidden state after its last word.

    :param vocabulary_size: number of word ids, 0 being padding
    :param size: widths
    """

    def __init__(self, vocabulary_size: int, size: Size) -> None:
        super().__init__()
        self.embedding = nn.Embedding(vocabulary_size, size.word, padding_idx=0)
        self.gru = nn.GRU(size.word, size.instruction, batch_first=True)

    def forward(self, missions: th.Tensor) -> th.Tensor:
        """
        :param missions: (N, words) word ids
        :return: (N, instruction)
        """
        words, missions = missions.unique(return_inverse=True)  # those that occur, and each as the number of one of them
        gates, is_word = input_gates(self.embedding(words), self.gru), (words > 0)[missions]
        columns = is_word.any(dim=0).nonzero()
        longest = int(columns[-1]) + 1 if len(columns) else 1
        if len(missions) * longest > FEW_WORDS:
            return self._by_beginnings(words, missions[:, :longest], gates)
        is_word[:, 0] = True  # an empty mission is read as one word of padding
        _, weight, _, bias = self.gru.parameters()
        said = gates[missions[:, :longest].t()]  # (longest, N, 3 * instruction)
        hidden: th.Tensor = WordsGRU.apply(said, is_word[:, :longest].t().unsqueeze(2), weight, bias)
        return hidden

    def _by_beginnings(self, words: th.Tensor, missions: th.Tensor, gates: th.Tensor) -> th.Tensor:
        """
        Many missions begin alike, so each beginning is read once.

        :param words: (W,) that occur
        :param missions: (N, L) numbers of words
        :param gates: (W, 3 * instruction) what each word adds to the gates
        :return: (N, instruction)
        """
        hidden, beginning = gates.new_zeros(1, self.gru.hidden_size), missions.new_zeros(len(missions))
        for step, word in enumerate(missions.t()):
            beginnings, beginning = (beginning * len(words) + word).unique(return_inverse=True)
            before, last = hidden[beginnings // len(words)], beginnings % len(words)
            after = next_hidden(gates[last], before, self.gru)
            hidden = after if step == 0 else th.where((words[last] > 0).unsqueeze(1), after, before)
        return hidden[beginning]


class FiLM(nn.Module):
    """
    Feature-wise linear modulation: channel c of the features becomes gamma_c(y) * x_c + beta_c(y).

    :param condition_dim: width of y
    :param channels: number of channels of x, its last dimension
    """

    def __init__(self, condition_dim: int, channels: int) -> None:
        super().__init__()
        self.gamma = nn.Linear(condition_dim, channels)
        self.beta = nn.Linear(condition_dim, channels)
        nn.init.ones_(self.gamma.bias)  # features pass as they are at first, unless SB3's orthogonal initialisation follows

    def forward(self, x: th.Tensor, y: th.Tensor, row: th.Tensor) -> th.Tensor:
        """
        :param x: (N, ..., channels)
        :param y: (M, condition_dim)
        :param row: (N,) which y modulates each x
        """
        shape = (len(x), *[1] * (x.dim() - 2), -1)
        return th.addcmul(self.beta(y)[row].view(shape), self.gamma(y)[row].view(shape), x)

    def all_pairs(self, x: th.Tensor, y: th.Tensor) -> th.Tensor:
        """
        :param x: (U, channels), or (M, U, channels)
        :param y: (M, condition_dim)
        :return: (M, U, channels), every x modulated by every y, or by its own
        """
        return th.addcmul(self.beta(y).unsqueeze(1), self.gamma(y).unsqueeze(1), x)


class Vision(nn.Module):
    """
    One convolution over a whole view of features, FiLM. Layer normalisation bounds what FiLM and memory get: without it, a
    step of Adam on a kernel of this size saturates the memory for good.
    """

    def _look(self, features: int, size: Size) -> None:
        """
        :param features: of an image, all of its places together
        :param size: widths
        """
        self.convolution = nn.Linear(features, size.image)  # the kernel is as large as the view
        self.normalise = nn.LayerNorm(size.image, elementwise_affine=False)
        self.film_view = FiLM(size.instruction, size.image)
        self.out = nn.Linear(size.image, size.image)

    def numbered(self, images: th.Tensor) -> th.Tensor:
        """
        :param images: (N, height, width, channels)
        :return: (N, height, width) the number of each cell's kind; the images as they are where kinds have no numbers
        :raises ValueError: if a cell has a value outside the observation space
        """
        return images

    def forward(self, images: th.Tensor, instructions: th.Tensor, row: th.Tensor) -> th.Tensor:
        """
        :param images: (N, height, width, channels), or as :meth:`numbered` returns them
        :param instructions: (M, instruction)
        :param row: (N,) which instruction belongs to each image
        :return: (N, image)
        """
        view = self.film_view(self.normalise(self.whole_view(images, instructions, row)), instructions, row).relu()
        return self.normalise(transform(view, self.out.weight, self.out.bias))

    def whole_view(self, images: th.Tensor, instructions: th.Tensor, row: th.Tensor) -> th.Tensor:
        """:return: (N, image) the convolution over all features of every image"""
        raise NotImplementedError


class CompactVision(Vision):
    """
    An embedding for each cell, FiLM twice, one convolution over the whole view, FiLM: what two CPU cores train well. A cell is
    embedded as the sum of its channels, such as type, colour and state, which is how missions speak of it, and, where there
    are not too many kinds, of all of them together. It takes two layers to tell that a cell is of the type and of the colour
    that the mission names.

    :param size: widths
    :param picture: form of the images
    """

    place_value: th.Tensor  # (channels,) of each in the number of a cell
    base: th.Tensor  # (channels,) how many values each has

    def __init__(self, size: Size, picture: Picture) -> None:
        super().__init__()
        self.values = values = cells_of(picture)
        kinds = math.prod(values)
        self.parts = nn.ModuleList(nn.Embedding(count, size.cell) for count in values)
        self.whole = nn.Embedding(kinds, size.cell) if kinds <= KINDS else None
        self.film_cells = FiLM(size.instruction, size.cell)
        self.mix = nn.Linear(size.cell, size.view)
        self.film_mixed = FiLM(size.instruction, size.view)
        self._look(picture.height * picture.width * size.view, size)
        if self.whole is not None:
            place_value = [math.prod(values[channel + 1 :]) for channel in range(len(values))]
            self.register_buffer("place_value", th.tensor(place_value), persistent=False)
            self.register_buffer("base", th.tensor(values), persistent=False)

    def numbered(self, images: th.Tensor) -> th.Tensor:
        if self.whole is None:
            check_values(CELLS, images, self.values)
            return images
        readable = is_plain(images) and images.dtype in (th.uint8, th.float32) and images.shape[-1] == len(self.values)
        if not readable:
            check_values(CELLS, images, self.values)
            return (images.long() * self.place_value).sum(dim=-1)
        numbers = images.new_empty(images.shape[:-1], dtype=th.long)
        if not number_cells(images.flatten(0, -2).numpy(), np.array(self.values), numbers.flatten().numpy()):
            check_values(CELLS, images, self.values)  # which says what is wrong
        return numbers

    def whole_view(self, images: th.Tensor, instructions: th.Tensor, row: th.Tensor) -> th.Tensor:
        weight, bias = self.convolution.weight, self.convolution.bias
        if self.whole is None:
            cells = images.flatten(1, 2).long()  # (N, cells, channels)
            return transform(self.modulated_each(cells, instructions, row).flatten(1), weight, bias)
        return transform_looked_up(*self.modulated_kinds(images.flatten(1), instructions, row), weight, bias)

    def modulated_kinds(self, cells: th.Tensor, instructions: th.Tensor, row: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
        """
        Few kinds of cells occur, so each is modulated once by each instruction, to be looked up after that.

        :param cells: (N, cells) the channels of each as one number
        :return: a table of modulated cells (R, view), and which of its rows each cell of each image is (N, cells)
        """
        assert self.whole is not None
        occurs = th.zeros(self.whole.num_embeddings, dtype=th.bool, device=cells.device)
        occurs[cells.flatten()] = True
        kinds = occurs.nonzero().squeeze(1)  # (U,)
        embedded = self.whole(kinds) + self.embed(kinds.unsqueeze(1) // self.place_value % self.base)
        cell = self.film_cells.all_pairs(embedded, instructions).relu_()  # (M, U, cell)
        table = self.film_mixed.all_pairs(self.mix(cell), instructions).relu_()  # (M, U, view)
        return table.flatten(0, 1), row.unsqueeze(1) * len(kinds) + (occurs.cumsum(0) - 1)[cells]

    def modulated_each(self, cells: th.Tensor, instructions: th.Tensor, row: th.Tensor) -> th.Tensor:
        """
        Nearly every cell may be of a kind of its own.

        :param cells: (N, cells, channels)
        :return: (N, cells, view)
        """
        cell = self.film_cells(self.embed(cells), instructions, row).relu_()
        return self.film_mixed(self.mix(cell), instructions, row).relu_()

    def embed(self, cells: th.Tensor) -> th.Tensor:
        """
        :param cells: (..., channels)
        :return: (..., cell) the sum of the channels' embeddings
        """
        return sum(part(value) for part, value in zip(self.parts, cells.unbind(dim=-1), strict=True))  # type: ignore[return-value]


class PixelVision(Vision):
    """
    Convolutions that halve a picture until it is small, FiLM, one convolution over all that is left, FiLM.

    :param size: widths
    :param picture: form of the images
    """

    def __init__(self, size: Size, picture: Picture) -> None:
        super().__init__()
        self.scale = picture.scale
        layers: list[nn.Module] = []
        height, width, channels = picture.height, picture.width, picture.channels
        while not layers or max(height, width) > SMALLEST:
            out = PIXEL_CHANNELS[min(len(layers), 1)]
            layers += [nn.Conv2d(channels, out, 3, stride=2, padding=1), nn.ReLU()]
            height, width, channels = (height + 1) // 2, (width + 1) // 2, out
        self.stem = nn.Sequential(*layers[:-1])
        self.film_stem = FiLM(size.instruction, channels)
        self._look(height * width * channels, size)

    def whole_view(self, images: th.Tensor, instructions: th.Tensor, row: th.Tensor) -> th.Tensor:
        parts = [self.stem(part.movedim(-1, 1).float() / self.scale) for part in images.split(PICTURES_AT_ONCE)]
        features = self.film_stem(th.cat(parts).movedim(1, -1), instructions, row).relu_()  # (N, height, width, channels)
        return transform(features.flatten(1), self.convolution.weight, self.convolution.bias)


class FiLMBlock(nn.Module):
    """
    Two 3x3 convolutions, the second one modulated.

    :param condition_dim: width of the instruction
    :param channels: of the input
    :param out_channels: of the output
    """

    def __init__(self, condition_dim: int, channels: int, out_channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, channels, 3, padding=1)
        self.second = nn.Conv2d(channels, out_channels, 3, padding=1)
        self.film = FiLM(condition_dim, out_channels)

    def forward(self, x: th.Tensor, y: th.Tensor, row: th.Tensor) -> th.Tensor:
        """
        :param x: (N, channels, height, width)
        :param y: (M, condition_dim)
        :param row: (N,) which y modulates each x
        :return: (N, out_channels, height, width)
        """
        x = self.second(self.first(x).relu())
        return self.film(x.movedim(1, -1), y, row).movedim(-1, 1).relu()


class PaperVision(nn.Module):
    """
    The convolutional network with two FiLM blocks of the paper's agents, which is BabyAI's (Chevalier-Boisvert et al. 2019),
    without its batch normalisation: PPO needs the same function while it collects and while it trains.

    :param size: widths
    :param picture: form of the images
    :raises ValueError: if they are too small to be pooled twice
    """

    def __init__(self, size: Size, picture: Picture) -> None:
        super().__init__()
        if min(picture.height, picture.width) < 3:
            raise ValueError(f"size='paper' pools images of {picture.height} x {picture.width} away: expected 3 x 3 and more")
        self.values = cells_of(picture)
        pool = nn.MaxPool2d(2)
        self.stem = nn.Sequential(
            nn.Conv2d(len(self.values), size.cell, 2, padding=1),  # 7x7 -> 8x8
            nn.ReLU(),
            pool,
            nn.Conv2d(size.cell, size.cell, 3, padding=1),  # 4x4
            nn.ReLU(),
            pool,  # 2x2
        )
        widths = ((size.cell, size.view), (size.view, size.image))
        self.blocks = nn.ModuleList(FiLMBlock(size.instruction, *channels) for channels in widths)
        self.pool = nn.AdaptiveMaxPool2d(1)

    def numbered(self, images: th.Tensor) -> th.Tensor:
        """
        :param images: (N, height, width, channels)
        :return: the images as they are
        :raises ValueError: if a cell has a value outside the observation space
        """
        check_values(CELLS, images, self.values)
        return images

    def forward(self, images: th.Tensor, instructions: th.Tensor, row: th.Tensor) -> th.Tensor:
        """
        :param images: (N, height, width, channels)
        :param instructions: (M, instruction)
        :param row: (N,) which instruction belongs to each image
        :return: (N, image)
        """
        x = self.stem(images.float().permute(0, 3, 1, 2))  # (N, cell, 2, 2)
        for block in self.blocks:
            x = block(x, instructions, row)
        return self.pool(x).flatten(1)


def cells_of(picture: Picture) -> tuple[int, ...]:
    """:return: how many values each channel of a cell can take"""
    assert picture.values is not None
    return picture.values


class FiLMExtractor(BaseFeaturesExtractor):
    """
    FiLM-based features extractor for images and missions; works in SB3's ``MultiInputPolicy`` too, where it sees the present
    image only.

    :param observation_space: with "image" and, where there are missions, "mission"
    :param size: "compact", "medium" or "paper" (Table A.2); pixels are looked at in the same way by both
    :param normalize_images: as the policy has it, which divides images of bytes by 255 unless it is False
    :raises ValueError: if there is no image that can be seen
    """

    def __init__(self, observation_space: spaces.Dict, size: str = "compact", normalize_images: bool = True) -> None:
        widths = size_of(size)
        super().__init__(observation_space, features_dim=widths.image)
        self.picture = picture_of(observation_space)
        self.normalised_by_sb3 = normalize_images and is_image_space(observation_space["image"])
        self.instruction = InstructionEncoder(words_of(observation_space), widths)
        vision = PixelVision if self.picture.values is None else PaperVision if size == "paper" else CompactVision
        self.vision = vision(widths, self.picture)

    def forward(self, observations: Observations) -> th.Tensor:
        """
        :param observations: as SB3's policies preprocess them, "image" (N, ...) and "mission" (N, words)
        :return: (N, features_dim)
        """
        if self.normalised_by_sb3:
            observations = {**observations, "image": (observations["image"] * 255).round()}
        features, position = self.encode(frames(observations))
        return features[position]

    def encode(self, sequences: Sequences) -> tuple[th.Tensor, th.Tensor]:
        """
        Encode each distinct mission and each distinct frame, which is an image with a mission, once.

        :param sequences: B sequences of K frames in all
        :return: features of the distinct frames (U, features_dim), and which of them belongs to each frame (K,)
        :raises ValueError: if there are no such words or cells
        """
        images, missions, lengths = sequences
        representatives, kind = distinct(missions)
        instructions = self.instruct(missions[representatives])
        mission_of_image = kind.repeat_interleave(lengths)
        seen = self.vision.numbered(images.movedim(1, -1) if self.picture.channels_first else images)
        looks = seen.flatten(1) if self.picture.values is not None else distinct(bits(images))[1].unsqueeze(1)
        shown, position = distinct(looks, mission_of_image.unsqueeze(1))
        return self.vision(seen[shown], instructions, mission_of_image[shown]), position

    def encode_worlds(self, images: th.Tensor, missions: th.Tensor) -> th.Tensor:
        """
        The same of as many frames in each world.

        :param images: (B, T, ...)
        :param missions: (B, words)
        :return: (B, T, features_dim)
        :raises ValueError: if there are no such words or cells
        """
        lengths = th.full((len(images),), images.shape[1], device=images.device)
        features, position = self.encode(Sequences(images.flatten(0, 1), missions, lengths))
        return features[position].unflatten(0, images.shape[:2])

    def instruct(self, missions: th.Tensor) -> th.Tensor:
        """
        :param missions: (M, words)
        :return: (M, instruction)
        :raises ValueError: if there are no such words
        """
        check_values("missions", missions, (self.instruction.embedding.num_embeddings,))
        instructions: th.Tensor = self.instruction(missions.long())
        return instructions


def bits(images: th.Tensor) -> th.Tensor:
    """:return: (N, D) integers that are equal where images are, whose values may be fractions"""
    return images.flatten(1).float().view(th.int32) if images.is_floating_point() else images.flatten(1)
