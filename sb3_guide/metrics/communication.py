"""
How much a message moves its hearer: Causal Influence of Communication (Lowe et al. 2019) and what it must be read with.

All take log-probabilities and return one value a frame, in nats; averages over frames are the caller's. Notation: N frames,
M messages, A actions, pi_G(m|o) the Guide, pi_L(a|o,m) the Learner with its memory held.
"""

import math

import torch as th


def cic(message_log_probs: th.Tensor, action_log_probs: th.Tensor) -> th.Tensor:
    """
    Causal Influence of Communication of each frame (paper section 5.3): the mutual information of action and message, were
    the message drawn from the Guide. It lies between 0 and the smaller of the message entropy and log A, so a Guide that is
    certain of its message has none, however well it is obeyed: read it with :func:`message_entropy` and :func:`uniform_cic`.

    :param message_log_probs: (N, M) log pi_G(m|o)
    :param action_log_probs: (N, M, A) log pi_L(a|o,m)
    :return: (N,)
    :raises ValueError: if the shapes don't fit
    """
    check_shapes(message_log_probs, action_log_probs)
    joint = message_log_probs.unsqueeze(-1) + action_log_probs  # log p(a, m), (N, M, A)
    marginal = joint.logsumexp(dim=1, keepdim=True)  # log p(a), (N, 1, A)
    return expectation(joint, action_log_probs - marginal).sum(dim=(1, 2))


def uniform_cic(action_log_probs: th.Tensor) -> th.Tensor:
    """
    CIC, were every message equally probable: how much the Learner listens, whatever the Guide would say.

    :param action_log_probs: (N, M, A) log pi_L(a|o,m)
    :return: (N,)
    :raises ValueError: if the shape is another
    """
    if action_log_probs.dim() != 3:
        raise ValueError(f"action_log_probs has shape {tuple(action_log_probs.shape)}: expected (frames, messages, actions)")
    frames, messages, _ = action_log_probs.shape
    return cic(action_log_probs.new_full((frames, messages), -math.log(messages)), action_log_probs)


def tempered(message_log_probs: th.Tensor, entropy: float) -> th.Tensor:
    """
    What the Guide would say at the one temperature at which its messages are, on average, so uncertain. As the entropy bounds
    CIC, only the CIC of equally uncertain messages tells who is listened to more, or when.

    :param message_log_probs: (N, M) log pi_G(m|o)
    :param entropy: mean over frames that is asked for, in nats; where a message is impossible it may be out of reach
    :return: (N, M) log-probabilities, proportional to ``message_log_probs`` in each frame before they are normalised
    :raises ValueError: if no messages have this entropy
    """
    highest = math.log(message_log_probs.shape[1])
    if not 0 < entropy < highest:
        raise ValueError(f"entropy={entropy}: expected a number of nats above 0 and below {highest:.2f}, log of the messages")
    low, high = math.log(1e-3), math.log(1e5)  # temperatures
    for _ in range(50):
        middle = (low + high) / 2
        found = (message_log_probs / math.exp(middle)).log_softmax(dim=1)
        low, high = (low, middle) if message_entropy(found).mean() > entropy else (middle, high)
    return found


def cic_as_published(message_log_probs: th.Tensor, action_log_probs: th.Tensor) -> th.Tensor:
    """
    CIC as the code published with Lowe et al. (2019) has it, whose marginal of the actions is a mean over messages where the
    formula asks for a sum: log M too high. For comparison with numbers that were made by it, and for nothing else.

    :param message_log_probs: (N, M) log pi_G(m|o)
    :param action_log_probs: (N, M, A) log pi_L(a|o,m)
    :return: (N,)
    :raises ValueError: if the shapes don't fit
    """
    return cic(message_log_probs, action_log_probs) + math.log(message_log_probs.shape[1])


def influence(messages: th.Tensor, message_log_probs: th.Tensor, action_log_probs: th.Tensor) -> th.Tensor:
    """
    How far the message of each frame moves the Learner: the divergence of its actions given that message from its actions
    given any, KL(pi_L(.|o,m) || p(.|o)). Its expectation over the Guide's messages is CIC.

    :param messages: (N,) int64 index of the message that was heard
    :param message_log_probs: (N, M) log pi_G(m|o)
    :param action_log_probs: (N, M, A) log pi_L(a|o,m)
    :return: (N,) in nats
    :raises ValueError: if the shapes don't fit
    """
    check_shapes(message_log_probs, action_log_probs)
    marginal = (message_log_probs.unsqueeze(-1) + action_log_probs).logsumexp(dim=1)  # log p(a), (N, A)
    heard = action_log_probs[th.arange(len(messages), device=messages.device), messages]
    return expectation(heard, heard - marginal).sum(dim=1)


def message_entropy(message_log_probs: th.Tensor) -> th.Tensor:
    """
    How uncertain the Guide is of its message.

    :param message_log_probs: (N, M) log pi_G(m|o)
    :return: (N,)
    """
    return -expectation(message_log_probs, message_log_probs).sum(dim=1)


def positive_signalling(message_log_probs: th.Tensor, weights: th.Tensor | None = None) -> float:
    """
    Mutual information of message and observation, H(E pi_G) - E H(pi_G): whether what the Guide says depends on what it sees.

    :param message_log_probs: (N, M) log pi_G(m|o)
    :param weights: (N,) how often each frame counts; None for once
    :return: nats, over all frames
    """
    often = message_log_probs.new_ones(len(message_log_probs)) if weights is None else weights
    share = often / often.sum()
    marginal = (share.unsqueeze(1) * message_log_probs.exp()).sum(dim=0, keepdim=True)
    return float(message_entropy(marginal.log()) - share @ message_entropy(message_log_probs))


def expectation(log_probs: th.Tensor, values: th.Tensor) -> th.Tensor:
    """:return: p * values, and 0 where p is 0, even where the value is infinite or undefined there"""
    return th.where(log_probs.isneginf(), 0.0, log_probs.exp() * values)


def check_shapes(message_log_probs: th.Tensor, action_log_probs: th.Tensor) -> None:
    """
    :raises ValueError: unless the shapes are (N, M) and (N, M, A), with at least one frame
    """
    if action_log_probs.dim() != 3 or message_log_probs.shape != action_log_probs.shape[:2] or not len(message_log_probs):
        raise ValueError(
            f"message_log_probs has shape {tuple(message_log_probs.shape)} and action_log_probs "
            f"{tuple(action_log_probs.shape)}: expected (frames, messages) and (frames, messages, actions), at least one frame"
        )
