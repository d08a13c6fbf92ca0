"""Stages 2 and 3: Learner, Guide and guided Learner by imitation's BC (paper section 3.3), and the controls."""

import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch as th
from imitation.util.logger import HierarchicalLogger
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from stable_baselines3.common.utils import get_schedule_fn, set_random_seed, update_learning_rate
from tqdm import tqdm

from sb3_guide.callbacks import LanguagePictures
from sb3_guide.callbacks.checkpoint import load_state, save_state
from sb3_guide.cloning import Demonstrations, Validation, load_demonstrations, mission_seeds
from sb3_guide.cloning.bc import EpisodeLoss, episode_bc
from sb3_guide.cloning.demonstrations import pool
from sb3_guide.envs import spaces_of
from sb3_guide.experiments.stages.configs import algorithm_arguments, checked, in_use, load_config
from sb3_guide.experiments.stages.evaluate import evaluate
from sb3_guide.experiments.stages.levels import join_levels, split_levels
from sb3_guide.experiments.stages.runs import SETTINGS, Run, stage, use_threads, write_table
from sb3_guide.files import parse_yaml, read_json
from sb3_guide.policies import AgentPolicy, PretrainedGuide, save_agent
from sb3_guide.policies.folder import NETWORK
from sb3_guide.policies.interventions import intervention_of
from sb3_guide.policies.products import check_arithmetic, usual_arithmetic
from sb3_guide.policies.recurrent import RecurrentGuidedLearnerPolicy, RecurrentGuidePolicy, RecurrentLearnerPolicy
from sb3_guide.policies.saving import start_from

AGENTS: dict[str, type[AgentPolicy]] = {
    "learner": RecurrentLearnerPolicy,
    "guide": RecurrentGuidePolicy,
    "guided": RecurrentGuidedLearnerPolicy,
}
UNTRAINED = "untrained"  # instead of a Guide's folder
HIGHEST_CIC = "highest_cic"  # folder within the agent's: the agent as it was when its CIC was highest (section 5.4)


def clone(
    agent: str,
    level: str,
    demos: Sequence[Path],
    out: Path,
    seed: int,
    threads: int,
    resume: bool,
    *,
    renew: bool = False,
    guide: str | None = None,
    freeze_guide: bool = False,
    hears: str = "spoken",
    init: Path | None = None,
    params: Sequence[str] = (),
    config_file: Path | None = None,
    tensorboard: bool = False,
) -> None:
    """
    Clone an agent, validate it while it learns, and measure the finished one on fresh missions (evaluation.json).

    :param agent: "learner", "guide" or "guided"
    :param level: see :func:`~sb3_guide.experiments.stages.levels.split_levels`; demonstrations of several are pooled
    :param demos: for each level a folder with train.safetensors and validation.safetensors
    :param out: folder of the agent
    :param seed: of weights, order and messages
    :param threads: of torch
    :param resume: go on from the last finished epoch of a killed run
    :param renew: the same; and delete a run of other settings, demonstrations, Guide or start
    :param guide: folder of the pretrained Guide that a guided Learner hears or a Guide reads, or "untrained"
    :param freeze_guide: keep that Guide as it is
    :param hears: name of the intervention that a guided Learner hears the messages through
    :param init: folder of a Learner to start from, or of a Guide whose trunk to start from
    :param params: hyper-parameters to override, such as "n_epochs:5", as rl-zoo takes them
    :param config_file: YAML in rl-zoo's format; None takes zoo_configs/bc.yml
    :param tensorboard: show each validation, and pictures of the language, in the folder "tensorboard" within the agent's
    :raises ValueError: if an argument is out of range, or the folder holds another run
    """
    names = split_levels(level)
    check_agent(agent, guide, freeze_guide, hears, init)
    policy_kwargs = guide_kwargs(agent, guide, freeze_guide, hears)
    config = override(shared_config(names, config_file), params)
    chosen = config.pop("arithmetic", None)
    settings: dict[str, Any] = {
        "agent": agent,
        "level": join_levels(names),
        "seed": seed,
        "threads": threads,
        "demos": [str(folder) for folder in demos],
        "guide": guide,
        "freeze_guide": freeze_guide,
        "hears": hears,
        "init": None if init is None else str(init),
        "config": config,
    }
    settings["arithmetic"] = arithmetic = arithmetic_of(out, settings, chosen)
    files = [folder / f"{split}.safetensors" for folder in demos for split in ("train", "validation")]
    agents = [Path(folder) / NETWORK for folder in (guide, init) if folder not in (None, UNTRAINED)]
    with stage("clone", settings, [*files, *agents], out, resume, renew) as run:
        if run.finished:
            return
        train, validation = (demonstrations_of(names, demos, split) for split in ("train", "validation"))
        train = [part.first(config["train_episodes"]) for part in train]
        use_threads(threads)
        set_random_seed(seed)
        with in_use(config):
            policy = build(agent, names[0], config, policy_kwargs, init)
        cloning = Cloning(policy, train, validation, out, seed, config, arithmetic, run)
        run.begin()
        if tensorboard:
            cloning.show()
        cloning.train()
        save_agent(policy, out, join_levels(names))
        evaluate(out, join_levels(names), config["analysis_episodes"], out / "evaluation.json", threads)


def build(agent: str, level: str, config: dict[str, Any], policy_kwargs: dict[str, Any], init: Path | None) -> AgentPolicy:
    """
    :param agent: a key of AGENTS
    :param level: whose observations and actions it is for
    :param config: the level's entry of bc.yml
    :param policy_kwargs: what the policy is to know of a Guide
    :param init: folder of the agent to start from
    :return: the policy, not yet trained
    """
    observation_space, action_space = spaces_of(level)
    policy = AGENTS[agent](
        observation_space,
        action_space,
        get_schedule_fn(algorithm_arguments(config)["learning_rate"]),
        **policy_kwargs,
        **config.get("policy_kwargs", {}),
    )
    if init is not None:
        start_from(policy, init)
    return policy


def check_agent(agent: str, guide: str | None, freeze_guide: bool, hears: str, init: str | Path | None) -> None:
    """
    See :func:`clone`.

    :raises ValueError: if there is no such agent or intervention, or the agent has no use for one of the others, or lacks it
    """
    if agent not in AGENTS:
        raise ValueError(f"agent={agent!r} is unknown: expected one of {', '.join(AGENTS)}")
    intervention_of(hears)
    if agent != "guided" and hears != "spoken":
        raise ValueError(f"a {agent} hears no Guide: leave out --hears, or choose --agent guided")
    if agent == "guided" and guide is None:
        raise ValueError("a guided Learner needs a pretrained Guide: pass its folder with --guide, or 'untrained'")
    if agent == "learner" and guide is not None:
        raise ValueError("a learner hears no Guide: leave out --guide, or choose --agent guided")
    if freeze_guide and guide is None:
        raise ValueError("there is no Guide to freeze: pass its folder with --guide, or leave out --freeze-guide")
    if agent != "learner" and init is not None:
        raise ValueError(f"a {agent} starts from nothing: leave out --init, or choose --agent learner")


def guide_kwargs(agent: str, guide: str | None, freeze_guide: bool, hears: str) -> dict[str, Any]:
    """:return: what the policy of this agent is to know of a Guide"""
    if guide is None:
        return {}
    pretrained = PretrainedGuide.untrained() if guide == UNTRAINED else PretrainedGuide.from_folder(guide)
    return {"guide": pretrained, "freeze_guide": freeze_guide} | ({"hears": hears} if agent == "guided" else {})


def shared_config(levels: Sequence[str], file: Path | None) -> dict[str, Any]:
    """
    :param levels: names
    :param file: see :func:`~sb3_guide.experiments.stages.configs.load_config`
    :return: the entry of the levels in bc.yml
    :raises ValueError: if pooled levels have different entries
    """
    configs = [load_config("bc", level, file) for level in levels]
    if any(config != configs[0] for config in configs):
        raise ValueError(
            f"{join_levels(levels)} are to be pooled but differ in their hyper-parameters: give them the same ones"
        )
    return configs[0]


def override(config: dict[str, Any], params: Sequence[str]) -> dict[str, Any]:
    """
    :param config: the level's entry of bc.yml
    :param params: such as "n_epochs:5"; a mapping such as "policy_kwargs:{message_length: 1}" changes what it names
    :return: the entry with those values instead
    :raises ValueError: if there is no such hyper-parameter, or its value is no YAML or out of range
    """
    changes = dict(param.partition(":")[::2] for param in params)
    of_agents = [name for name in config if name != "recorded_episodes"]  # which is for the demonstrations
    known = list(dict.fromkeys([*of_agents, "arithmetic"]))
    if unknown := changes.keys() - set(known):
        raise ValueError(f"--params {', '.join(sorted(unknown))} are unknown: expected NAME:VALUE of {', '.join(known)}")
    try:
        values = {name: parse_yaml(value) for name, value in changes.items()}
    except ValueError as error:
        raise ValueError(f"--params {', '.join(params)}: expected values in YAML ({error})") from error
    for name, value in values.items():
        values[name] = {**config[name], **value} if isinstance(config.get(name), dict) and isinstance(value, dict) else value
    return checked({**config, **values})


def arithmetic_of(out: Path, settings: dict[str, Any], chosen: str | None) -> str:
    """
    The arithmetic that was chosen; else that of the run that is to go on, which may have begun on another kind of processor;
    else what suits this processor. Prints a line where a run goes on in another arithmetic than this processor's, and one
    where bfloat16 is slow.

    :param out: folder of the agent
    :param settings: of the run, but for its arithmetic
    :param chosen: among the hyper-parameters
    :return: "float32" or "bfloat16"
    :raises ValueError: if the run that is there has none of them
    """
    begun = read_json(out / SETTINGS) if (out / SETTINGS).is_file() else {}
    goes_on = all(begun.get(name) == value for name, value in settings.items())
    usual = usual_arithmetic(th.device("cpu"))
    arithmetic: str = chosen or (begun.get("arithmetic") if goes_on else None) or usual
    check_arithmetic(arithmetic)
    if (out / "run.json").exists():
        return arithmetic  # nothing is left to compute
    if goes_on and arithmetic != usual:
        print(f"{out} goes on in {arithmetic}, as it began; a new run would compute in {usual} here", file=sys.stderr)
    if arithmetic == "bfloat16" != usual:
        print("this processor has no units for bfloat16: cloning in it takes 3 to 6 times as long", file=sys.stderr)
    return arithmetic


def demonstrations_of(levels: Sequence[str], folders: Sequence[Path], split: str) -> list[Demonstrations]:
    """
    :return: demonstrations of each level
    :raises ValueError: if there is not a folder for each level, or one holds another level's, or is damaged
    """
    if len(folders) != len(levels):
        raise ValueError(f"{len(folders)} folders of demonstrations for {len(levels)} levels: expected one for each, in order")
    return [load_demonstrations(folder / f"{split}.safetensors", level) for level, folder in zip(levels, folders, strict=True)]


class Cloning:
    """
    Update by update, with a row of progress.csv at every validation and a checkpoint after each epoch.

    :param policy: to be trained in place
    :param train: demonstrations of each level
    :param validation: of each level, for loss and CIC
    :param out: folder of the agent
    :param seed: of order and messages
    :param config: the levels' entry of bc.yml
    :param arithmetic: of large matrix products, "float32" or "bfloat16"
    :param run: this stage's
    """

    def __init__(
        self,
        policy: AgentPolicy,
        train: Sequence[Demonstrations],
        validation: Sequence[Demonstrations],
        out: Path,
        seed: int,
        config: dict[str, Any],
        arithmetic: str,
        run: Run,
    ) -> None:
        self.schedule = get_schedule_fn(algorithm_arguments(config)["learning_rate"])
        self.algorithm, self.loader = episode_bc(
            policy,
            pool(train),
            batch_size=config["batch_size"],
            learning_rate=self.schedule(1),
            ent_weight=config["ent_weight"],
            seed=seed,
            arithmetic=arithmetic,
            logger=HierarchicalLogger(Logger(folder=None, output_formats=[])),
        )
        seeds = mission_seeds("validation", config["validation_episodes"])
        self.validation = Validation(policy, seeds, validation, on_row=self.complete)
        self.level = join_levels([part.level for part in validation])
        self.policy, self.out, self.run, self.n_epochs = policy, out, run, config["n_epochs"]
        self.pictures: LanguagePictures | None = None
        self.updates = 0  # so far
        epochs = {*config["validate_at"], *range(0, self.n_epochs, config["validate_every"])[1:], self.n_epochs}
        self.validate_at = {round(epoch * len(self.loader)) for epoch in epochs}  # updates
        self.checkpoint = out / "checkpoint" / "cloning.pt"
        self.progress = tqdm(total=self.n_epochs, desc=f"clone {type(policy).__name__}", unit="epoch")

    @property
    def generator(self) -> th.Generator:
        """Of the messages' noise."""
        loss = self.algorithm.loss_calculator
        assert isinstance(loss, EpisodeLoss)
        return loss.generator

    def show(self) -> None:
        """From now on, show each validation in TensorBoard, and pictures of an agent whose messages have symbols."""
        self.validation.logger = Logger(None, [TensorBoardOutputFormat(str(self.out / "tensorboard"))])
        if self.policy.has_symbols:
            self.pictures = LanguagePictures(self.policy, self.level.split("+")[0], self.validation.logger)

    def train(self) -> None:
        """Do the epochs that are left."""
        if self.checkpoint.exists():
            self.restore(load_state(self.checkpoint))
        elif 0 in self.validate_at:
            self.validation()
        left = self.n_epochs - self.loader.epoch
        with self.progress, warnings.catch_warnings():
            warnings.filterwarnings(
                "ignore", "Converting a tensor with requires_grad", UserWarning
            )  # as imitation logs a loss
            if left:
                self.algorithm.train(
                    n_epochs=left, on_batch_end=self.after_update, on_epoch_end=self.after_epoch, progress_bar=False
                )

    def after_update(self) -> None:
        """Step the learning rate, and validate where it is due."""
        self.updates += 1
        update_learning_rate(self.algorithm.optimizer, self.schedule(1 - self.updates / (self.n_epochs * len(self.loader))))
        if self.updates in self.validate_at:
            self.validation()

    def complete(self, row: dict[str, float]) -> None:
        """
        :param row: of a validation, which is completed here; where CIC was never higher, the agent of this moment is kept
        """
        row["epoch"] = round(self.updates / len(self.loader), 4)
        row["episodes"] = self.updates * self.loader.batch_size
        row["seconds"] = round(self.run.seconds, 2)
        if "cic" in row and row["cic"] == max(earlier["cic"] for earlier in self.validation.history):
            save_agent(self.policy, self.out / HIGHEST_CIC, self.level)
        write_table(self.out / "progress.csv", self.validation.history)
        if self.validation.logger is not None:
            self.validation.logger.dump(self.updates)
        if self.pictures is not None:
            self.pictures.show(self.updates)
        self.progress.set_postfix(success=f"{row['success_rate']:.3f}", loss=f"{row['loss']:.3f}")

    def after_epoch(self) -> None:
        """Keep what the next epoch depends on."""
        state = {
            "policy": self.policy.state_dict(),
            "optimizer": self.algorithm.optimizer.state_dict(),
            "generator": self.generator.get_state(),
            "rows": self.validation.history,
            "epoch": self.loader.epoch,
            "seconds": self.run.seconds,
        }
        save_state(self.checkpoint, state)
        self.progress.update()

    def restore(self, state: dict[str, Any]) -> None:
        """
        :param state: as :meth:`after_epoch` saved it
        """
        self.policy.load_state_dict(state["policy"])
        self.algorithm.optimizer.load_state_dict(state["optimizer"])
        self.generator.set_state(state["generator"])
        self.validation.history = state["rows"]
        self.loader.epoch = state["epoch"]
        self.updates = self.loader.epoch * len(self.loader)
        self.run.seconds_before = state["seconds"]
        write_table(self.out / "progress.csv", self.validation.history)
        self.progress.update(self.loader.epoch)
