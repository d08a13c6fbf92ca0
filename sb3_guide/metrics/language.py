"""What messages go together with, from counts: correlations, where :mod:`sb3_guide.metrics.communication` asks for causes."""

import numpy as np


def joint_counts(rows: np.ndarray, columns: np.ndarray, n_rows: int, n_columns: int) -> np.ndarray:
    """
    How often each row came with each column, such as each action after each message (paper section 5.1).

    :param rows: (N,) index of the row at each frame
    :param columns: (N,) index of the column
    :param n_rows: R
    :param n_columns: C
    :return: (R, C) int64
    :raises ValueError: if the two differ in shape or hold an index out of range
    """
    if rows.shape != columns.shape or rows.ndim != 1:
        raise ValueError(f"rows {rows.shape} and columns {columns.shape} differ: expected one of each a frame")
    for name, values, count in (("rows", rows, n_rows), ("columns", columns, n_columns)):
        if values.size and (values.min() < 0 or values.max() >= count):
            raise ValueError(f"{name} range from {values.min()} to {values.max()}: expected 0 to {count - 1}")
    return np.bincount(rows.astype(np.int64) * n_columns + columns, minlength=n_rows * n_columns).reshape(n_rows, n_columns)


def symbol_information(counts: np.ndarray, length: int) -> np.ndarray:
    """
    What each position of the message tells about the action, or about anything else that was counted with it: the mutual
    information, in nats, less the bias of so few frames (Miller and Madow 1955). Below 0 there is nothing to be found.

    :param counts: (M, A) how often each action followed each message
    :param length: symbols in a message
    :return: (length,)
    :raises ValueError: if M messages can't be made of so many symbols, or nothing was counted
    """
    messages, actions = counts.shape
    vocabulary_size = round(messages ** (1 / length))
    if vocabulary_size**length != messages or not counts.sum():
        raise ValueError(
            f"counts {counts.shape} of {counts.sum()} frames: expected a row for each message of {length} symbols"
        )
    by_symbol = counts.reshape(*[vocabulary_size] * length, actions)
    others = [tuple(other for other in range(length) if other != position) for position in range(length)]
    return np.array([mutual_information(by_symbol.sum(axis=axes)) for axes in others])


def mutual_information(counts: np.ndarray) -> float:
    """
    :param counts: (R, C) how often row and column came together
    :return: nats, with Miller and Madow's correction
    """
    rows, columns = (int((counts.sum(axis=axis) > 0).sum()) for axis in (1, 0))
    return plain_information(counts) + float(rows + columns - (counts > 0).sum() - 1) / (2 * float(counts.sum()))


def plain_information(counts: np.ndarray) -> float:
    """
    :param counts: (R, C) how often row and column came together
    :return: nats, without a correction
    """
    joint = counts / counts.sum()
    independent = joint.sum(axis=1, keepdims=True) * joint.sum(axis=0)
    occurs = joint > 0
    return float((joint[occurs] * np.log(joint[occurs] / independent[occurs])).sum())


def obedience(meant: np.ndarray, taken: np.ndarray) -> tuple[float, float]:
    """
    How often an agent does what it is told (paper section 5.4), plain and corrected for chance: an agent that always takes its
    favourite action, whatever it is told, has none.

    :param meant: (N,) the action that each message means
    :param taken: (N,) the action that followed
    :return: share of the messages that were obeyed, and (share - p) / (1 - p), p being the share of the commonest action; the
        latter is NaN where an agent only ever takes one action
    :raises ValueError: if the two differ in shape or are empty
    """
    if meant.shape != taken.shape or not meant.size:
        raise ValueError(f"meant {meant.shape} and taken {taken.shape} differ or are empty: expected one of each a message")
    obeyed, chance = float((meant == taken).mean()), float(np.unique(taken, return_counts=True)[1].max() / taken.size)
    return obeyed, (obeyed - chance) / (1 - chance) if chance < 1 else float("nan")


def conditional(counts: np.ndarray) -> np.ndarray:
    """
    P(column|row) from counts.

    :param counts: (R, C)
    :return: (R, C) float64; NaN in rows that never occurred
    """
    with np.errstate(invalid="ignore"):
        return counts / counts.sum(axis=1, keepdims=True)
