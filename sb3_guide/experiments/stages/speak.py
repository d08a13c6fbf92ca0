"""Speaking to an agent in its own language, and measuring how far it obeys (paper section 5.4)."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sb3_guide.cloning import mission_seeds
from sb3_guide.envs import ACTIONS, GuideGridEnv, is_level
from sb3_guide.experiments.stages.levels import level_of_agent
from sb3_guide.experiments.stages.runs import check_result, record, use_threads
from sb3_guide.files import read_text, write_json
from sb3_guide.language import CHOREOGRAPHIES, Dictionary, danced, obey, overhear, perform, steps_of
from sb3_guide.language.pictures import save_figure, walk_figure
from sb3_guide.metrics import obedience
from sb3_guide.policies import AgentPolicy, load_agent

LEARNED_ON = 500  # missions of the validation split
WORLDS = 50  # missions on which ten messages each are told
MOST_TEXT = 2**16  # bytes of a choreography
TRIED = 200  # missions that are looked at for one where a choreography can be danced


def speak_to(
    agent: Path,
    level: str | None,
    say: Sequence[str],
    choreography: str | None,
    measure: bool,
    out: Path,
    seed: int,
    threads: int,
) -> None:
    """
    Learn an agent's dictionary, and tell it what to do; without anything to tell, the dictionary alone.

    :param agent: folder of an agent with a channel
    :param level: see :func:`~sb3_guide.experiments.stages.levels.environment`; None takes the agent's own
    :param say: actions or messages, one after the other
    :param choreography: "pirouette", "waltz" or a text file with actions or messages
    :param measure: tell it 500 random messages that mean something, and count how many are obeyed
    :param out: folder for speech.json and, where something is told, walk.png
    :param seed: of the mission and of the random messages
    :param threads: of torch
    :raises FileNotFoundError: if there is no such choreography
    :raises ValueError: if the agent has no channel, is of another level or has no word for something, a step is unknown, or
        the folder holds another speech.json
    """
    result, picture = out / "speech.json", out / "walk.png"
    check_result(result, "speak")
    if say and choreography is not None:
        raise ValueError("there are words and a choreography to be told: leave out --say or --choreography")
    use_threads(threads)
    started = time.monotonic()
    level, policy = level_of_agent(agent, level), load_agent(agent)
    dictionary = overhear(policy, level, mission_seeds("validation", LEARNED_ON))
    print(in_words(dictionary))
    found: dict[str, Any] = {"dictionary": entries(dictionary)}
    script = ", ".join(say) if say else None if choreography is None else text_of(choreography, dictionary)
    told = [] if script is None else steps_of(script, dictionary)
    out.mkdir(parents=True, exist_ok=True)
    if result.exists():
        picture.unlink(missing_ok=True)
    if told:
        walk = walk_in_level if is_level(level) else walk_elsewhere
        found["walk"] = walk(policy, level, told, dictionary, seed, picture)
    if measure:
        found["obedience"] = measured(policy, level, dictionary, seed)
    settings = {"level": level, "folder": str(agent), "seed": seed, "threads": threads}
    write_json(result, {**record("speak", settings, time.monotonic() - started), **found})


def entries(dictionary: Dictionary) -> list[dict[str, Any]]:
    """:return: every message that occurs, the commonest first, with the action that mostly follows, how often, and frames"""
    frames, meanings = dictionary.counts.sum(axis=1), dictionary.meanings
    return [
        {
            "message": dictionary.shape.names()[message],
            "action": dictionary.actions[dictionary.counts[message].argmax()],
            "probability": float(dictionary.counts[message].max() / frames[message]),
            "frames": int(frames[message]),
            "means_it": bool(meanings[message] >= 0),
        }
        for message in np.argsort(-frames, kind="stable")
        if frames[message]
    ]


def in_words(dictionary: Dictionary) -> str:
    """:return: a line for each message that occurs"""
    return "\n".join(
        f"{entry['message']}  {entry['action']:8} {entry['probability']:4.0%} of {entry['frames']:,} frames"
        + ("" if entry["means_it"] else "  (not strongly)")
        for entry in entries(dictionary)
    )


def text_of(choreography: str, dictionary: Dictionary) -> str:
    """
    :param choreography: name of one of ours, or path of a text file
    :param dictionary: of the agent
    :raises FileNotFoundError: if it is neither
    """
    if choreography in CHOREOGRAPHIES:
        return danced(choreography, dictionary)
    if not Path(choreography).is_file():
        raise FileNotFoundError(
            f"there is no choreography {choreography!r}: expected {', '.join(CHOREOGRAPHIES)}, or a text file with an action "
            "or a message on each line"
        )
    return read_text(Path(choreography), MOST_TEXT)


def walk_in_level(
    policy: AgentPolicy, level: str, told: list[int], dictionary: Dictionary, seed: int, picture: Path
) -> dict[str, Any]:
    """
    :param told: index of the message at each step
    :param seed: which of the missions where the choreography can be danced
    :param picture: where to draw the walk
    :return: what was told, meant and done
    """
    meant = dictionary.meanings[told]
    mission = danceable(level, meant, seed)
    taken = perform(policy, level, np.array([mission]), np.array(told)[:, None]).taken[:, 0]
    env = GuideGridEnv(level, render_mode="rgb_array")
    env.reset(seed=mission)
    grid, cells = env.render(), [(*env.agent_pos, env.agent_dir)]
    for action in taken:
        ended = env.step(action)[2]
        cells.append((*env.agent_pos, env.agent_dir))
        if ended:
            break
    lines = protocol(told, taken[: len(cells) - 1], dictionary)
    print("\n".join(lines))
    save_figure(walk_figure(grid, np.array(cells), lines), picture)
    return {"mission": env.mission, **account(mission, told, taken[: len(lines)], dictionary)}


def walk_elsewhere(
    policy: AgentPolicy, level: str, told: list[int], dictionary: Dictionary, seed: int, picture: Path
) -> dict[str, Any]:
    """As :func:`walk_in_level`, where nothing is known of walls and ways: on any mission, without a picture."""
    mission = int(mission_seeds("analysis", 1, skip=seed)[0])
    taken = perform(policy, level, np.array([mission]), np.array(told)[:, None]).taken[:, 0]
    print("\n".join(protocol(told, taken, dictionary)))
    return account(mission, told, taken, dictionary)


def protocol(told: Sequence[int], taken: np.ndarray, dictionary: Dictionary) -> list[str]:
    """
    :param told: index of the message at each step
    :param taken: (T,) action at each step, which may be fewer
    :return: for each action a line with what was told and done
    """
    names, actions = dictionary.shape.names(), dictionary.actions
    meant = [actions[action] if action >= 0 else "?" for action in dictionary.meanings[list(told)]]
    return [
        f"{names[message]} ({wanted}): {actions[action]}" for message, wanted, action in zip(told, meant, taken, strict=False)
    ]


def account(mission: int, told: Sequence[int], taken: np.ndarray, dictionary: Dictionary) -> dict[str, Any]:
    """:return: seed of the mission, and what was told, meant and done, as JSON"""
    actions = dictionary.actions
    return {
        "mission_seed": int(mission),
        "told": [dictionary.shape.names()[message] for message in told],
        "meant": [actions[action] if action >= 0 else None for action in dictionary.meanings[list(told)]],
        "taken": [actions[action] for action in taken],
    }


def danceable(level: str, actions: np.ndarray, seed: int) -> int:
    """
    :param actions: (T,) that the choreography asks for; -1 for any
    :param seed: from which mission of the analysis split on to look
    :return: seed of the first mission in which no step forward of theirs is into something; the first one if there is none
    """
    missions = mission_seeds("analysis", TRIED, skip=seed)
    env = GuideGridEnv(level)
    for mission in missions:
        env.reset(seed=int(mission))
        if all(moves(env, action) for action in actions if action >= 0):
            return int(mission)
    return int(missions[0])


def moves(env: GuideGridEnv, action: int) -> bool:
    """:return: whether an action, which is taken, is none forward or gets somewhere"""
    before = env.agent_pos
    env.step(np.int64(action))
    return action != ACTIONS.index("forward") or env.agent_pos != before


def measured(policy: AgentPolicy, level: str, dictionary: Dictionary, seed: int) -> dict[str, Any]:
    """
    :return: obedience on missions that the dictionary does not know, raw, corrected for chance, and by action; None of an
        agent whose messages mean nothing
    """
    if (dictionary.meanings < 0).all():
        print("no message means anything, so there is nothing to obey")
        return {"messages": 0, "raw": None, "corrected": None, "by_action": {}}
    meant, taken = obey(policy, level, dictionary, mission_seeds("analysis", WORLDS), np.random.default_rng(seed))
    raw, corrected = obedience(meant, taken)
    names = dictionary.actions
    by_action = {names[action]: float((taken[meant == action] == action).mean()) for action in np.unique(meant)}
    beyond = (
        "as it only ever took one action, chance would do as well" if np.isnan(corrected) else f"{corrected:.1%} beyond chance"
    )
    print(f"obeyed {raw:.1%} of {len(meant)} messages; {beyond}")
    print("\n".join(f"  {action:8} {rate:.1%}" for action, rate in by_action.items()))
    return {
        "messages": len(meant),
        "raw": raw,
        "corrected": None if np.isnan(corrected) else corrected,
        "by_action": by_action,
    }
