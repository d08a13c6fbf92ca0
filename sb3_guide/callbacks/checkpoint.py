"""Training that survives being killed: everything that the next step depends on, in one file."""

import hashlib
import io
import random
import warnings
from collections import deque
from collections.abc import Callable, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import torch as th
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor, VecTransposeImage

from sb3_guide.callbacks.success import EpisodeSuccesses
from sb3_guide.files import atomically
from sb3_guide.policies.networks import GuideNetwork

MAGIC = b"sb3-guide checkpoint 2 "  # begins the line that stands before what torch has written
WITHOUT_CHECKSUM = b"PK"  # begins a checkpoint of the format before, a zip of torch's
COUNTERS = ("num_timesteps", "_episode_num", "_n_updates", "_current_progress_remaining")
MONITORED = ("episode_returns", "episode_lengths")  # of VecMonitor, in the midst of episodes


class TrainingCheckpoint(BaseCallback):
    """
    Save the state of an on-policy training before a rollout starts, such that :func:`restore_training` goes on as if nothing
    had happened. The file is written atomically: the last good one is always there. The environments must be such as
    GuideGridVecEnv, whose state can be told, in a VecMonitor or not; other wrappers would lose theirs, so they are refused.

    :param path: of the file
    :param watchers: callbacks whose own state belongs to it
    :param extra: called at each save for what else is to be kept: plain values and tensors
    :param every_n_rollouts: save before one rollout in so many
    :param verbose: as in SB3
    :raises ValueError: if the state of the environments can't be told, as the training starts
    """

    def __init__(
        self,
        path: str | Path,
        watchers: Sequence[EpisodeSuccesses] = (),
        extra: Callable[[], dict[str, Any]] = dict,
        every_n_rollouts: int = 5,
        verbose: int = 0,
    ) -> None:
        super().__init__(verbose)
        self.path = Path(path)
        self.watchers = watchers
        self.extra = extra
        self.every_n_rollouts = every_n_rollouts
        self.n_rollouts = 0

    def _init_callback(self) -> None:
        assert self.model.env is not None
        monitor_of(self.model.env)

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.n_rollouts % self.every_n_rollouts == 0 and self.n_rollouts:
            watched = [watcher.get_state() for watcher in self.watchers]
            state = training_state(self.model)  # type: ignore[arg-type]
            save_state(self.path, {**state, "watched": watched, **self.extra()})
        self.n_rollouts += 1


def save_state(path: Path, state: dict[str, Any]) -> None:
    """
    Write tensors and plain values atomically, with a checksum, in a form that loading can't execute.

    :param path: of the file; its folder is made if need be
    :param state: dicts, lists, tuples, numbers, strings and tensors only
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    content = io.BytesIO()
    th.save(state, content)
    with atomically(path) as partial, partial.open("wb") as file:
        file.write(first_line(content.getbuffer()))
        file.write(content.getbuffer())


def first_line(content: bytes | memoryview) -> bytes:
    """:return: what stands before what torch has written: its SHA-256"""
    return MAGIC + hashlib.sha256(content).hexdigest().encode() + b"\n"


def load_state(path: Path) -> dict[str, Any]:
    """
    A file of an earlier version, without checksum, is read with a warning.

    :param path: of a file that :func:`save_state` wrote
    :raises ValueError: if it is damaged
    """
    try:
        with path.open("rb") as file:
            line, content = file.readline(len(first_line(b""))), file.read()
        if line.startswith(WITHOUT_CHECKSUM):
            warnings.warn(f"checkpoint {path} is of an earlier version and has no checksum", stacklevel=2)
            return th.load(path, map_location="cpu", weights_only=True)
        if line != first_line(content):
            raise ValueError("its content doesn't match its checksum")
        return th.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises whatever the damaged place makes it raise
        raise ValueError(f"checkpoint {path} is damaged ({error}): delete it to start anew") from error


def training_state(model: OnPolicyAlgorithm) -> dict[str, Any]:
    """
    :param model: between two rollouts, in environments with ``get_state`` such as GuideGridVecEnv's
    :return: weights, optimiser, counters, random streams, last observations, worlds and statistics
    """
    assert model.env is not None
    assert model._last_obs is not None
    monitor = monitor_of(model.env)
    lstm = getattr(model, "_last_lstm_states", None)
    return {
        "policy": model.policy.state_dict(),
        "optimizer": model.policy.optimizer.state_dict(),
        "counters": {name: getattr(model, name) for name in COUNTERS},
        "random": random_streams(model.device),
        "chance": [generator.get_state() for generator in chances(model)],
        "last_obs": tensors(model._last_obs),  # type: ignore[arg-type]
        "last_episode_starts": th.as_tensor(model._last_episode_starts),
        "last_lstm_states": None if lstm is None else [list(lstm.pi), list(lstm.vf)],
        "worlds": tensors(model.env.get_state()),  # type: ignore[attr-defined]
        "monitor": None if monitor is None else tensors({name: getattr(monitor, name) for name in MONITORED}),
        "episodes": [
            tensors({name: np.asarray(value) for name, value in info.items()}) for info in model.ep_info_buffer or ()
        ],
        "successes": [bool(success) for success in model.ep_success_buffer or ()],
    }


def restore_training(model: OnPolicyAlgorithm, state: dict[str, Any], watchers: Sequence[EpisodeSuccesses] = ()) -> None:
    """
    :param model: built with the arguments and the environments of the one that was saved
    :param state: as :class:`TrainingCheckpoint` saved it; ``model.learn(rest, reset_num_timesteps=False)`` goes on from there
    :param watchers: like those of the :class:`TrainingCheckpoint`, in the same order
    """
    assert model.env is not None
    model.policy.load_state_dict(state["policy"])
    model.policy.optimizer.load_state_dict(deepcopy(state["optimizer"]))  # torch would train on in these very tensors
    for name, value in state["counters"].items():
        setattr(model, name, value)
    model._last_obs = arrays(state["last_obs"])
    model._last_episode_starts = state["last_episode_starts"].numpy()
    if state["last_lstm_states"] is not None:
        halves = (tuple(part.to(model.device) for part in half) for half in state["last_lstm_states"])
        model._last_lstm_states = RNNStates(*halves)  # type: ignore[attr-defined]
    for watcher, watched in zip(watchers, state["watched"], strict=True):  # one may change the worlds' level
        watcher.init_callback(model)
        watcher.set_state(watched)
    model.env.set_state(arrays(state["worlds"]))  # type: ignore[attr-defined]
    if state["monitor"] is not None:
        monitor = monitor_of(model.env)
        for name, value in arrays(state["monitor"]).items():
            setattr(monitor, name, value)
    episodes = ({name: value[()] for name, value in arrays(info).items()} for info in state["episodes"])
    model.ep_info_buffer = deque(episodes, maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(state["successes"], maxlen=model._stats_window_size)
    restore_random_streams(state["random"], model.device)
    for generator, drawn in zip(chances(model), state["chance"], strict=True):
        generator.set_state(drawn)


def chances(model: OnPolicyAlgorithm) -> list[th.Generator]:
    """:return: generators of a network with a channel, of what interventions draw"""
    return [module.chance for module in model.policy.modules() if isinstance(module, GuideNetwork)]


def monitor_of(env: VecEnv) -> VecMonitor | None:
    """
    :param env: of a training that is to be saved
    :return: the VecMonitor around it, if there is one
    :raises ValueError: if the state of worlds or wrappers can't be told
    """
    monitor = None
    while isinstance(env, VecEnvWrapper):
        if not isinstance(env, VecMonitor | VecTransposeImage):
            raise ValueError(
                f"the state of a {type(env).__name__} would be lost: expected GuideGridVecEnv, in a VecMonitor or by itself"
            )
        monitor = env if isinstance(env, VecMonitor) else monitor
        env = env.venv
    if not hasattr(env, "get_state"):
        raise ValueError(
            f"the state of a {type(env).__name__} can't be told: expected GuideGridVecEnv, in a VecMonitor or not"
        )
    return monitor


def random_streams(device: th.device) -> dict[str, Any]:
    """
    :param device: of the policy; actions are drawn there
    :return: states of torch's, numpy's and Python's global generators, which SB3 draws from
    """
    of_numpy = np.random.get_state(legacy=False)  # noqa: NPY002
    assert isinstance(of_numpy, dict)
    key = th.as_tensor(of_numpy["state"]["key"])
    return {
        "torch": th.get_rng_state(),
        "numpy": {**of_numpy, "state": {**of_numpy["state"], "key": key}},
        "python": random.getstate(),
        "accelerator": {} if device.type == "cpu" else {device.type: getattr(th, device.type).get_rng_state(device)},
    }


def restore_random_streams(streams: dict[str, Any], device: th.device) -> None:
    """
    A stream of another type of accelerator means nothing on this device, whose own stream then stays as it is. The same goes
    for a checkpoint of an earlier version, which has none.

    :param streams: as :func:`random_streams` returned them
    :param device: of the policy
    """
    th.set_rng_state(streams["torch"])
    of_numpy = streams["numpy"]
    np.random.set_state({**of_numpy, "state": {**of_numpy["state"], "key": of_numpy["state"]["key"].numpy()}})  # noqa: NPY002
    random.setstate(streams["python"])
    if (stream := streams.get("accelerator", {}).get(device.type)) is not None:
        getattr(th, device.type).set_rng_state(stream, device)


def tensors(parts: dict[str, np.ndarray]) -> dict[str, th.Tensor]:
    """:return: the same as tensors"""
    return {name: th.as_tensor(part) for name, part in parts.items()}


def arrays(parts: dict[str, th.Tensor]) -> dict[str, np.ndarray]:
    """:return: the same as arrays"""
    return {name: part.numpy() for name, part in parts.items()}
