"""Demonstrations in the formats of Minari and imitation, there and back."""

import json
from dataclasses import replace
from pathlib import Path

import gymnasium
import h5py
import minari
import numpy as np
import pytest
from gymnasium import spaces
from imitation.algorithms.bc import BC
from imitation.data import rollout
from minari.data_collector import EpisodeBuffer
from stable_baselines3 import PPO
from typer.testing import CliRunner

from sb3_guide import GuideGridVecEnv, load_expert
from sb3_guide.cloning import Demonstrations, load_demonstrations, mission_seeds, play
from sb3_guide.cloning.minari import load_minari, save_minari
from sb3_guide.cloning.trajectories import from_trajectories, to_trajectories
from sb3_guide.envs import bot
from sb3_guide.experiments.cli import app
from tests.cloning.helpers import make_demonstrations

ID = "guidegrid/GoToObj/expert-v0"


@pytest.fixture(autouse=True)
def datasets(tmp_path, monkeypatch):
    """Minari's local datasets, none."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    return tmp_path / "datasets"


@pytest.fixture(scope="module")
def demonstrations() -> Demonstrations:
    episodes = play(load_expert("GoToObj").policy, "GoToObj", mission_seeds("train", 30), deterministic=False)
    chosen = episodes.select(np.flatnonzero(episodes.successes))
    return Demonstrations(chosen, "GoToObj", {"split": "train", "expert": {"level": "GoToObj", "versions": {"numpy": "2"}}})


def same(one: Demonstrations, other: Demonstrations) -> bool:
    arrays, others = one.episodes.arrays(), other.episodes.arrays()
    equal = all(array.dtype == others[name].dtype and np.array_equal(array, others[name]) for name, array in arrays.items())
    return equal and (one.level, one.provenance) == (other.level, other.provenance)


def describe(folder, **entries) -> None:
    """Change the description of a dataset; None deletes an entry."""
    path = folder / ID / "data" / "metadata.json"
    metadata = json.loads(path.read_text()) | entries
    path.write_text(json.dumps({name: entry for name, entry in metadata.items() if entry is not None}))


def test_minari_there_and_back(demonstrations, datasets):
    save_minari(demonstrations, ID)
    assert same(load_minari(ID), demonstrations)
    assert list(minari.list_local_datasets()) == [ID]
    assert [path.name for path in (datasets / "guidegrid" / "GoToObj").iterdir() if path.is_dir()] == ["expert-v0"]


def test_what_minari_shows_is_what_its_own_environment_shows(demonstrations):
    save_minari(demonstrations, ID)
    dataset = minari.load_dataset(ID)
    env = dataset.recover_environment()
    assert env.observation_space == dataset.observation_space
    assert len(dataset) == len(demonstrations.episodes)
    for episode, metadata in zip(dataset, dataset.storage.get_episode_metadata(dataset.episode_indices), strict=True):
        seen, _ = env.reset(seed=metadata["seed"])
        steps = [(seen, 0.0, False, False), *(env.step(action)[:4] for action in episode.actions)]
        for name, values in episode.observations.items():
            assert np.array_equal(values, [step[0][name] for step in steps])
        for time, (_, *told) in enumerate(steps[1:]):
            assert told == [episode.rewards[time], episode.terminations[time], episode.truncations[time]]
        assert episode.terminations.tolist() == [False] * (len(episode) - 1) + [True]


def test_trajectories_there_and_back(demonstrations):
    trajectories = to_trajectories(demonstrations)
    assert same(from_trajectories(trajectories), demonstrations)
    trajectory = trajectories[0]
    assert len(trajectory.obs) == len(trajectory.acts) + 1
    assert trajectory.rews.sum() == pytest.approx(demonstrations.episodes.returns[0])


def test_imitation_clones_its_own_kind_of_them(demonstrations):
    venv = GuideGridVecEnv("GuideGrid-GoToObj-v0", n_envs=1, history=0)
    transitions = rollout.flatten_trajectories(to_trajectories(demonstrations))
    algorithm = BC(
        observation_space=venv.observation_space,
        action_space=venv.action_space,
        rng=np.random.default_rng(0),
        demonstrations=transitions,
        policy=PPO("LearnerPolicy", venv).policy,
        batch_size=8,
    )
    algorithm.train(n_batches=2, progress_bar=False)


def test_imitations_rollouts_become_demonstrations():
    model = load_expert("GoToObj", n_envs=4)
    enough = rollout.make_sample_until(min_episodes=8)
    trajectories = rollout.rollout(model.policy, model.get_env(), enough, np.random.default_rng(0), unwrap=False)
    found = from_trajectories(trajectories, "GoToObj")
    won = [trajectory for trajectory in trajectories if trajectory.rews.sum() > 0]
    assert found.episodes.returns.tolist() == [trajectory.rews.sum() for trajectory in won]
    assert np.array_equal(found.episodes.images, np.concatenate([trajectory.obs.get("image")[:-1] for trajectory in won]))
    with pytest.raises(ValueError, match="episodes without seeds can't be played again"):
        to_trajectories(found)
    with pytest.raises(ValueError, match=r"levels \['None'\]: expected those of one level, or level="):
        from_trajectories(trajectories)


def test_a_dataset_of_minigrids_own_level():
    """Bot's episodes on Minigrid's BabyAI-GoToObj-v0, as Minari keeps those: the mission is a text, one episode has failed."""
    buffers = []
    for seed in range(6):
        env = bot.twin("GoToObj")
        actions = bot.play("GoToObj", seed).actions if seed else np.full(64, 6)
        steps = [(env.reset(seed=seed)[0], 0.0, False, False), *(env.step(action)[:4] for action in actions)]
        seen, rewards, terminations, truncations = zip(*steps, strict=True)
        observations = {
            "direction": np.array([each["direction"] for each in seen]),
            "image": np.stack([each["image"] for each in seen]),
            "mission": [each["mission"] for each in seen],
        }
        ends = (list(part[1:]) for part in (rewards, terminations, truncations))
        buffers.append(EpisodeBuffer(None, seed, None, observations, actions, *ends, {}))
    space = spaces.Dict(
        {
            "direction": spaces.Discrete(4),
            "image": spaces.Box(0, 255, (7, 7, 3), np.uint8),
            "mission": spaces.Text(200),
        }
    )
    with pytest.warns(UserWarning, match="is set to None"):
        minari.create_dataset_from_buffers("babyai/bot-v0", buffers, env="BabyAI-GoToObj-v0", observation_space=space)
    found = load_minari("babyai/bot-v0")
    assert found.episodes.seeds.tolist() == [1, 2, 3, 4, 5]
    assert (found.level, found.provenance) == ("GoToObj", {"minari": "babyai/bot-v0"})
    assert len(to_trajectories(found)) == 5  # which plays them in our engine


def test_episodes_of_another_level_are_not_written(demonstrations, datasets):
    for wrong in (make_demonstrations([2, 3]), replace(demonstrations, level="GoToLocal")):
        with pytest.raises(ValueError, match="are other ones when they are played again, the first of them with seed"):
            save_minari(wrong, ID)
        assert not minari.list_local_datasets()
    save_minari(demonstrations, ID)  # though a half of another one is there
    assert same(load_minari(ID), demonstrations)


@pytest.mark.parametrize("dataset_id", ["GoToObj", "guidegrid/../../x-v0", "", "/tmp/x-v0"])
def test_ids_that_are_none(demonstrations, dataset_id):
    with pytest.raises(ValueError, match="is no id of Minari"):
        save_minari(demonstrations, dataset_id)
    with pytest.raises(ValueError, match="is no id of Minari"):
        load_minari(dataset_id)


def test_a_dataset_is_never_overwritten(demonstrations):
    save_minari(demonstrations, ID)
    with pytest.raises(ValueError, match=f"there is a dataset {ID} already"):
        save_minari(demonstrations.first(1), ID)
    assert same(load_minari(ID), demonstrations)


@pytest.mark.parametrize("missing", [{"observation_space": None}, {"action_space": None}, {}])
def test_loading_runs_nothing_that_a_dataset_names(demonstrations, datasets, missing):
    """Minari would make the environment, here os.mkdir, to find out its spaces."""
    save_minari(demonstrations, ID)
    victim = datasets / "victim"
    spec = json.loads(gymnasium.spec("GuideGrid-GoToObj-v0").to_json())
    describe(datasets, **missing, env_spec=json.dumps({**spec, "entry_point": "os:mkdir", "kwargs": {"path": str(victim)}}))
    if missing:
        with pytest.raises(ValueError, match="expected the spaces of observations and actions"):
            load_minari(ID)
    else:
        assert same(load_minari(ID), demonstrations)
    assert not victim.exists()


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"data_format": "arrow"}, "expected the spaces .* and data_format hdf5"),
        ({"env_spec": '{"id": "CartPole-v1"}'}, "it is of CartPole-v1: expected a level of GuideGrid or BabyAI"),
        ({"env_spec": '{"id": "GuideGrid-GoToMars-v0"}'}, "unknown level 'GoToMars'"),
        ({"env_spec": None}, "env_spec"),
        ({"total_episodes": 10**9}, "holds no usable demonstrations"),
        ({"total_episodes": 0}, "no episode has succeeded"),
        ({"observation_space": '{"type": "Nothing"}'}, "holds no usable demonstrations"),
    ],
)
def test_datasets_that_are_none_of_ours(demonstrations, datasets, entries, message):
    save_minari(demonstrations, ID)
    describe(datasets, **entries)
    with pytest.raises(ValueError, match=message):
        load_minari(ID)


def test_damaged_data_is_an_error(demonstrations, datasets):
    save_minari(demonstrations, ID)
    path = datasets / ID / "data" / "main_data.hdf5"
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(ValueError, match="holds no usable demonstrations"):
        load_minari(ID)


def test_arrays_that_their_file_can_not_hold_are_not_read(demonstrations, datasets):
    save_minari(demonstrations, ID)
    with h5py.File(datasets / ID / "data" / "main_data.hdf5", "a") as file:
        file["episode_0/rewards"].resize((10**13,))
    with pytest.raises(ValueError, match=r"main_data\.hdf5 of \d+ bytes promises arrays of 800\d+ bytes"):
        load_minari(ID)


def test_a_missing_dataset():
    with pytest.raises(
        FileNotFoundError, match=r"there is no dataset no/such-v0 at .*: expected one that 'minari list local'"
    ):
        load_minari("no/such-v0")


def test_one_command_makes_a_dataset_and_others_go_there_and_back(tmp_path):
    def run(*arguments: str | Path) -> None:
        ended = CliRunner().invoke(app, [str(argument) for argument in arguments])
        assert ended.exit_code == 0, ended.exception

    first, second = tmp_path / "first.safetensors", tmp_path / "second.safetensors"
    run(*("record", "--level", "GoToObj", "--expert", "pretrained", "--episodes", 3, "--out", first, "--minari", ID))
    run("import", ID, second)
    assert same(load_demonstrations(first), load_demonstrations(second))
    run("export", second, "guidegrid/GoToObj/copy-v1")
    assert sorted(minari.list_local_datasets()) == ["guidegrid/GoToObj/copy-v1", ID]
    before = first.read_bytes()
    again = ["record", "--level", "GoToObj", "--expert", "pretrained", "--episodes", "2", "--out", str(first), "--minari", ID]
    assert "there is a dataset" in str(CliRunner().invoke(app, again).exception)
    assert first.read_bytes() == before  # as nothing was played
    run("import", ID, first)
    assert not first.with_suffix(".json").exists()  # which told of the recording
