"""Observation and instruction become one vector: instruction GRU, convolution, FiLM (Perez et al. 2018)."""

import torch as th
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn
from torch.nn.utils.rnn import pack_padded_sequence

from sb3_guide.policies.sequences import Observations, distinct
from sb3_guide.policies.sizes import Size, size_of

VIEW = 7  # cells on a side of the agent's view
CHANNELS = 3  # type, colour and state of a cell
CELL_VALUES = 11  # values that each of the three can take


class InstructionEncoder(nn.Module):
    """
    Embedding and GRU over a mission's words; the hidden state after its last word (padding is never read).

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
        words = self.embedding(missions[:, : int(lengths.max())])
        packed = pack_padded_sequence(words, lengths.cpu(), batch_first=True, enforce_sorted=False)
        return self.gru(packed)[1].squeeze(0)


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

    def forward(self, x: th.Tensor, y: th.Tensor) -> th.Tensor:
        """
        :param x: (N, ..., channels)
        :param y: (N, condition_dim)
        """
        shape = (len(y), *[1] * (x.dim() - 2), -1)
        return self.gamma(y).view(shape) * x + self.beta(y).view(shape)


class CompactVision(nn.Module):
    """
    One embedding a cell, FiLM, one convolution over the whole view, FiLM: what two CPU cores train well. Layer normalisation
    bounds what FiLM and memory get: without it, a step of Adam on a kernel of this size saturates the memory for good.

    :param size: widths
    """

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.embedding = nn.Embedding(CELL_VALUES**CHANNELS, size.cell)
        self.film_cells = FiLM(size.instruction, size.cell)
        self.convolution = nn.Linear(VIEW * VIEW * size.cell, size.image)  # the kernel is as large as the view
        self.normalise = nn.LayerNorm(size.image, elementwise_affine=False)
        self.film_view = FiLM(size.instruction, size.image)
        self.out = nn.Linear(size.image, size.image)

    def forward(self, images: th.Tensor, instructions: th.Tensor) -> th.Tensor:
        """
        :param images: (N, 7, 7, 3)
        :param instructions: (N, instruction)
        :return: (N, image)
        """
        kind, colour, state = images.long().flatten(1, 2).unbind(dim=-1)  # (N, 49) each
        cells = self.embedding((kind * CELL_VALUES + colour) * CELL_VALUES + state)  # (N, 49, cell)
        cells = self.film_cells(cells, instructions).relu()
        view = self.film_view(self.normalise(self.convolution(cells.flatten(1))), instructions).relu()
        return self.normalise(self.out(view))


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

    def forward(self, x: th.Tensor, y: th.Tensor) -> th.Tensor:
        """
        :param x: (N, channels, height, width)
        :param y: (N, condition_dim)
        :return: (N, out_channels, height, width)
        """
        x = self.second(self.first(x).relu())
        return self.film(x.movedim(1, -1), y).movedim(-1, 1).relu()


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
        self.blocks = nn.ModuleList([FiLMBlock(size.instruction, size.cell, channels) for channels in (size.cell, size.image)])
        self.pool = pool

    def forward(self, images: th.Tensor, instructions: th.Tensor) -> th.Tensor:
        """
        :param images: (N, 7, 7, 3)
        :param instructions: (N, instruction)
        :return: (N, image)
        """
        x = self.stem(images.float().permute(0, 3, 1, 2))  # (N, cell, 2, 2)
        for block in self.blocks:
            x = block(x, instructions)
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
        return self.encode(observations["image"], observations["mission"], th.arange(len(observations["image"])))

    def encode(self, images: th.Tensor, missions: th.Tensor, mission_of_image: th.Tensor) -> th.Tensor:
        """
        Encode frames, each distinct mission and each distinct (image, mission) once.

        :param images: (K, 7, 7, 3)
        :param missions: (B, 72)
        :param mission_of_image: (K,) row of ``missions`` that belongs to each image
        :return: (K, features_dim)
        """
        representatives, kind = distinct(missions)
        instructions = self.instruction(missions[representatives].long())
        mission_of_image = kind[mission_of_image]
        frames, position = distinct(th.cat([images.flatten(1), mission_of_image.unsqueeze(1)], dim=1))
        return self.vision(images[frames], instructions[mission_of_image[frames]])[position]
