"""
Training on an accelerator beside the CPU of the same machine, in less than six minutes:

    python -m benchmarks.accelerator --device cuda --out accelerator.json

First whether both compute the same values, and whether a training that is resumed from a checkpoint goes on as it would have.
Then frames per second of PPO, RecurrentPPO and cloning, in larger and larger batches until memory is full, the time is up or
they get no faster. Each row of the Markdown tables is printed and written as soon as it is measured. Without an accelerator,
the second device of the tests shows that the script works; its times mean nothing.
"""

import gc
import os
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import torch as th
import typer
from gymnasium import spaces
from imitation.algorithms.bc import BC
from imitation.util.logger import HierarchicalLogger
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from torch.utils._pytree import tree_map_only

from benchmarks.versions import versions
from sb3_guide import GuideGridVecEnv, load_expert
from sb3_guide.callbacks import TrainingCheckpoint, restore_training
from sb3_guide.callbacks.checkpoint import load_state
from sb3_guide.cloning import Demonstrations, mission_seeds, play
from sb3_guide.cloning.bc import EpisodeLoader, episode_bc
from sb3_guide.envs import ACTIONS, DEFAULT_HISTORY, observation_space
from sb3_guide.experiments.stages.clone import AGENTS
from sb3_guide.files import write_json
from sb3_guide.policies import AgentPolicy, PretrainedGuide
from sb3_guide.policies.folder import Description
from sb3_guide.policies.pretrained import UNTRAINED
from sb3_guide.policies.products import usual_arithmetic

LEVEL = "GoToLocal"
POLICIES = ("LearnerPolicy", "GuidePolicy", "GuidedLearnerPolicy")
TRAININGS = ((PPO, "LearnerPolicy"), (RecurrentPPO, "LearnerPolicy"), (RecurrentPPO, "GuidePolicy"))  # whose speed is measured
ON_ACCELERATORS_ONLY = "paper"  # size that takes minutes a batch on a CPU
CPU = th.device("cpu")
RESUMED = 16  # worlds of the training that is resumed, at most
TOLERANCES = {"float32": 1e-4, "bfloat16": 0.1}  # of values and log-probabilities, and of gradients as a share of their norm
FASTER = 1.05  # times the frames per second of smaller batches, or larger ones are not tried


@dataclass(frozen=True)
class Plan:
    """
    What is measured.

    :param worlds: how many are stepped side by side, from few to many
    :param n_steps: of a rollout in each of them
    :param n_epochs: of PPO on each rollout
    :param n_batches: of PPO in each epoch
    :param episodes: how many are cloned in a batch, from few to many
    :param n_demonstrations: that are recorded; larger batches repeat them
    :param sizes: of the agents that are cloned
    :param policy_kwargs: of all agents in reinforcement learning
    """

    worlds: tuple[int, ...] = (64, 256, 1024, 4096, 16384)
    n_steps: int = 40
    n_epochs: int = 4
    n_batches: int = 4
    episodes: tuple[int, ...] = (32, 128, 512, 2048, 8192)
    n_demonstrations: int = 4000
    sizes: tuple[str, ...] = ("compact", "medium", "paper")
    policy_kwargs: dict[str, Any] = field(default_factory=dict)


# fused updates know real devices only
TINY = Plan((2,), 2, 1, 1, (2,), 8, ("compact",), {"optimizer_kwargs": {"eps": 1e-5}})


class Report:
    """
    Rows of tables, printed as Markdown and written to a file at once.

    :param out: JSON file
    :param about: what else is written there
    """

    def __init__(self, out: Path, about: dict[str, Any]) -> None:
        self.out = out
        self.content: dict[str, Any] = {**about, "tables": {}}

    def add(self, table: str, row: dict[str, Any]) -> None:
        """
        :param table: its title
        :param row: values by the headings of their columns, the same ones in all rows of a table
        """
        rows = self.content["tables"].setdefault(table, [])
        if not rows:
            print(f"\n{table}\n\n| {' | '.join(row)} |\n{'|---' * len(row)}|")
        rows.append(row)
        print(f"| {' | '.join(map(shown, row.values()))} |", flush=True)
        write_json(self.out, self.content)


def shown(value: Any) -> str:
    """:return: what stands in a cell"""
    if isinstance(value, float):
        return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"
    return "" if value is None else f"{value:,}" if isinstance(value, int) else str(value)


def module_of(device: th.device) -> Any:
    """:return: torch's module for a kind of device, such as ``torch.cuda``"""
    return getattr(th, device.type)


def found_accelerator() -> th.device | None:
    """:return: the accelerator that torch can use here, if there is one"""
    if hasattr(th, "accelerator"):  # in newer versions of torch
        return th.accelerator.current_accelerator() if th.accelerator.is_available() else None
    available = {"cuda": th.cuda.is_available(), "mps": th.backends.mps.is_available(), "xpu": th.xpu.is_available()}
    return next((th.device(kind) for kind, there in available.items() if there), None)


def untrained_guide(carries_memory: bool) -> PretrainedGuide:
    """:return: a Guide for a Learner of the same kind of memory"""
    if carries_memory:
        return PretrainedGuide.untrained()
    return PretrainedGuide(Description("GuidePolicy", UNTRAINED, history=DEFAULT_HISTORY))


def build(algorithm: type[OnPolicyAlgorithm], policy: str, device: th.device, plan: Plan, n_envs: int) -> OnPolicyAlgorithm:
    """:return: a model in its worlds, not yet trained"""
    recurrent, size = algorithm is RecurrentPPO, n_envs * plan.n_steps
    guide = {"guide": untrained_guide(recurrent)} if policy == "GuidedLearnerPolicy" else {}
    return algorithm(
        policy,
        GuideGridVecEnv(LEVEL, n_envs, history=0 if recurrent else DEFAULT_HISTORY, seed=0),
        n_steps=plan.n_steps,
        batch_size=size // plan.n_batches,
        n_epochs=plan.n_epochs,
        learning_rate=1e-3,
        policy_kwargs={**plan.policy_kwargs, **guide},
        seed=0,
        device=device,
    )


def cloned_policy(agent: str, size: str, device: th.device) -> AgentPolicy:
    """:return: an agent to be cloned"""
    kwargs = {"guide": PretrainedGuide.untrained(size=size)} if agent == "guided" else {}
    th.manual_seed(0)
    return AGENTS[agent](observation_space(0), spaces.Discrete(len(ACTIONS)), lambda _: 1e-3, size=size, **kwargs).to(device)


def cloning(
    policy: AgentPolicy, demonstrations: Demonstrations, n_episodes: int, arithmetic: str | None = None
) -> tuple[BC, EpisodeLoader]:
    """:return: what clones batches of so many episodes, and its loader"""
    return episode_bc(
        policy,
        demonstrations,
        batch_size=n_episodes,
        learning_rate=1e-3,
        ent_weight=0.01,
        seed=0,
        arithmetic=arithmetic,
        logger=HierarchicalLogger(Logger(folder=None, output_formats=[])),
    )


@th.no_grad()
def disturb(policy: AgentPolicy) -> None:
    """Move the weights away from where they begin, which is where all messages are equally probable."""
    generator = th.Generator().manual_seed(0)
    for weight in policy.parameters():
        weight += 0.1 * th.randn(weight.shape, generator=generator)


def computed_by_ppo(model: OnPolicyAlgorithm, batch: Any) -> dict[str, th.Tensor]:
    """
    :param model: whose policy computes
    :param batch: of a rollout, on the policy's device
    :return: values, log-probabilities of actions and messages, and the gradient, all on the CPU
    """
    policy, carried = model.policy, ()
    obs, state = policy.obs_to_tensor(model._last_obs)[0], None  # type: ignore[arg-type]
    if policy.carries_memory:
        carried, state = (batch.lstm_states, batch.episode_starts), model._last_lstm_states.pi  # type: ignore[attr-defined]
    values, log_probs, entropies = policy.evaluate_actions(batch.observations, batch.actions.long().flatten(), *carried)
    (values.square().mean() - log_probs.mean() - entropies.mean()).backward()
    found = {"outputs": th.cat([values.flatten(), log_probs, entropies]), "gradient": gradient(policy)}
    if policy.has_symbols:
        found["messages"] = policy.message_log_probs(obs, state)
    return {name: part.detach().cpu() for name, part in found.items()}


def computed_by_cloning(algorithm: BC, batch: dict[str, Any]) -> dict[str, th.Tensor]:
    """
    :param algorithm: whose policy computes
    :param batch: of its loader
    :return: the loss and its gradient, both on the CPU
    """
    policy = algorithm.policy
    obs = {name: th.as_tensor(part).to(policy.device) for name, part in batch["obs"].items()}
    loss = algorithm.loss_calculator(policy, obs, th.as_tensor(batch["acts"]).to(policy.device)).loss
    loss.backward()
    return {"outputs": loss.detach().cpu(), "gradient": gradient(policy).cpu()}


def gradient(policy: AgentPolicy) -> th.Tensor:
    """:return: that of all weights"""
    return th.cat([weight.grad.flatten() for weight in policy.parameters() if weight.grad is not None])


def add_agreement(report: Report, labels: dict[str, str], here: dict[str, th.Tensor], there: dict[str, th.Tensor]) -> bool:
    """
    :param labels: of the row
    :param here: what the CPU computed
    :param there: what the device computed
    :return: whether they agree
    """
    off = {name: (there[name] - value).abs().max().item() for name, value in here.items()}
    off["gradient"] = ((there["gradient"] - here["gradient"]).norm() / here["gradient"].norm()).item()
    tolerance = TOLERANCES[labels["arithmetic"]]
    agree = all(each <= tolerance for each in off.values())
    columns = {name: off.get(name) for name in ("outputs", "messages", "gradient")}
    report.add("Agreement", {**labels, **columns, "tolerance": tolerance, "agree": "yes" if agree else "NO"})
    return agree


@contextmanager
def full_precision() -> Iterator[None]:
    """Let cuDNN round no factors of 32 bits to 19, as it does by default in LSTMs and convolutions."""
    usual = th.backends.cudnn.allow_tf32
    th.backends.cudnn.allow_tf32 = False
    try:
        yield
    finally:
        th.backends.cudnn.allow_tf32 = usual


def compare_learning(report: Report, device: th.device, plan: Plan) -> bool:
    """:return: whether CPU and device compute the same from the same weights and batches, forward and backward, for PPO"""
    agreed = []
    for algorithm, policy in product((PPO, RecurrentPPO), POLICIES):
        here, there = (build(algorithm, policy, each, plan, plan.worlds[0]) for each in (CPU, device))
        here.learn(plan.n_steps * plan.worlds[0])
        batch = next(here.rollout_buffer.get())  # all of the rollout
        disturb(here.policy)
        there.policy.load_state_dict(here.policy.state_dict())
        here.policy.optimizer.zero_grad()
        there._last_obs = here._last_obs
        if algorithm is RecurrentPPO:
            there._last_lstm_states = moved(here._last_lstm_states, device)
        results = computed_by_ppo(here, batch), computed_by_ppo(there, moved(batch, device))
        labels = {"algorithm": algorithm.__name__, "agent": policy, "arithmetic": "float32"}
        agreed.append(add_agreement(report, labels, *results))
    return all(agreed)


def compare_cloning(report: Report, device: th.device, plan: Plan, demonstrations: Demonstrations) -> bool:
    """:return: the same of cloning, in either arithmetic"""
    agreed = []
    for agent, arithmetic in product(AGENTS, TOLERANCES):
        here, there = (cloned_policy(agent, "compact", each) for each in (CPU, device))
        disturb(here)
        there.load_state_dict(here.state_dict())
        found = []
        for policy in (here, there):
            algorithm, loader = cloning(policy, demonstrations, plan.episodes[0], arithmetic)
            found.append(computed_by_cloning(algorithm, next(iter(loader))))
        agreed.append(add_agreement(report, {"algorithm": "cloning", "agent": agent, "arithmetic": arithmetic}, *found))
    return all(agreed)


def moved(parts: Any, device: th.device) -> Any:
    """:return: the same with all tensors on a device"""
    return tree_map_only(th.Tensor, lambda part: part.to(device), parts)


def compare_resumed(report: Report, device: th.device, plan: Plan) -> bool:
    """:return: whether trainings on the CPU go on bit by bit as they would have"""
    exact = True
    for algorithm, place in product((PPO, RecurrentPPO), (CPU, device)):
        for deterministic in (False, True):
            th.use_deterministic_algorithms(deterministic, warn_only=True)
            differences = resumed(algorithm, place, plan)
            labels = {"algorithm": algorithm.__name__, "device": place.type, "deterministic": "yes" if deterministic else "no"}
            report.add("Largest difference of weights after a restart", {**labels, **differences})
            if not differences["resumed"]:
                break
        th.use_deterministic_algorithms(False)
        exact = exact and not (place == CPU and differences["resumed"])
    return exact


def resumed(algorithm: type[OnPolicyAlgorithm], device: th.device, plan: Plan) -> dict[str, float | None]:
    """
    :return: largest difference between weights of a training of four rollouts and of one that was killed after two, with all
        that its checkpoint holds and, on an accelerator, without the device's random stream
    """
    n_envs = min(plan.worlds[0], RESUMED)
    build_it = partial(build, algorithm, "GuidePolicy", device, plan, n_envs)
    with TemporaryDirectory() as folder:
        checkpoint = TrainingCheckpoint(Path(folder) / "training.pt", every_n_rollouts=2)
        whole = build_it().learn(4 * plan.n_steps * n_envs, callback=checkpoint)
        state = load_state(checkpoint.path)

    def difference(random: dict[str, Any]) -> float:
        model = build_it()
        restore_training(model, {**state, "random": random})
        model.learn(2 * plan.n_steps * n_envs, reset_num_timesteps=False)
        weights = zip(whole.policy.parameters(), model.policy.parameters(), strict=True)
        return max((one - other).abs().max().item() for one, other in weights)

    without = None if device == CPU else difference({**state["random"], "accelerator": {}})
    return {"resumed": difference(state["random"]), "without the device's random stream": without}


class Climb:
    """
    Larger and larger batches on one device, until something stops it.

    :param device: where
    :param seconds: that it may take
    """

    def __init__(self, device: th.device, seconds: float) -> None:
        self.device, self.left = device, seconds
        self.stopped: str | None = None  # why
        self.best = 0.0  # frames per second
        self.took = [(0, 0.0)]  # size of each batch, and its seconds

    def step(self, batch: int, measure: Callable[[int, th.device], dict[str, float]]) -> dict[str, Any]:
        """
        :param batch: its size
        :param measure: of a size and a device, "frames/s" and more
        :return: what was measured, with the peak of the device's memory; or, as "frames/s", why nothing was
        """
        if self.stopped is None and self.expected(batch) > self.left:
            self.stopped = "no time"
        if self.stopped is not None:
            return {"frames/s": self.stopped}
        start = time.perf_counter()
        found = within_memory(partial(measure, batch, self.device), self.device)
        self.took.append((batch, time.perf_counter() - start))
        self.left -= self.took[-1][1]
        if found is None:
            self.stopped = "no memory"
            return {"frames/s": self.stopped}
        if found["frames/s"] < FASTER * self.best:
            self.stopped = "no faster"
        self.best = max(self.best, found["frames/s"])
        return found

    def expected(self, batch: int) -> float:
        """:return: seconds of a batch, if they grow as they did between the last two; of the first one, nothing is known"""
        if len(self.took) == 1:
            return 0.0
        (few, less), (many, more) = self.took[-2:]
        return more + (more - less) / (many - few) * (batch - many)


def within_memory(measure: Callable[[], dict[str, float]], device: th.device) -> dict[str, Any] | None:
    """:return: what was measured, with the peak of the device's memory where torch counts it; None if memory was full"""
    module = module_of(device)
    counts = hasattr(module, "reset_peak_memory_stats")
    gc.collect()  # models hold themselves
    if counts:
        module.empty_cache()
        module.reset_peak_memory_stats(device)
    try:
        found = measure()
    except RuntimeError as error:  # torch.OutOfMemoryError is one, and Apple's is no more than one
        if "out of memory" not in str(error):
            raise
        return None
    return {**found, "GB": module.max_memory_allocated(device) / 1e9 if counts else None}


def side_by_side(
    report: Report,
    table: str,
    labels: dict[str, Any],
    measure: Callable[[int, th.device], dict[str, float]],
    unit: str,
    batches: Sequence[int],
    columns: Sequence[str],
    climbs: dict[str, Climb | None],
) -> None:
    """
    Add a row for each size of batch until both devices have stopped. "times" is how many times as fast as the CPU the device
    is, "GB" the peak of its memory where torch counts it.

    :param labels: of the rows
    :param measure: see :meth:`Climb.step`
    :param unit: what a batch has so many of
    :param batches: their sizes, from small to large
    :param columns: of what is measured on each device
    :param climbs: of the CPU and of the device, by name; None where it is not measured
    """
    going = [climb for climb in climbs.values() if climb is not None]
    for batch in batches:
        if all(climb.stopped for climb in going):
            return
        found = {name: {} if climb is None else climb.step(batch, measure) for name, climb in climbs.items()}
        cells = {f"{name}: {column}": found[name].get(column) for name in climbs for column in columns}
        here, there = found.values()
        both = all(isinstance(each.get("frames/s"), float) for each in (here, there))
        times = there["frames/s"] / here["frames/s"] if both else None
        report.add(table, {**labels, unit: batch, **cells, "times": times, "GB": there.get("GB")})


class Stopwatch(BaseCallback):
    """Seconds of collecting and of training in each rollout, on any device."""

    def __init__(self) -> None:
        super().__init__()
        self.spent: dict[str, list[float]] = {"train": [], "collect": []}
        self.before = time.perf_counter()

    def mark(self, name: str) -> None:
        """:param name: of what ends now"""
        module_of(self.model.device).synchronize()
        now = time.perf_counter()
        self.spent[name].append(now - self.before)
        self.before = now

    def _on_rollout_start(self) -> None:
        self.mark("train")

    def _on_rollout_end(self) -> None:
        self.mark("collect")

    def _on_training_end(self) -> None:
        self.mark("train")

    def _on_step(self) -> bool:
        return True


def training_speed(
    algorithm: type[OnPolicyAlgorithm], policy: str, plan: Plan, n_envs: int, device: th.device
) -> dict[str, float]:
    """:return: frames per second, and seconds of collecting and training, of the second and third rollout"""
    model, watch = build(algorithm, policy, device, plan, n_envs), Stopwatch()
    size = plan.n_steps * n_envs
    model.learn(3 * size, callback=watch)
    collect, train = (float(np.mean(watch.spent[name][-2:])) for name in ("collect", "train"))
    return {"frames/s": size / (collect + train), "collect, s": collect, "train, s": train}


def cloning_speed(
    agent: str, size: str, plan: Plan, demonstrations: Demonstrations, n_episodes: int, device: th.device
) -> dict[str, float]:
    """:return: frames per second of the second epoch, which has two batches or more"""
    n_batches = max(2, plan.n_demonstrations // (8 * n_episodes))
    chosen = np.resize(np.arange(len(demonstrations.episodes)), n_batches * n_episodes)
    repeated = Demonstrations(demonstrations.episodes.select(chosen), LEVEL, {})
    algorithm, _ = cloning(cloned_policy(agent, size, device), repeated, n_episodes)
    for _ in range(2):
        module_of(device).synchronize()
        start = time.perf_counter()
        algorithm.train(n_epochs=1, progress_bar=False)
        module_of(device).synchronize()
    return {"frames/s": len(repeated.episodes.actions) / (time.perf_counter() - start)}


def compare_speed(report: Report, device: th.device, plan: Plan, demonstrations: Demonstrations, end: float) -> None:
    """
    :param end: when to have measured everything, in seconds of ``time.perf_counter``
    """
    ladders: list[tuple[int, Callable[[dict[str, Climb | None]], None], bool]] = []  # each with its share of the time
    for algorithm, policy in TRAININGS:
        labels, measure = {"algorithm": algorithm.__name__, "agent": policy}, partial(training_speed, algorithm, policy, plan)
        columns = ("frames/s", "collect, s", "train, s")
        ladder = partial(side_by_side, report, "Reinforcement learning", labels, measure, "worlds", plan.worlds, columns)
        ladders.append((3, ladder, True))
    for size, agent in product(plan.sizes, AGENTS):
        measure = partial(cloning_speed, agent, size, plan, demonstrations)
        labels = {"agent": agent, "size": size}
        ladder = partial(side_by_side, report, "Cloning", labels, measure, "episodes", plan.episodes, ("frames/s",))
        ladders.append((1, ladder, size != ON_ACCELERATORS_ONLY))
    for index, (share, ladder, on_cpu) in enumerate(ladders):
        seconds = (end - time.perf_counter()) * share / sum(later for later, *_ in ladders[index:])
        there = Climb(device, seconds / 2 if on_cpu else seconds)
        ladder({"CPU": Climb(CPU, seconds / 2) if on_cpu else None, device.type: there})


def measure_all(device: th.device, plan: Plan, seconds: float, out: Path) -> bool:
    """
    :param device: to be compared with the CPU
    :param plan: what is measured
    :param seconds: that everything may take
    :param out: JSON file
    :return: whether the values agree, and the CPU's resumed training is the same
    """
    end = time.perf_counter() + seconds
    name, threads = getattr(module_of(device), "get_device_name", str)(device), th.get_num_threads()
    cloned_in = {each.type: usual_arithmetic(each) for each in (CPU, device)}
    about = {"device": name, "threads": threads, "cloned in": cloned_in, "seconds": seconds, "versions": versions()}
    report = Report(out, about)
    print(f"{name} beside {threads} threads of the CPU; cloning in {cloned_in[device.type]} beside {cloned_in['cpu']}")
    episodes = play(load_expert(LEVEL).policy, LEVEL, mission_seeds("train", plan.n_demonstrations))
    demonstrations = Demonstrations(episodes.select(np.flatnonzero(episodes.successes)), LEVEL, {})
    with full_precision():
        agree = [compare_learning(report, device, plan), compare_cloning(report, device, plan, demonstrations)]
    exact = compare_resumed(report, device, plan)
    compare_speed(report, device, plan, demonstrations, end)
    return all(agree) and exact


def main(
    out: Annotated[Path, typer.Option(help="JSON file for the results.")],
    device: Annotated[str, typer.Option(help="Such as cuda; none takes the accelerator that torch finds.")] = "",
    seconds: Annotated[float, typer.Option(help="That all of it may take.")] = 330,
) -> None:
    """Compare an accelerator with the CPU, or try the comparison on the second device of the tests."""
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # without which CUDA has no deterministic products
    warnings.filterwarnings("ignore", "Converting a tensor with requires_grad", UserWarning)  # as imitation logs a loss
    accelerator = th.device(device) if device else found_accelerator()
    if accelerator == CPU:
        raise typer.BadParameter("the CPU is measured anyway: name an accelerator", param_hint="--device")
    if accelerator is not None:
        th.zeros(1, device=accelerator)  # says at once if it can't be used
        passed = measure_all(accelerator, Plan(), seconds, out)
    else:
        from tests.other_device import other_device

        warnings.filterwarnings("ignore", "for .* copying from a non-meta parameter", UserWarning)  # it does copy
        print("No accelerator was found: this tries the script on the second device of the tests, whose times mean nothing.")
        with other_device() as other:
            passed = measure_all(other, TINY, seconds, out)
    if not passed:
        raise SystemExit("The CPU and the device don't agree: see the tables.")


if __name__ == "__main__":
    typer.run(main)
