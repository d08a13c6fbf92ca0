"""
Where is what an agent should do lost, before it is remembered or before it is said?

    python -m benchmarks.probes runs/guides/GoToLocal-0 --level GoToLocal

Along the shipped expert's episodes, probes (one hidden layer, trained on the first two thirds of the episodes) tell the
expert's action from the agent's memory, and from its message. How often they are right on the rest is printed, beside how
common the commonest action is.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import torch as th
import torch.nn.functional as F
import typer
from torch import nn

from sb3_guide import load_agent, load_expert
from sb3_guide.cloning import mission_seeds, play
from sb3_guide.experiments.stages.runs import use_threads
from sb3_guide.language import read_along
from sb3_guide.language.reading import memory_of

EPISODES, STEPS = 1500, 400


def probe(inputs: th.Tensor, actions: th.Tensor, training: th.Tensor) -> float:
    """
    :param inputs: (F, n)
    :param actions: (F,) to be told from them
    :param training: (F,) bool, on which frames to train
    :return: share of the other frames in which the action is told
    """
    inputs = (inputs - inputs[training].mean(dim=0)) / (inputs[training].std(dim=0) + 1e-3)
    network = nn.Sequential(nn.Linear(inputs.shape[1], 64), nn.ReLU(), nn.Linear(64, int(actions.max()) + 1))
    optimizer = th.optim.Adam(network.parameters(), lr=0.01)
    for _ in range(STEPS):
        optimizer.zero_grad()
        F.cross_entropy(network(inputs[training]), actions[training]).backward()
        optimizer.step()
    return (network(inputs[~training]).argmax(dim=1) == actions[~training]).float().mean().item()


def main(folder: Annotated[Path, typer.Argument()], level: Annotated[str, typer.Option()]) -> None:
    """Print what is in the memory and in the messages of the agent in a folder."""
    use_threads(1)
    th.manual_seed(0)
    policy = load_agent(folder)
    episodes = play(load_expert(level).policy, level, mission_seeds("validation", EPISODES))
    reading, memory = read_along(policy, level, episodes), memory_of(policy, episodes)
    actions, training = th.as_tensor(episodes.actions.astype(np.int64)), th.as_tensor(reading.episode < EPISODES * 2 // 3)
    messages = F.one_hot(th.as_tensor(reading.messages), reading.shape.count).float()
    print(f"commonest action: {F.one_hot(actions[~training]).float().mean(dim=0).max():.1%}")
    print(f"from the memory:  {probe(memory, actions, training):.1%}")
    print(f"from the message: {probe(messages, actions, training):.1%}")


if __name__ == "__main__":
    typer.run(main)
