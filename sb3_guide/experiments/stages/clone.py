"""Stages 2 and 3: Learner, Guide and guided Learner by imitation's BC (paper section 3.3)."""

from pathlib import Path
from typing import Any

import torch as th
from gymnasium import spaces
from imitation.util.logger import HierarchicalLogger
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.utils import set_random_seed
from tqdm import tqdm

from sb3_guide.callbacks import EpochMetrics
from sb3_guide.callbacks.checkpoint import load_state, save_state
from sb3_guide.cloning import Demonstrations, load_demonstrations, mission_seeds
from sb3_guide.cloning.bc import EpisodeLoss, episode_bc
from sb3_guide.envs import ACTIONS, level_of, observation_space
from sb3_guide.experiments.stages.configs import load_config
from sb3_guide.experiments.stages.runs import Run, stage, use_threads, write_table
from sb3_guide.experiments.stages.statistics import wilson_interval
from sb3_guide.policies import AgentPolicy, PretrainedGuide, save_agent
from sb3_guide.policies.recurrent import RecurrentGuidedLearnerPolicy, RecurrentGuidePolicy, RecurrentLearnerPolicy

AGENTS: dict[str, type[AgentPolicy]] = {
    "learner": RecurrentLearnerPolicy,
    "guide": RecurrentGuidePolicy,
    "guided": RecurrentGuidedLearnerPolicy,
}


def clone(
    agent: str,
    level: str,
    demos: Path,
    out: Path,
    seed: int,
    threads: int,
    resume: bool,
    guide: Path | None = None,
    freeze_guide: bool = False,
    config_file: Path | None = None,
) -> None:
    """
    :param agent: "learner", "guide" or "guided"
    :param level: name of the level
    :param demos: folder with train.safetensors and validation.safetensors
    :param out: folder of the agent
    :param seed: of weights, order and messages
    :param threads: of torch
    :param resume: go on from the last finished epoch of a killed run
    :param guide: folder of the pretrained Guide that a guided Learner hears
    :param freeze_guide: keep that Guide as it is
    :param config_file: YAML in rl-zoo's format; None takes zoo_configs/bc.yml
    :raises ValueError: if an argument is out of range, or the folder holds another run
    """
    level, policy_kwargs = level_of(level).name, guide_kwargs(agent, guide, freeze_guide)
    config = load_config("bc", level, config_file)
    origin = {"guide": None if guide is None else str(guide), "freeze_guide": freeze_guide}
    settings = {
        "agent": agent,
        "level": level,
        "seed": seed,
        "threads": threads,
        "demos": str(demos),
        **origin,
        "config": config,
    }
    with stage("clone", settings, out, resume) as run:
        if run.finished:
            return
        use_threads(threads)
        set_random_seed(seed)
        policy = AGENTS[agent](
            observation_space(history=0),
            spaces.Discrete(len(ACTIONS)),
            lambda _: config["learning_rate"],
            **policy_kwargs,
            **config.get("policy_kwargs", {}),
        )
        Cloning(policy, level, demos, out, seed, config, run).train()
        save_agent(policy, out, level)


def guide_kwargs(agent: str, guide: Path | None, freeze_guide: bool) -> dict[str, Any]:
    """
    :return: what the policy of this agent is to know of a Guide
    :raises ValueError: if there is no such agent, or a Guide is missing or too many
    """
    if agent not in AGENTS:
        raise ValueError(f"agent={agent!r} is unknown: expected one of {', '.join(AGENTS)}")
    if agent != "guided":
        if guide is not None or freeze_guide:
            raise ValueError(f"a {agent} hears no Guide: leave out --guide and --freeze-guide, or choose --agent guided")
        return {}
    if guide is None:
        raise ValueError("a guided Learner needs a pretrained Guide: pass its folder with --guide")
    return {"guide": PretrainedGuide.from_folder(guide), "freeze_guide": freeze_guide}


def of_level(path: Path, level: str) -> Demonstrations:
    """
    :return: demonstrations of this level
    :raises ValueError: if they are of another one, or damaged
    """
    demonstrations = load_demonstrations(path)
    if demonstrations.level != level:
        raise ValueError(f"{path} holds demonstrations of {demonstrations.level}: expected {level}, as --level says")
    return demonstrations


class Cloning:
    """
    Epoch by epoch, with a row of progress.csv and a checkpoint after each.

    :param policy: to be trained in place
    :param level: name of the level
    :param demos: folder of the demonstrations
    :param out: folder of the agent
    :param seed: of order and messages
    :param config: the level's entry of bc.yml
    :param run: this stage's
    """

    def __init__(
        self, policy: AgentPolicy, level: str, demos: Path, out: Path, seed: int, config: dict[str, Any], run: Run
    ) -> None:
        train, validation = (of_level(demos / f"{split}.safetensors", level) for split in ("train", "validation"))
        self.algorithm, self.loader = episode_bc(
            policy,
            train,
            batch_size=config["batch_size"],
            learning_rate=config["learning_rate"],
            ent_weight=config["ent_weight"],
            seed=seed,
            logger=HierarchicalLogger(Logger(folder=None, output_formats=[])),
        )
        seeds = mission_seeds("validation", config["validation_episodes"])
        self.metrics = EpochMetrics(policy, seeds, validation, on_epoch=self.keep)
        self.policy, self.out, self.run, self.n_epochs = policy, out, run, config["n_epochs"]
        self.checkpoint = out / "checkpoint" / "cloning.pt"
        self.progress = tqdm(total=self.n_epochs, desc=f"clone {type(policy).__name__}", unit="epoch")

    @property
    def generator(self) -> th.Generator:
        """Of the messages' noise."""
        loss = self.algorithm.loss_calculator
        assert isinstance(loss, EpisodeLoss)
        return loss.generator

    def train(self) -> None:
        """Do the epochs that are left."""
        if self.checkpoint.exists():
            self.restore(load_state(self.checkpoint))
        left = self.n_epochs - self.loader.epoch
        with self.progress:
            if left:
                self.algorithm.train(n_epochs=left, on_epoch_end=self.metrics, progress_bar=False)

    def restore(self, state: dict[str, Any]) -> None:
        """
        :param state: as :meth:`keep` saved it
        """
        self.policy.load_state_dict(state["policy"])
        self.algorithm.optimizer.load_state_dict(state["optimizer"])
        self.generator.set_state(state["generator"])
        self.metrics.history = state["rows"]
        self.loader.epoch = len(self.metrics.history)
        self.run.seconds_before = state["seconds"]
        write_table(self.out / "progress.csv", self.metrics.history)
        self.progress.update(self.loader.epoch)

    def keep(self, row: dict[str, float]) -> None:
        """
        :param row: of the epoch that has ended, which is completed here
        """
        self.loader.epoch += 1
        missions, demonstrated = len(self.metrics.seeds), len(self.loader.episodes.actions)
        row["success_low"], row["success_high"] = wilson_interval(round(row["success_rate"] * missions), missions)
        row["frames"] = self.loader.epoch * demonstrated
        row["seconds"] = round(self.run.seconds, 2)
        write_table(self.out / "progress.csv", self.metrics.history)
        state = {
            "policy": self.policy.state_dict(),
            "optimizer": self.algorithm.optimizer.state_dict(),
            "generator": self.generator.get_state(),
            "rows": self.metrics.history,
            "seconds": self.run.seconds,
        }
        save_state(self.checkpoint, state)
        self.progress.set_postfix(success=f"{row['success_rate']:.3f}", loss=f"{row['loss']:.3f}")
        self.progress.update()
