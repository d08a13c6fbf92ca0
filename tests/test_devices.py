"""Everything with torch in it runs on another device than the CPU, and gives the same there."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch as th
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from typer import BadParameter

from benchmarks import accelerator
from sb3_guide import GuideGridVecEnv, load_agent, load_expert, metrics, save_agent, speak
from sb3_guide.callbacks import CICCallback, SuccessRateCallback, TrainingCheckpoint, restore_training
from sb3_guide.callbacks.checkpoint import load_state, random_streams
from sb3_guide.cloning import Demonstrations, Validation, mission_seeds, play
from sb3_guide.cloning.bc import episode_bc
from sb3_guide.files import read_json
from sb3_guide.language import ablate, ablations, learn, obey, read
from sb3_guide.policies import AgentPolicy, GuidePolicy, RecurrentGuidePolicy, RecurrentLearnerPolicy
from sb3_guide.policies.interventions import INTERVENTIONS, Chosen, Marginal, Scene
from sb3_guide.speakers import speaker_folder
from tests.other_device import other_device
from tests.policies.helpers import make_policy

PLAIN = {"optimizer_kwargs": {"eps": 1e-5}}  # fused updates know real devices only
ALGORITHMS = {
    PPO: {"n_steps": 4, "batch_size": 8, "n_epochs": 2},
    A2C: {},
    RecurrentPPO: {"n_steps": 4, "batch_size": 8, "n_epochs": 2},
}
pytestmark = pytest.mark.filterwarnings("ignore:for .* copying from a non-meta parameter")  # it does what torch says it won't
SEEDS = mission_seeds("validation", 3)


def on_both(compute: Callable[[th.device], Any]) -> tuple[Any, Any]:
    """:return: what is computed on the CPU, and on the other device"""
    alone = compute(th.device("cpu"))
    with other_device() as device:
        return alone, compute(device)


def test_the_other_device_is_another_one():
    with other_device() as device:
        there = th.ones(3, device=device)
        assert (there + 1).sum().item() == 6.0
        assert th.tensor([1.0, 2.0], device=device).cpu().tolist() == [1.0, 2.0]
        with pytest.raises(RuntimeError, match="expected all tensors to be on the same device"):
            there + th.ones(3)
        with pytest.raises(RuntimeError, match="expected a generator of the same device"):
            th.rand(3, device=device, generator=th.Generator())
        with pytest.raises(RuntimeError, match=r"numpy\(\) is not supported"):
            there.numpy()


def test_the_other_device_draws_from_a_stream_of_its_own(tmp_path):
    with other_device() as device:
        th.manual_seed(0)  # of both streams
        before = th.get_rng_state()
        drawn = th.rand(3, device=device)
        th.save(drawn, tmp_path / "drawn.pt")
        actions = [th.ones(100, device=device).multinomial(9).cpu().tolist() for _ in range(2)]
        assert actions[0] != actions[1]
        assert th.equal(th.get_rng_state(), before)
        assert drawn.cpu().tolist() == th.rand(3).tolist() == th.load(tmp_path / "drawn.pt", weights_only=True).tolist()
    assert not hasattr(th, "meta")


def values(policy: AgentPolicy, device: th.device) -> dict[str, np.ndarray]:
    """:return: the weights of a policy that is on a device"""
    assert policy.device == device
    return {name: weight.detach().cpu().numpy().copy() for name, weight in policy.state_dict().items()}


def assert_close(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> None:
    assert one.keys() == other.keys()
    for name, value in one.items():
        assert np.allclose(value, other[name], atol=1e-5), name


@pytest.mark.parametrize("policy", ["LearnerPolicy", "GuidePolicy", "GuidedLearnerPolicy"])
@pytest.mark.parametrize("algorithm", ALGORITHMS, ids=lambda algorithm: algorithm.__name__)
def test_training_with_callbacks(algorithm, policy, tmp_path):
    save_agent(make_policy(RecurrentGuidePolicy if algorithm is RecurrentPPO else GuidePolicy), tmp_path / "guide")
    kwargs = {**PLAIN, **({"guide": str(tmp_path / "guide")} if policy == "GuidedLearnerPolicy" else {})}

    def train(device: th.device) -> dict[str, np.ndarray]:
        callbacks = [SuccessRateCallback(), *([] if policy == "LearnerPolicy" else [CICCallback()])]
        env = GuideGridVecEnv("GuideGrid-GoToObj-v0", 2, seed=0)
        model = algorithm(policy, env, seed=0, policy_kwargs=kwargs, device=device, **ALGORITHMS[algorithm])
        th.manual_seed(1)  # weights were drawn on the CPU; from now on its stream and the other device's draw the same
        model.learn(8, callback=callbacks)
        save_agent(model.policy, tmp_path / device.type)
        return values(model.policy, device)

    trained, there = on_both(train)
    assert_close(trained, there)
    assert_close(trained, values(load_agent(tmp_path / "meta"), th.device("cpu")))


@pytest.mark.parametrize("algorithm", [PPO, RecurrentPPO])
def test_training_goes_on_where_it_was_interrupted(algorithm, tmp_path):
    def build() -> OnPolicyAlgorithm:
        env = GuideGridVecEnv("GuideGrid-GoToObj-v0", 2, seed=0)
        return algorithm("GuidePolicy", env, seed=0, policy_kwargs=PLAIN, device=device, **ALGORITHMS[algorithm])

    def resume(state: dict[str, Any]) -> dict[str, np.ndarray]:
        resumed = build()
        restore_training(resumed, state)
        assert resumed.num_timesteps == 8
        resumed.learn(8, reset_num_timesteps=False)
        return values(resumed.policy, device)

    with other_device() as device:
        whole = build().learn(16, callback=TrainingCheckpoint(tmp_path / "training.pt", every_n_rollouts=1))
        state, expected = load_state(tmp_path / "training.pt"), values(whole.policy, device)
        assert all(np.array_equal(weight, expected[name]) for name, weight in resume(state).items())
        other_draws = resume({**state, "random": {**state["random"], "accelerator": {}}})  # from a stream that was seeded anew
        assert not all(np.array_equal(weight, expected[name]) for name, weight in other_draws.items())


@pytest.fixture(scope="module")
def demonstrations() -> Demonstrations:
    episodes = play(load_expert("GoToObj").policy, "GoToObj", mission_seeds("train", 8))
    return Demonstrations(episodes.select(np.flatnonzero(episodes.successes)), "GoToObj", {})


def shipped(agent: str) -> AgentPolicy:
    """:return: an agent with carried memory, the shipped one if it has a channel"""
    return make_policy(RecurrentLearnerPolicy) if agent == "learner" else load_agent(speaker_folder("GoToObj", agent))


def torch_streams(device: th.device) -> list[th.Tensor]:
    """:return: states of torch's generators, the CPU's and the device's"""
    streams = random_streams(device)
    return [streams["torch"], *streams["accelerator"].values()]


@pytest.mark.parametrize("agent", ["learner", "guide", "guided"])
def test_cloning_and_validation(agent, demonstrations):
    def clone(device: th.device) -> dict[str, float]:
        policy = shipped(agent).to(device)
        algorithm, _ = episode_bc(policy, demonstrations, batch_size=4, learning_rate=1e-3, ent_weight=0.01, seed=0)
        validation = Validation(policy, SEEDS, [demonstrations])
        before = torch_streams(device)
        algorithm.train(n_epochs=1, on_epoch_end=validation, progress_bar=False)
        assert policy.device == device
        assert all(map(th.equal, torch_streams(device), before))  # the noise is the loss's own, which checkpoints keep
        return validation.history[0]

    cloned, there = on_both(clone)
    assert cloned == pytest.approx(there, abs=1e-2)  # products are rounded to 16 bits


def test_reading_and_speaking():
    def use(device: th.device) -> tuple[Any, ...]:
        agent = shipped("guided").to(device)
        reading = read(agent, "GoToObj", SEEDS)
        words = replace(learn(reading), counts=np.where(np.eye(9, 7, dtype=bool), 99, 0))  # one for each action
        _, taken = obey(agent, "GoToObj", words, SEEDS, np.random.default_rng(0))
        successes = ablate(agent, "GoToObj", SEEDS, ablations(reading))
        told, _ = speak(agent, GuideGridVecEnv("GuideGrid-GoToObj-v0", 4, history=0, seed=0).reset(), "w0 w1")
        influences = metrics.cic(reading.message_log_probs, reading.action_log_probs)
        return reading.messages, taken, np.array(list(successes.values())), told, influences.numpy()

    for found, there in zip(*on_both(use), strict=True):
        assert np.allclose(found, there, atol=1e-4)


@pytest.mark.parametrize("name", [*INTERVENTIONS, "marginal", "chosen"])
def test_interventions(name):
    made = {"marginal": Marginal((1 / 9,) * 9), "chosen": Chosen((0, 2))}
    intervention = made[name] if name in made else INTERVENTIONS[name]()

    def hear(device: th.device) -> list:
        spoken = th.nn.functional.one_hot(th.arange(12).view(6, 2) % 3, 3).float().to(device)
        scene = Scene(th.tensor([0, 0, 1, 1, 1, 2], device=device), lambda: th.zeros(6, 4))
        heard = intervention(spoken, scene, th.Generator().manual_seed(0))
        assert heard.device == device
        return heard.cpu().tolist()

    heard, there = on_both(hear)
    assert heard == there


def test_metrics():
    spoken, acted = th.randn(5, 9).log_softmax(dim=-1), th.randn(5, 9, 7).log_softmax(dim=-1)
    messages = th.tensor([0, 3, 8, 1, 1])

    def measure(device: th.device) -> list[float]:
        m, s, a = (part.to(device) for part in (messages, spoken, acted))
        each = [metrics.cic(s, a), metrics.cic_as_published(s, a), metrics.uniform_cic(a), metrics.influence(m, s, a)]
        return [*th.cat([*each, metrics.message_entropy(s)]).cpu().tolist(), metrics.positive_signalling(s)]

    measured, there = on_both(measure)
    assert measured == pytest.approx(there, abs=1e-6)


def test_the_comparison_of_an_accelerator_with_the_cpu_can_be_tried_without_one(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(accelerator, "found_accelerator", lambda: None)
    accelerator.main(tmp_path / "found.json", seconds=600)
    tables = read_json(tmp_path / "found.json")["tables"]
    assert list(tables) == ["Agreement", "Largest difference of weights after a restart", "Reinforcement learning", "Cloning"]
    agreement, restart, *speeds = tables.values()
    assert [row["agree"] for row in agreement] == ["yes"] * 12
    assert [row["resumed"] for row in restart] == [0.0] * 4
    assert [bool(row["without the device's random stream"]) for row in restart] == [False, True] * 2
    for table in speeds:
        assert all(row["CPU: frames/s"] > 0 and row["meta: frames/s"] > 0 for row in table)
    printed = capsys.readouterr().out
    assert "whose times mean nothing" in printed
    assert printed.count("\n| ") == sum(map(len, tables.values())) + len(tables)


def test_batches_grow_until_something_stops_them():
    def measure(batch: int, device: th.device) -> dict[str, float]:
        if batch == 64:
            raise th.cuda.OutOfMemoryError("CUDA out of memory")
        return {"frames/s": 100.0 * min(batch, most)}

    def climb(seconds: float) -> list[Any]:
        steps = accelerator.Climb(th.device("cpu"), seconds)
        return [steps.step(batch, measure)["frames/s"] for batch in (1, 4, 16, 64, 256)]

    most = 64
    assert climb(60.0) == [100.0, 400.0, 1600.0, "no memory", "no memory"]
    assert climb(0.0) == [100.0, *["no time"] * 4]
    assert climb(-1.0) == ["no time"] * 5
    most = 4
    assert climb(60.0) == [100.0, 400.0, 400.0, *["no faster"] * 2]


def test_the_cpu_is_not_compared_with_itself(tmp_path):
    with pytest.raises(BadParameter, match="name an accelerator"):
        accelerator.main(tmp_path / "found.json", device="cpu")
