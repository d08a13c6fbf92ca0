"""What was found, in sentences that the numbers decide."""

from typing import Any

HEAD_START = "The guided Learner also carries the Guide's trained network, so a lead does not show that language causes it."
READINGS = {  # by whether CIC rises, and uniform CIC
    (True, True): "Both influences rise: the Learner heeds the messages more and more.",
    (True, False): "CIC alone rises: the messages vary more, while the Learner heeds each of them less.",
    (False, True): "CIC alone falls: the Guide grows more certain of what to say, while the Learner heeds it no less.",
    (False, False): "Both influences fall: the Learner depends less and less on the messages.",
}


def percent(rate: float) -> str:
    """:return: a rate in [0, 1] as "98.2 %", without a line break inside"""
    return f"{100 * rate:.1f}\N{NO-BREAK SPACE}%"


def signed(number: float, digits: int) -> str:
    """:return: the number with its sign, a true minus"""
    return f"{number:+.{digits}f}".replace("-", "\N{MINUS SIGN}")


def nats(number: float) -> str:
    """:return: with two digits after the point, or two that aren't zero where it is small"""
    return f"{number:.2f}" if number >= 0.1 or number == 0 else f"{number:.2g}"


def training_finding(level: dict[str, Any], message: str) -> str:
    """
    :param level: block of the summary
    :param message: one of the messages, such as "w0 w0"
    :return: how well each agent does in the end
    """
    rates = {agent: percent(level[agent]["success_rate"]) for agent in ("expert", "learner", "guide", "guided")}
    return (
        f"The expert solves {rates['expert']} of {level['expert']['episodes']} fresh missions. Cloned from "
        f"{level['demos']['episodes']:,} of its episodes, a Learner solves {rates['learner']}; a Guide, whose actions depend "
        f"on nothing but its own message of {len(message.split())} symbols, {rates['guide']}; and a new Learner that hears "
        f"this Guide, {rates['guided']}."
    )


def early_finding(level: dict[str, Any]) -> str:
    """
    :param level: block of the summary
    :return: whether the guided Learner learns faster, as far as these seeds tell
    """
    early, n_epochs = level["early"], len(level["learner"]["curve"])
    points, by_seed = 100 * early["difference"], [100 * lead for lead in early["by_seed"]]
    if round(points, 1) == 0:
        compared = "level with the Learner"
    else:
        compared = f"{'ahead of' if points > 0 else 'behind'} the Learner by {abs(points):.1f} percentage points of success"
    sentence = f"In the first {early['epochs']} of {n_epochs} epochs the guided Learner was on average {compared}"
    if len(by_seed) == 1:
        return f"{sentence}; this is a single seed, which proves nothing by itself. {HEAD_START}"
    lowest, highest, ahead = signed(min(by_seed), 1), signed(max(by_seed), 1), sum(lead > 0 for lead in by_seed)
    return f"{sentence}: {lowest} to {highest} over {len(by_seed)} seeds, ahead in {ahead} of them. {HEAD_START}"


def influence_finding(level: dict[str, Any]) -> str:
    """
    :param level: block of the summary
    :return: how the messages' influence develops, and what else may explain that
    """
    guided, trend = level["guided"], level["trends"]["cic"]
    ends = {name: f"from {nats(guided[name][0])} to {nats(guided[name][-1])}" for name in level["trends"]}
    sentence = f"The causal influence of the messages on the guided Learner's actions (CIC) goes {ends['cic']} nats"
    if trend["slope"] is None:
        return f"{sentence}; there are too few epochs for a trend."
    slope = f"{trend['slope']:+.2g}".replace("-", "\N{MINUS SIGN}")
    probability = "< 0.001" if trend["p_value"] < 0.001 else f"= {trend['p_value']:.3f}"
    return (
        f"{sentence}, a linear trend of {slope} an epoch (p {probability}). The entropy of the messages, which bounds it, "
        f"goes {ends['message_entropy']}, and the influence that uniformly drawn messages would have {ends['uniform_cic']}. "
        f"{reading(level)}"
    )


def reading(level: dict[str, Any]) -> str:
    """
    :param level: block of the summary, with trends
    :return: what CIC and uniform CIC mean together; a more certain Guide lowers the one without any change in the Learner
    """
    rises, uniform_rises = ((level["trends"][name]["slope"] or 0) > 0 for name in ("cic", "uniform_cic"))
    entropy, uniform = (sum(level["guided"][name]) for name in ("message_entropy", "uniform_cic"))
    if entropy < uniform / 2:
        return (
            "The Guide is so certain of its messages that CIC cannot be larger, whatever the Learner does; uniform CIC shows "
            f"that the Learner heeds them {'more and more' if uniform_rises else 'less and less'}."
        )
    return READINGS[rises, uniform_rises]
