"""Stage 1: an expert by an algorithm of SB3's family (paper section 3.3), as it is."""

from inspect import signature
from pathlib import Path
from typing import Any

from gymnasium.spaces.utils import flatdim
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecMonitor
from tqdm import tqdm

from sb3_guide.callbacks import (
    CICCallback,
    Curriculum,
    StopTrainingOnSuccessRate,
    SuccessRateCallback,
    TrainingCheckpoint,
    restore_training,
)
from sb3_guide.callbacks.checkpoint import load_state
from sb3_guide.callbacks.success import EpisodeSuccesses
from sb3_guide.envs import GuideGridVecEnv, is_level, level_of
from sb3_guide.experiments.stages.configs import MOST_VALUES, algorithm_arguments, in_use, load_config
from sb3_guide.experiments.stages.levels import environment
from sb3_guide.experiments.stages.runs import Run, TableWriter, plain_values, stage, use_threads
from sb3_guide.policies import AgentPolicy, load_agent, save_agent
from sb3_guide.policies.agents import GuideAgent, GuidedLearnerAgent, LearnerAgent
from sb3_guide.policies.folder import NETWORK
from sb3_guide.policies.saving import load_weights, weights_of

ALGORITHMS: dict[str, type[OnPolicyAlgorithm]] = {"ppo": PPO, "ppo_lstm": RecurrentPPO, "a2c": A2C}  # as rl-zoo names them
CALLBACKS: dict[str, type[BaseCallback]] = {
    f"sb3_guide.callbacks.{callback.__name__}": callback for callback in (StopTrainingOnSuccessRate, Curriculum, CICCallback)
}


def train_expert(
    level: str,
    out: Path,
    seed: int,
    threads: int,
    resume: bool,
    config_file: Path | None = None,
    init: Path | None = None,
    algo: str = "ppo_lstm",
    renew: bool = False,
) -> None:
    """
    :param level: see :func:`~sb3_guide.experiments.stages.levels.environment`
    :param out: folder of the agent
    :param seed: of weights, worlds and sampling
    :param threads: of torch
    :param resume: go on from the last checkpoint of a killed run, or, outside of our levels, begin anew
    :param config_file: YAML in rl-zoo's format; None takes the algorithm's in zoo_configs/
    :param init: folder of an agent of the same kind whose weights to start from, whichever way its memory was fed;
        None starts from fresh ones
    :param algo: "ppo", "ppo_lstm" (sb3-contrib's RecurrentPPO) or "a2c"
    :param renew: as resume; and delete a run of other settings
    :raises ValueError: if an argument is out of range or the folder holds another run
    """
    level = environment(level)
    if algo not in ALGORITHMS:
        raise ValueError(f"algo={algo!r} is unknown: expected one of {', '.join(ALGORITHMS)}")
    config = load_config(algo, level, config_file)
    origin, weights = (None, []) if init is None else (str(init), [init / NETWORK])
    settings = {"level": level, "algo": algo, "seed": seed, "threads": threads, "config": config, "init": origin}
    with stage("expert", settings, weights, out, resume, renew) as run:
        if run.finished:
            return
        use_threads(threads)
        with in_use(config):
            model, callbacks = build(ALGORITHMS[algo], level, seed, config), [SuccessRateCallback(), *build_callbacks(config)]
        if not isinstance(model.policy, AgentPolicy):
            raise ValueError(f"policy={config['policy']!r}: expected LearnerPolicy, GuidePolicy or GuidedLearnerPolicy")
        if init is not None:
            kind = next(kind for kind in (LearnerAgent, GuideAgent, GuidedLearnerAgent) if isinstance(model.policy, kind))
            load_weights(model.policy, weights_of(load_agent(init, kind)))
        run.begin()
        learn(model, callbacks, level, config["n_timesteps"], run)
        save_agent(model.policy, out, level)
        run.found = {"frames": model.num_timesteps}


def learn(model: OnPolicyAlgorithm, callbacks: list[BaseCallback], level: str, n_timesteps: int, run: Run) -> None:
    """
    Train from the beginning or, where there is one, from a checkpoint on, with a row of progress.csv for each rollout.

    :param model: not yet trained
    :param callbacks: of the training
    :param level: name of the level, or id of another environment
    :param n_timesteps: frames in all, those before the checkpoint included
    :param run: this stage's
    """
    checkpoint, rows, logged = run.folder / "checkpoint" / "training.pt", [], {}
    watchers = [callback for callback in callbacks if isinstance(callback, EpisodeSuccesses)]
    if checkpoint.exists():
        state = load_state(checkpoint)
        restore_training(model, state, watchers)
        rows, logged, run.seconds_before = state["rows"], state["logged"], state["seconds"]
    table, board = TableWriter(run.folder / "progress.csv", rows), TensorBoardOutputFormat(str(run.folder / "tensorboard"))
    logger = Logger(str(run.folder), [table, board])
    logger.name_to_value.update(logged)  # of the update before the checkpoint, to be written with the next rollout
    model.set_logger(logger)
    keep = TrainingCheckpoint(
        checkpoint,
        watchers,
        lambda: {"rows": rows, "logged": plain_values(logger.name_to_value), "seconds": run.seconds},
    )
    kept = [keep] if is_level(level) else []  # the state of other worlds can't be stored
    model.learn(
        n_timesteps - model.num_timesteps,
        callback=[*callbacks, *kept, Progress(level, n_timesteps)],
        reset_num_timesteps=model.num_timesteps == 0,
    )


def build(algorithm: type[OnPolicyAlgorithm], level: str, seed: int, config: dict[str, Any]) -> OnPolicyAlgorithm:
    """
    :param algorithm: class of the model
    :param level: name of the level
    :param seed: of everything
    :param config: the level's entry in rl-zoo's format
    :return: a model in its worlds, not yet trained
    :raises ValueError: if a rollout would take too much memory
    """
    without_window = {"history": 0} if algorithm is RecurrentPPO and is_level(level) else {}  # memory holds what it would
    n_envs, env_kwargs = config["n_envs"], {**without_window, **config.get("env_kwargs", {})}
    venv: VecEnv = (
        VecMonitor(GuideGridVecEnv(level_of(level).env_id, n_envs, **env_kwargs))
        if is_level(level)
        else make_vec_env(level, n_envs, env_kwargs=env_kwargs)
    )
    n_steps = config.get("n_steps", signature(algorithm).parameters["n_steps"].default)
    if (values := n_steps * n_envs * flatdim(venv.observation_space)) > MOST_VALUES:
        raise ValueError(f"a rollout would hold {values} values: expected at most {MOST_VALUES}; lower n_steps or n_envs")
    return algorithm(config["policy"], venv, seed=seed, **algorithm_arguments(config))


def build_callbacks(config: dict[str, Any]) -> list[BaseCallback]:
    """
    :param config: the level's entry in rl-zoo's format, whose "callback" lists classes and their arguments, or is one of them
    :return: the callbacks
    :raises ValueError: if one is not known here
    """
    callbacks = []
    listed = config.get("callback") or []
    for entry in [listed] if isinstance(listed, str | dict) else listed:
        name, arguments = next(iter(entry.items()), (None, {})) if isinstance(entry, dict) else (entry, {})
        if name not in CALLBACKS:
            raise ValueError(f"callback {name!r} is unknown: expected one of {', '.join(CALLBACKS)}")
        callbacks.append(CALLBACKS[name](**arguments))
    return callbacks


class Progress(BaseCallback):
    """
    A progress bar that tells the success rate and the part of a curriculum; unlike SB3's it can be read in a log file too.

    :param level: name of the level
    :param n_timesteps: that the whole training takes at most, earlier runs of it included
    """

    def __init__(self, level: str, n_timesteps: int) -> None:
        super().__init__()
        self.bar = tqdm(total=n_timesteps, desc=f"expert {level}", unit="frame")

    def _on_rollout_start(self) -> None:
        self.bar.update(self.num_timesteps - self.bar.n)

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        logged = self.logger.name_to_value
        told = {name.split("/")[1]: logged[name] for name in ("curriculum/part", "rollout/success_rate") if name in logged}
        self.bar.set_postfix(told, refresh=False)

    def _on_training_end(self) -> None:
        self.bar.update(self.num_timesteps - self.bar.n)
        self.bar.close()
