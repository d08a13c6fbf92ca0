"""What the messages of an agent go together with (paper section 5)."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import torch as th

from sb3_guide.cloning import Episodes, load_demonstrations, measure_communication, mission_seeds, play
from sb3_guide.envs import ACTIONS, GuideGridEnv, level_of
from sb3_guide.experiments.stages.animation import Caption, write_animation
from sb3_guide.experiments.stages.runs import record, use_threads
from sb3_guide.files import write_json
from sb3_guide.metrics import message_action_counts
from sb3_guide.policies import AgentPolicy, load_agent
from sb3_guide.policies.sequences import history_of

SHOWN_LENGTH = 8  # frames that an episode needs to be worth watching


def analyze(agent: Path, level: str, demos: Path, out: Path, threads: int) -> None:
    """
    :param agent: folder of an agent with a channel
    :param level: name of the level
    :param demos: file of demonstrations that no agent was trained on
    :param out: folder for analysis.json and episode.gif
    :param threads: of torch
    :raises ValueError: if the agent has no channel, or the demonstrations are damaged
    """
    level = level_of(level).name
    use_threads(threads)
    started = time.monotonic()
    policy, demonstrations = load_agent(agent), load_demonstrations(demos)
    shape = policy.channel.encoder.shape
    episodes = play(policy, level, mission_seeds("analysis", len(demonstrations.episodes)))
    messages = greedy_messages(policy, episodes)
    found: dict[str, Any] = {
        "agent": type(policy).__name__,
        "messages": shape.names(),
        "actions": list(ACTIONS),
        "counts": message_action_counts(messages, episodes.actions, shape.count, len(ACTIONS)).tolist(),
        "episodes": len(episodes),
        "frames": len(messages),
        **measure_communication(policy, memory_of(policy, demonstrations.episodes)),
    }
    out.mkdir(parents=True, exist_ok=True)
    animate(episodes, messages, shape.names(), level, out / "episode.gif")
    settings = {"level": level, "folder": str(agent), "demos": str(demos), "threads": threads}
    write_json(out / "analysis.json", {**record("analyze", settings, time.monotonic() - started), **found})


def greedy_messages(policy: AgentPolicy, episodes: Episodes) -> np.ndarray:
    """
    :param policy: with a channel, who played these episodes
    :param episodes: E of them, of F frames in all
    :return: (F,) index of the message that was heard at each frame
    """
    with th.no_grad():
        symbols = policy.channel.speak(memory_of(policy, episodes)).argmax(dim=-1)
        return policy.channel.encoder.shape.index(symbols).numpy()


def memory_of(policy: AgentPolicy, episodes: Episodes) -> th.Tensor:
    """:return: (F, state_size) what the agent remembers at every frame of the episodes"""
    with th.no_grad():
        if policy.carries_memory:
            return policy.network.remember(episodes.sequences())
        return policy.network.recall(episodes.windows(history_of(policy.observation_space)))


def animate(episodes: Episodes, messages: np.ndarray, names: list[str], level: str, path: Path) -> None:
    """
    Draw the first successful episode that is long enough to be worth watching, or the longest successful one.

    :param episodes: that were played
    :param messages: (F,) index of the message at each frame
    :param names: of the messages
    :param level: name of the level
    :param path: of the GIF
    """
    lengths = np.where(episodes.successes, episodes.lengths, 0)
    shown = int(np.argmax(lengths.clip(max=SHOWN_LENGTH)))
    first, last = episodes.offsets[shown : shown + 2]
    env = GuideGridEnv(level, render_mode="rgb_array")
    env.reset(seed=int(episodes.seeds[shown]))
    frames, captions = [], []
    for message, action in zip(messages[first:last], episodes.actions[first:last], strict=True):
        frames.append(env.render())
        captions.append(Caption(env.mission, names[message], ACTIONS[action]))
        env.step(action)
    frames.append(env.render())
    captions.append(Caption(env.mission, "", ""))
    write_animation(path, frames, captions)
