"""A run that was killed and restored equals one that was not."""

import numpy as np
import pytest
import torch as th
from sb3_contrib import RecurrentPPO
from stable_baselines3 import A2C, PPO
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from sb3_guide.callbacks import StopTrainingOnSuccessRate, SuccessRateCallback, TrainingCheckpoint, restore_training
from sb3_guide.callbacks.checkpoint import load_state, save_state
from sb3_guide.envs import GuideGridVecEnv
from sb3_guide.policies import PretrainedGuide

STEPS, WORLDS = 16, 4
ROLLOUT = STEPS * WORLDS


def build(algorithm, policy="LearnerPolicy", **policy_kwargs):
    kwargs = {} if algorithm is A2C else {"batch_size": 32, "n_epochs": 2}
    schedule = lambda progress: 1e-3 * progress  # noqa: E731
    venv = VecMonitor(GuideGridVecEnv("GuideGrid-GoToObj-v0", WORLDS))
    return algorithm(policy, venv, n_steps=STEPS, learning_rate=schedule, seed=3, policy_kwargs=policy_kwargs, **kwargs)


HEARD_AT_RANDOM = {"policy": "GuidedLearnerPolicy", "hears": "uniform"}


@pytest.mark.parametrize(("algorithm", "agent"), [(PPO, {}), (A2C, {}), (RecurrentPPO, {}), (RecurrentPPO, HEARD_AT_RANDOM)])
def test_resumed_equals_uninterrupted(algorithm, agent, tmp_path):
    agent = agent and {**agent, "guide": PretrainedGuide.untrained()}
    watchers = [SuccessRateCallback(), StopTrainingOnSuccessRate(1.0, n_episodes=1000)]
    checkpoint = TrainingCheckpoint(tmp_path / "training.pt", watchers, lambda: {"seconds": 1.5}, every_n_rollouts=5)
    whole = build(algorithm, **agent).learn(8 * ROLLOUT, callback=[*watchers, checkpoint])

    np.random.seed(99)  # noqa: NPY002  # whatever the streams were, they are restored
    th.manual_seed(99)
    state = load_state(tmp_path / "training.pt")
    resumed = build(algorithm, **agent)
    restored = [SuccessRateCallback(), StopTrainingOnSuccessRate(1.0, n_episodes=1000)]
    restore_training(resumed, state, restored)
    assert resumed.num_timesteps == 5 * ROLLOUT
    resumed.learn(3 * ROLLOUT, callback=restored, reset_num_timesteps=False)

    assert state["seconds"] == 1.5
    assert [list(watcher.successes) for watcher in restored] == [list(watcher.successes) for watcher in watchers]
    assert resumed.num_timesteps == whole.num_timesteps
    assert [info["l"] for info in resumed.ep_info_buffer] == [info["l"] for info in whole.ep_info_buffer]
    for name, weight in whole.policy.state_dict().items():
        assert th.equal(weight, resumed.policy.state_dict()[name]), name


@pytest.mark.parametrize("accelerator", [None, {"cuda": th.zeros(16, dtype=th.uint8)}], ids=["earlier version", "elsewhere"])
def test_a_stream_that_is_not_this_devices_changes_nothing(accelerator, tmp_path):
    whole = build(PPO).learn(2 * ROLLOUT, callback=TrainingCheckpoint(tmp_path / "training.pt", every_n_rollouts=1))
    state = load_state(tmp_path / "training.pt")
    assert state["random"].pop("accelerator") == {}  # of the CPU
    if accelerator is not None:
        state["random"]["accelerator"] = accelerator
    for _ in range(2):  # no training changes what another one begins with
        resumed = build(PPO)
        restore_training(resumed, state)
        resumed.learn(ROLLOUT, reset_num_timesteps=False)
        assert all(th.equal(weight, resumed.policy.state_dict()[name]) for name, weight in whole.policy.state_dict().items())


@pytest.mark.parametrize(
    ("env", "message"),
    [
        ("GuideGrid-GoToObj-v0", "the state of a DummyVecEnv can't be told: expected GuideGridVecEnv"),
        (VecNormalize(GuideGridVecEnv("GoToObj", 2), norm_obs=False), "the state of a VecNormalize would be lost"),
    ],
    ids=["worlds", "wrapper"],
)
def test_what_can_not_be_restored_is_refused_at_once(env, message, tmp_path):
    model = PPO("LearnerPolicy", env, n_steps=16)
    with pytest.raises(ValueError, match=message):
        model.learn(16, callback=TrainingCheckpoint(tmp_path / "training.pt"))
    assert model.num_timesteps == 0


def test_a_damaged_checkpoint_is_named(tmp_path):
    path = tmp_path / "training.pt"
    build(PPO).learn(3 * ROLLOUT, callback=[TrainingCheckpoint(path, every_n_rollouts=1)])
    whole = path.read_bytes()
    changed = bytearray(whole)
    changed[-1000] ^= 1
    for content in (whole[:1000], changed, b"", b"\n"):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"checkpoint .*training\.pt is damaged"):
            load_state(path)


def test_a_checkpoint_of_an_earlier_version_is_read_with_a_warning(tmp_path):
    th.save({"epoch": 3}, tmp_path / "cloning.pt")
    with pytest.warns(UserWarning, match="is of an earlier version and has no checksum"):
        assert load_state(tmp_path / "cloning.pt") == {"epoch": 3}


def test_a_checkpoint_executes_no_code(tmp_path):
    class Evil:
        def __reduce__(self):
            return (print, ("executed",))

    save_state(tmp_path / "training.pt", {"policy": Evil()})
    with pytest.raises(ValueError, match="is damaged"):
        load_state(tmp_path / "training.pt")
