"""
What the compact agents' own choices are worth: clone GoToObj without each of them.

    python -m benchmarks.cloning_ablations --demos runs/demo/GoToObj/demos --seeds 2

Prints a table: success on 200 validation missions after 5, 10 and 20 epochs, an agent and a seed in each row.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import torch as th
import typer
from gymnasium import spaces
from imitation.util.logger import HierarchicalLogger
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.utils import get_schedule_fn, set_random_seed
from torch import nn
from tqdm import tqdm

from sb3_guide.cloning import Validation, load_demonstrations, mission_seeds
from sb3_guide.cloning.bc import episode_bc
from sb3_guide.envs import ACTIONS, observation_space
from sb3_guide.experiments.stages.configs import algorithm_arguments, load_config
from sb3_guide.policies import AgentPolicy, RecurrentGuidePolicy, RecurrentLearnerPolicy

EPOCHS = (5, 10, 20)


def as_shipped(policy: AgentPolicy) -> None:
    """Change nothing."""


def without_layer_norm(policy: AgentPolicy) -> None:
    """Feed the memory what the convolution makes, whatever its scale."""
    trunk = policy.network if isinstance(policy, RecurrentLearnerPolicy) else policy.channel.speaker
    trunk.film.vision.normalise = nn.Identity()


def default_channel(policy: AgentPolicy) -> None:
    """Initialise the decoder as torch does."""
    policy.channel.speaker.decoder.logits.reset_parameters()
    policy.channel.speaker.decoder.inverse_temperature.reset_parameters()


LEARNER, GUIDE = RecurrentLearnerPolicy, RecurrentGuidePolicy
VARIANTS: list[tuple[str, type[AgentPolicy], bool, Callable[[AgentPolicy], None]]] = [
    ("as shipped", LEARNER, False, as_shipped),
    ("without layer normalisation", LEARNER, False, without_layer_norm),
    ("SB3's orthogonal initialisation", LEARNER, True, as_shipped),
    ("as shipped", GUIDE, False, as_shipped),
    ("without layer normalisation", GUIDE, False, without_layer_norm),
    ("SB3's orthogonal initialisation", GUIDE, True, as_shipped),
    ("torch's initialisation of the channel", GUIDE, False, default_channel),
]


def success_rates(
    policy_class: type[AgentPolicy], ortho_init: bool, change: Callable[[AgentPolicy], None], demos: Path, seed: int
) -> list[float]:
    """:return: success rate after each of the EPOCHS"""
    train, validation = (load_demonstrations(demos / f"{split}.safetensors") for split in ("train", "validation"))
    config = load_config("bc", train.level)
    learning_rate = get_schedule_fn(algorithm_arguments(config)["learning_rate"])(1)
    set_random_seed(seed)
    space, actions = observation_space(history=0), spaces.Discrete(len(ACTIONS))
    policy = policy_class(space, actions, lambda _: learning_rate, ortho_init=ortho_init)
    change(policy)
    settings = {"batch_size": config["batch_size"], "learning_rate": learning_rate, "ent_weight": config["ent_weight"]}
    silent = HierarchicalLogger(Logger(folder=None, output_formats=[]))
    algorithm, loader = episode_bc(policy, train, seed=seed, logger=silent, **settings)
    metrics, rates = Validation(policy, mission_seeds("validation", 200), [validation]), []

    def validate() -> None:
        if loader.epoch in EPOCHS:
            rates.append(metrics.play(train.level)["success_rate"])
            policy.set_training_mode(True)

    algorithm.train(n_epochs=max(EPOCHS), on_epoch_end=validate, progress_bar=False)
    return rates


def main(
    demos: Annotated[Path, typer.Option(help="Folder of demonstrations.")],
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each variant.")] = 2,
) -> None:
    """Clone every variant and print the table."""
    th.set_num_threads(1)
    print("| agent | variant | seed |", " | ".join(f"{epoch} epochs" for epoch in EPOCHS), "|")
    print("|---|---|---|" + "---|" * len(EPOCHS))
    for name, policy_class, ortho_init, change in tqdm(VARIANTS, unit="variant"):
        for seed in range(seeds):
            rates = success_rates(policy_class, ortho_init, change, demos, seed)
            agent = "Learner" if policy_class is LEARNER else "Guide"
            print(f"| {agent} | {name} | {seed} |", " | ".join(f"{100 * rate:.1f} %" for rate in rates), "|", flush=True)


if __name__ == "__main__":
    typer.run(main)
