"""Observation and instruction become one vector: instruction GRU, convolution, FiLM (Perez et al. 2018)."""

import torch as th
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from sb3_guide.policies.products import transform, transform_looked_up
from sb3_guide.policies.sequences import Observations, Sequences, distinct, frames
from sb3_guide.policies.sizes import Size, size_of

VIEW = 7  # cells on a side of the agent's view
CHANNELS = 3  # type, colour and state of a cell
CELL_VALUES = 11  # values that each of the three can take


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
        :param missions: (N, 72) word ids
        :return: (N, instruction)
        """
        lengths = missions.count_nonzero(dim=1).clamp(min=1)
        output, _ = self.gru(self.embedding(missions[:, : int(lengths.max())]))
        return output[th.arange(len(lengths), device=lengths.device), lengths - 1]


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


class CompactVision(nn.Module):
    """
    An embedding for each cell, FiLM twice, one convolution over the whole view, FiLM: what two CPU cores train well. A cell is
    embedded as the sum of its type, colour and state, which is how missions speak of it, and of the three together. It takes
    two layers to tell that a cell is of the type and of the colour that the mission names. Layer normalisation bounds what
    FiLM and memory get: without it, a step of Adam on a kernel of this size saturates the memory for good.

    :param size: widths
    """

    place_value: th.Tensor  # (3,) of type, colour and state in the number of a cell

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.parts = nn.ModuleList(nn.Embedding(CELL_VALUES, size.cell) for _ in range(CHANNELS))
        self.whole = nn.Embedding(CELL_VALUES**CHANNELS, size.cell)
        self.film_cells = FiLM(size.instruction, size.cell)
        self.mix = nn.Linear(size.cell, size.view)
        self.film_mixed = FiLM(size.instruction, size.view)
        self.convolution = nn.Linear(VIEW * VIEW * size.view, size.image)  # the kernel is as large as the view
        self.normalise = nn.LayerNorm(size.image, elementwise_affine=False)
        self.film_view = FiLM(size.instruction, size.image)
        self.out = nn.Linear(size.image, size.image)
        self.register_buffer("place_value", CELL_VALUES ** th.arange(CHANNELS).flip(0), persistent=False)

    def forward(self, images: th.Tensor, instructions: th.Tensor, row: th.Tensor) -> th.Tensor:
        """
        :param images: (N, 7, 7, 3)
        :param instructions: (M, instruction)
        :param row: (N,) which instruction belongs to each image
        :return: (N, image)
        """
        table, cells = self.modulated_cells(images, instructions, row)
        view = transform_looked_up(table, cells, self.convolution.weight, self.convolution.bias)
        view = self.film_view(self.normalise(view), instructions, row).relu()
        return self.normalise(transform(view, self.out.weight, self.out.bias))

    def modulated_cells(self, images: th.Tensor, instructions: th.Tensor, row: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
        """
        Few kinds of cells occur, so each is modulated once by each instruction, to be looked up after that.

        :return: a table of modulated cells (R, view), and which of its rows each cell of each image is (N, 49)
        """
        cells = (images.flatten(1, 2).long() * self.place_value).sum(dim=-1)  # (N, 49)
        occurs = th.zeros(self.whole.num_embeddings, dtype=th.bool, device=cells.device)
        occurs[cells.flatten()] = True
        kinds = occurs.nonzero().squeeze(1)  # (U,)
        cell = self.film_cells.all_pairs(self.embed(kinds), instructions).relu_()  # (M, U, cell)
        table = self.film_mixed.all_pairs(self.mix(cell), instructions).relu_()  # (M, U, view)
        return table.flatten(0, 1), row.unsqueeze(1) * len(kinds) + (occurs.cumsum(0) - 1)[cells]

    def embed(self, cells: th.Tensor) -> th.Tensor:
        """
        :param cells: (U,) type, colour and state as one number
        :return: (U, cell)
        """
        digits = cells.unsqueeze(1) // self.place_value % CELL_VALUES  # (U, 3)
        parts = [part(digit) for part, digit in zip(self.parts, digits.unbind(dim=1), strict=True)]
        return self.whole(cells) + sum(parts)


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
    """

    def __init__(self, size: Size) -> None:
        super().__init__()
        pool = nn.MaxPool2d(2)
        self.stem = nn.Sequential(
            nn.Conv2d(CHANNELS, size.cell, 2, padding=1),  # 7x7 -> 8x8
            nn.ReLU(),
            pool,
            nn.Conv2d(size.cell, size.cell, 3, padding=1),  # 4x4
            nn.ReLU(),
            pool,  # 2x2
        )
        widths = ((size.cell, size.view), (size.view, size.image))
        self.blocks = nn.ModuleList(FiLMBlock(size.instruction, *channels) for channels in widths)
        self.pool = pool

    def forward(self, images: th.Tensor, instructions: th.Tensor, row: th.Tensor) -> th.Tensor:
        """
        :param images: (N, 7, 7, 3)
        :param instructions: (M, instruction)
        :param row: (N,) which instruction belongs to each image
        :return: (N, image)
        """
        x = self.stem(images.float().permute(0, 3, 1, 2))  # (N, cell, 2, 2)
        for block in self.blocks:
            x = block(x, instructions, row)
        return self.pool(x).flatten(1)


VISIONS: dict[str, type[nn.Module]] = {"compact": CompactVision, "paper": PaperVision}


class FiLMExtractor(BaseFeaturesExtractor):
    """
    FiLM-based features extractor for levels with missions; works in SB3's ``MultiInputPolicy`` too, where it sees the
    present image only.

    :param observation_space: with "image" (7, 7, 3) and "mission" (72,)
    :param size: "compact" or "paper" (Table A.2)
    """

    def __init__(self, observation_space: spaces.Dict, size: str = "compact") -> None:
        widths = size_of(size)
        super().__init__(observation_space, features_dim=widths.image)
        mission = observation_space["mission"]
        assert isinstance(mission, spaces.Box)
        self.instruction = InstructionEncoder(int(mission.high.max()) + 1, widths)
        self.vision = VISIONS[size](widths)

    def forward(self, observations: Observations) -> th.Tensor:
        """
        :param observations: "image" (N, 7, 7, 3) and "mission" (N, 72)
        :return: (N, features_dim)
        """
        features, position = self.encode(frames(observations))
        return features[position]

    def encode(self, sequences: Sequences) -> tuple[th.Tensor, th.Tensor]:
        """
        Encode each distinct mission and each distinct frame, which is an image with a mission, once.

        :param sequences: B sequences of K frames in all
        :return: features of the distinct frames (U, features_dim), and which of them belongs to each frame (K,)
        """
        images, missions, lengths = sequences
        representatives, kind = distinct(missions)
        instructions = self.instruction(missions[representatives].long())
        mission_of_image = kind.repeat_interleave(lengths)
        shown, position = distinct(th.cat([images.flatten(1), mission_of_image.unsqueeze(1)], dim=1))
        return self.vision(images[shown], instructions, mission_of_image[shown]), position
