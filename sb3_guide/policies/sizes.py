"""The sizes of every network."""

from typing import NamedTuple


class Size(NamedTuple):
    """
    Widths of an agent's layers.

    :param word: embedding of a mission's word
    :param instruction: hidden units of the instruction GRU
    :param cell: channels that the view has when the instruction first modulates it
    :param view: channels that it has after that
    :param image: units that the view is reduced to, which are the input of the memory
    :param memory: hidden units of the memory LSTM
    :param symbol: embedding of a message's symbol, in the decoder and in the encoder
    :param message: hidden units of the message encoder
    """

    word: int
    instruction: int
    cell: int
    view: int
    image: int
    memory: int
    symbol: int
    message: int


COMPACT = Size(word=32, instruction=128, cell=128, view=16, image=128, memory=64, symbol=32, message=64)
SIZES = {
    "compact": COMPACT,
    "medium": COMPACT._replace(memory=256),  # keeps where one has been in a maze
    # Table A.2 of the paper; cell, view, symbol and message are those of the authors' code
    "paper": Size(word=256, instruction=256, cell=128, view=128, image=256, memory=2048, symbol=256, message=512),
}


def size_of(name: str) -> Size:
    """
    :param name: "compact", "medium" or "paper"
    :raises ValueError: for any other name
    """
    if name not in SIZES:
        raise ValueError(f"size={name!r} is unknown: expected one of {', '.join(map(repr, SIZES))}")
    return SIZES[name]
