"""The stages, each for real and as small as can be."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch as th
import yaml
from filelock import FileLock
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from typer.main import get_command

from sb3_guide.cloning import load_demonstrations, save_demonstrations
from sb3_guide.experiments.cli import app
from sb3_guide.experiments.stages import record, runs
from sb3_guide.experiments.stages.analyze import analyze
from sb3_guide.experiments.stages.clone import Cloning, clone
from sb3_guide.experiments.stages.evaluate import evaluate
from sb3_guide.experiments.stages.expert import train_expert
from sb3_guide.experiments.stages.record import record_demonstrations
from sb3_guide.experiments.stages.runs import read_table
from sb3_guide.policies import (
    GuidePolicy,
    LearnerPolicy,
    MessageShape,
    RecurrentGuidedLearnerPolicy,
    RecurrentGuidePolicy,
    RecurrentLearnerPolicy,
    load_agent,
    save_agent,
)
from sb3_guide.policies.folder import read_agent
from sb3_guide.policies.interventions import Silent
from tests.policies.helpers import make_policy

KEY = "GuideGrid-GoToObj-v0"
PPO = {"policy": "LearnerPolicy", "n_envs": 4, "n_timesteps": 64 * 25, "n_steps": 16, "batch_size": 32, "n_epochs": 1}
CURRICULUM = PPO | {
    "callback": [
        {
            "sb3_guide.callbacks.Curriculum": {
                "parts": [
                    {"level": "GoToObjMazeS4", "n_timesteps": 64 * 3},  # over before the first checkpoint
                    {"level": "GoToLocal", "n_timesteps": 64 * 4, "learning_rate": "lin_0.001"},
                    {"level": "GoToObj", "n_timesteps": 64 * 12, "ent_coef": 0.01},
                ]
            }
        }
    ]
}
BC = {
    "train_episodes": 10,
    "validation_episodes": 4,
    "analysis_episodes": 6,
    "n_epochs": 3,
    "validate_every": 1,
    "validate_at": [0, 0.5],
    "batch_size": 4,
    "learning_rate": "lin_0.001",
    "ent_weight": 0.01,
}


def write_config(path: Path, entry: dict) -> Path:
    path.write_text(yaml.safe_dump({KEY: entry}))
    return path


def weights(folder: Path) -> dict[str, th.Tensor]:
    return load_agent(folder).state_dict()


def equal(one: Path, other: Path) -> bool:
    return all(th.equal(weight, weights(other)[name]) for name, weight in weights(one).items())


def without_times(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    return [{name: value for name, value in row.items() if name != "seconds" and not name.startswith("time/")} for row in rows]


@pytest.fixture(scope="module")
def demos(tmp_path_factory) -> Path:
    """Demonstrations of an expert that always goes forward, which solves one mission in twenty."""
    folder = tmp_path_factory.mktemp("demos")
    policy = make_policy(LearnerPolicy)
    th.nn.init.constant_(policy.action_net.bias[2:3], 10.0)
    save_agent(policy, folder / "expert", "GoToObj")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(record, "WORST_EXPERT", 0.0)
        for split in ("train", "validation", "analysis"):
            record_demonstrations("GoToObj", folder / "expert", split, 10, folder / f"{split}.safetensors", threads=1)
    return folder


@pytest.mark.parametrize(("begun", "here"), [("float32", "bfloat16"), ("bfloat16", "float32")])
def test_a_run_goes_on_in_the_arithmetic_that_it_began_in(tmp_path, demos, capsys, monkeypatch, begun, here):
    config = write_config(tmp_path / "bc.yml", {**BC, "train_episodes": 10, "batch_size": 10})
    settings = {"seed": 0, "threads": 1, "config_file": config}
    computes = "sb3_guide.experiments.stages.clone.usual_arithmetic"

    after_epoch = Cloning.after_epoch

    def stop_after_first(self):
        after_epoch(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(computes, lambda device: begun)
    clone("learner", KEY, [demos], tmp_path / "whole", resume=False, **settings)
    monkeypatch.setattr(Cloning, "after_epoch", stop_after_first)
    with pytest.raises(KeyboardInterrupt):
        clone("learner", KEY, [demos], tmp_path / "stopped", resume=False, **settings)
    monkeypatch.setattr(Cloning, "after_epoch", after_epoch)
    assert json.loads((tmp_path / "stopped" / "settings.json").read_text())["arithmetic"] == begun
    monkeypatch.setattr(computes, lambda device: here)
    capsys.readouterr()
    clone("learner", KEY, [demos], tmp_path / "stopped", resume=True, **settings)
    told = capsys.readouterr().err
    assert f"goes on in {begun}, as it began; a new run would compute in {here} here" in told
    assert ("has no units for bfloat16" in told) == (begun == "bfloat16")
    assert equal(tmp_path / "stopped", tmp_path / "whole")
    clone("learner", KEY, [demos], tmp_path / "other", resume=False, params=[f"arithmetic:{here}"], **settings)
    assert json.loads((tmp_path / "other" / "run.json").read_text())["arithmetic"] == here
    assert not equal(tmp_path / "other", tmp_path / "whole")
    with pytest.raises(ValueError, match="arithmetic='float16': expected one of float32, bfloat16"):
        clone("learner", KEY, [demos], tmp_path / "none", resume=False, params=["arithmetic:float16"], **settings)


def test_an_expert_is_written_with_all_that_it_depends_on(tmp_path):
    config = write_config(tmp_path / "ppo.yml", PPO)
    train_expert(KEY, tmp_path / "expert", seed=1, threads=1, resume=False, config_file=config)
    assert isinstance(load_agent(tmp_path / "expert"), RecurrentLearnerPolicy)
    run = json.loads((tmp_path / "expert" / "run.json").read_text())
    assert (run["stage"], run["level"], run["seed"], run["threads"], run["config"]) == ("expert", "GoToObj", 1, 1, PPO)
    assert run["versions"]["torch"] == th.__version__
    rows = read_table(tmp_path / "expert" / "progress.csv")
    assert [int(row["time/total_timesteps"]) for row in rows] == [64 * (n + 1) for n in range(25)]
    assert 0 <= float(rows[-1]["rollout/success_rate"]) <= 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"n_steps": 2**18}, "a rollout would hold 229638144 values: expected at most 134217728"),
        ({"env_kwargs": {"history": 10**6}}, "history=1000000 in 4 worlds: expected 0 to"),
        ({"policy_kwargs": {"hat": 1}}, "can't be used .TypeError: .*'hat'"),
        ({"callback": 3}, "can't be used .TypeError"),
        ({"gamma": -3}, "gamma=-3: expected a number from 0 to 1"),
        ({"learning_rate": float("nan")}, "learning_rate=nan: expected a number"),
        ({"callback": "other.Callback"}, "callback 'other.Callback' is unknown"),
        ({"gamma": "abc"}, "gamma='abc': expected a number"),
        ({"vf_coef": None}, "vf_coef=None: expected a number"),
        ({"target_kl": "x"}, "target_kl='x': expected a number"),
        ({"n_envs": 1.5}, "n_envs=1.5: expected a whole number from 1 to"),
        ({"policy": "MlpLstmPolicy"}, "policy='MlpLstmPolicy': expected LearnerPolicy, GuidePolicy or GuidedLearnerPolicy"),
        ({"callback": [{}]}, "callback None is unknown"),
    ],
)
def test_hyper_parameters_that_cannot_be_used(changes, message, tmp_path):
    config = write_config(tmp_path / "ppo.yml", PPO | changes)
    with pytest.raises(ValueError, match=message):
        train_expert(KEY, tmp_path / "expert", seed=1, threads=1, resume=False, config_file=config)


def test_the_same_seed_gives_the_same_expert_on_two_threads(tmp_path):
    config = write_config(tmp_path / "ppo.yml", PPO | {"n_envs": 32, "batch_size": 512, "n_timesteps": 1024})
    try:
        for name in ("one", "same"):
            train_expert(KEY, tmp_path / name, seed=1, threads=2, resume=False, config_file=config)
    finally:
        th.set_num_threads(1)
    assert equal(tmp_path / "one", tmp_path / "same")


@pytest.mark.parametrize(
    ("stage", "config"),
    [(["expert"], PPO), (["expert"], CURRICULUM), (["clone", "--agent", "guide"], BC | {"n_epochs": 8})],
    ids=["expert", "curriculum", "clone"],
)
def test_a_killed_stage_goes_on_as_if_nothing_had_happened(stage, config, demos, tmp_path):
    """Kill a process of it once its first checkpoint is there, continue it, and compare with an undisturbed run."""
    config = write_config(tmp_path / "config.yml", config)
    of_stage = [*stage, "--demos", str(demos)] if "clone" in stage else stage
    of_stage = [*of_stage, "--level", "GoToObj", "--config", str(config), "--threads", "1", "--seed", "5"]

    def command(*options: str) -> None:
        """Run the stage here, which spares the start of a process."""
        get_command(app).main([*of_stage, "--out", *options], standalone_mode=False)

    command(str(tmp_path / "whole"))
    program = [sys.executable, "-m", "sb3_guide.experiments.cli", *of_stage]
    killed = subprocess.Popen([*program, "--out", tmp_path / "killed"], stderr=subprocess.DEVNULL)
    while not list((tmp_path / "killed").glob("checkpoint/*.pt")):
        assert killed.poll() is None
        time.sleep(0.01)
    os.kill(killed.pid, signal.SIGKILL)
    killed.wait()
    assert not (tmp_path / "killed" / "run.json").exists()
    command(str(tmp_path / "killed"), "--resume")
    assert equal(tmp_path / "whole", tmp_path / "killed")
    whole, resumed = (without_times(read_table(tmp_path / name / "progress.csv")) for name in ("whole", "killed"))
    assert whole == resumed


def test_demonstrations_are_successful_and_say_where_they_come_from(demos):
    train = load_demonstrations(demos / "train.safetensors")
    assert train.level == "GoToObj"
    assert len(train.episodes) == 10
    assert train.episodes.successes.all()
    assert train.provenance["expert"]["policy"] == "LearnerPolicy"
    beside = json.loads((demos / "train.json").read_text())
    assert beside["episodes"] == 10
    assert beside["frames"] == len(train.episodes.actions)
    assert beside["expert_success_rate"] == 10 / train.provenance["missions_played"]


def test_an_expert_that_fails_is_not_recorded(tmp_path):
    save_agent(make_policy(LearnerPolicy), tmp_path / "expert")
    with pytest.raises(ValueError, match=r"the expert solved \d+ of \d+ missions of GoToObj: train it longer"):
        record_demonstrations("GoToObj", tmp_path / "expert", "train", 10, tmp_path / "train.safetensors", threads=1)
    assert not (tmp_path / "train.safetensors").exists()


def test_a_guide_is_no_expert(tmp_path):
    save_agent(make_policy(RecurrentGuidePolicy), tmp_path)
    with pytest.raises(
        ValueError, match="holds a RecurrentGuidePolicy: expected one of LearnerPolicy, RecurrentLearnerPolicy"
    ):
        record_demonstrations("GoToObj", tmp_path, "train", 10, tmp_path / "train.safetensors", threads=1)


def test_stage_two_and_three(demos, tmp_path):
    config = write_config(tmp_path / "bc.yml", BC)
    shared = {"level": "GoToObj", "demos": [demos], "seed": 0, "threads": 1, "resume": False, "config_file": config}
    guide = str(tmp_path / "guide")
    clone("learner", out=tmp_path / "learner", **shared)
    clone("guide", out=tmp_path / "guide", tensorboard=True, **shared)
    clone("guided", out=tmp_path / "guided", guide=guide, **shared)
    clone("guided", out=tmp_path / "frozen", guide=guide, freeze_guide=True, **shared)
    guide = load_agent(tmp_path / "guide").channel.speaker.state_dict()
    frozen = load_agent(tmp_path / "frozen", RecurrentGuidedLearnerPolicy).channel.speaker.state_dict()
    tuned = load_agent(tmp_path / "guided").channel.speaker.state_dict()
    assert all(th.equal(guide[name], frozen[name]) for name in guide)
    assert not all(th.equal(guide[name], tuned[name]) for name in guide)
    columns = {"epoch", "episodes", "loss", "success_rate", "mean_length", "seconds"}
    communication = {"cic", "uniform_cic", "message_entropy", "tempered_cic"}
    for agent in ("learner", "guide", "guided"):
        rows = read_table(tmp_path / agent / "progress.csv")
        assert [float(row["epoch"]) for row in rows] == [0, 0.5, 1, 2, 3]
        assert [int(row["episodes"]) for row in rows] == [0, 4, 8, 16, 24]
        assert rows[0].keys() == columns | (communication if agent != "learner" else set())
    events = EventAccumulator(str(tmp_path / "guide" / "tensorboard"), size_guidance={"images": 0})
    events.Reload()
    for shown in (events.Scalars("rollout/success_rate"), events.Images("guide/actions"), events.Images("guide/episode")):
        assert [part.step for part in shown] == [0, 1, 2, 4, 6]  # updates

    evaluate(tmp_path / "guided", "GoToObj", 6, tmp_path / "evaluation.json", threads=1)
    found = json.loads((tmp_path / "evaluation.json").read_text())
    by_clone = json.loads((tmp_path / "guided" / "evaluation.json").read_text())
    assert found["successes"] == by_clone["successes"]
    assert found["episodes"] == 6
    assert found["low"] <= found["success_rate"] == found["successes"] / 6 <= found["high"]

    of_analysis = demos / "analysis.safetensors"
    analyze(tmp_path / "guided", None, of_analysis, tmp_path / "guide", tmp_path / "analysis", threads=1, n_episodes=20)
    found = json.loads((tmp_path / "analysis" / "analysis.json").read_text())
    assert len(found["messages"]) == len(found["counts"]) == 9
    assert sum(map(sum, found["counts"])) == found["frames"]
    for measures in (found["in_play"], found["along_demonstrations"]):
        assert 0 <= measures["cic"]["mean"] <= measures["message_entropy"]["mean"]
        assert all(measure["low"] - 1e-6 <= measure["mean"] <= measure["high"] + 1e-6 for measure in measures.values())
    assert found["topographic_similarity"].keys() == {"value", "low", "high", "by_chance", "p_value"}
    assert len(found["episode"]["influence"]) == len(found["episode"]["messages"])
    assert (tmp_path / "analysis" / "episode.gif").read_bytes().startswith(b"GIF89a")
    for name in ("actions.png", "situations.png", "cells.png", "change.png"):
        assert (tmp_path / "analysis" / name).read_bytes().startswith(b"\x89PNG")
    kept, last = (read_agent(tmp_path / "guided" / folder)[0] for folder in ("highest_cic", ""))
    assert kept == last


def test_controls(demos, tmp_path):
    """A silent channel, an untrained Guide, a reader of a Guide's messages, and a Learner with a Guide's trunk."""
    config = write_config(tmp_path / "bc.yml", BC | {"n_epochs": 1})
    shared = {"level": "GoToObj", "demos": [demos], "seed": 0, "threads": 1, "resume": False, "config_file": config}
    guide = tmp_path / "guide"
    clone("guide", out=guide, **shared)
    clone("guided", out=tmp_path / "silent", guide=str(guide), hears="silent", **shared)
    clone("guided", out=tmp_path / "untrained", guide="untrained", **shared)
    clone("guide", out=tmp_path / "reader", guide=str(guide), freeze_guide=True, **shared)
    clone("learner", out=tmp_path / "transfer", init=guide, params=["learning_rate:0.0"], **shared)
    silent = load_agent(tmp_path / "silent")
    assert isinstance(silent.channel.intervention, Silent)
    speaker = load_agent(guide).channel.speaker.state_dict()
    for name, weight in load_agent(tmp_path / "reader", RecurrentGuidePolicy).channel.speaker.state_dict().items():
        assert th.equal(weight, speaker[name])
    for name, weight in load_agent(tmp_path / "transfer").network.state_dict().items():
        assert th.equal(weight, speaker[name])
    for name in ("silent", "untrained", "reader", "transfer"):
        assert (tmp_path / name / "evaluation.json").exists()


def test_a_channel_without_symbols(demos, tmp_path):
    """Hyper-parameters within policy_kwargs are overridden one by one; nothing is enumerated, shown or kept for its CIC."""
    config = write_config(tmp_path / "bc.yml", BC | {"n_epochs": 1, "policy_kwargs": {"message_length": 1, "size": "compact"}})
    shared = {"level": "GoToObj", "demos": [demos], "seed": 0, "threads": 1, "resume": False, "config_file": config}
    clone("guide", out=tmp_path / "guide", params=["policy_kwargs:{channel: continuous}"], tensorboard=True, **shared)
    shared["config_file"] = write_config(tmp_path / "guided.yml", BC | {"n_epochs": 1})
    clone("guided", out=tmp_path / "guided", guide=str(tmp_path / "guide"), **shared)
    for agent in ("guide", "guided"):
        assert load_agent(tmp_path / agent).channel.encoder.shape == MessageShape(1, 3, "continuous")
        assert all("cic" not in row for row in read_table(tmp_path / agent / "progress.csv"))
        assert not (tmp_path / agent / "highest_cic").exists()
        with pytest.raises(ValueError, match="continuous channel are not made of symbols"):
            analyze(tmp_path / agent, None, None, None, tmp_path / "analysis", threads=1, n_episodes=2)


def test_levels_are_pooled(demos, tmp_path):
    other = tmp_path / "other"
    for split in ("train", "validation"):
        demonstrations = load_demonstrations(demos / f"{split}.safetensors")
        save_demonstrations(replace(demonstrations, level="GoToLocal"), other / f"{split}.safetensors")
    config = tmp_path / "bc.yml"
    config.write_text(yaml.safe_dump({KEY: BC, "GuideGrid-GoToLocal-v0": BC}))
    shared = {"seed": 0, "threads": 1, "resume": False, "config_file": config}
    clone("learner", "GoToObj+GoToLocal", [demos, other], tmp_path / "pooled", **shared)
    rows = read_table(tmp_path / "pooled" / "progress.csv")
    assert [int(row["episodes"]) for row in rows] == [0, 8, 20, 40, 60]  # of 20 in all
    assert json.loads((tmp_path / "pooled" / "evaluation.json").read_text())["episodes"] == 12
    with pytest.raises(ValueError, match="1 folders of demonstrations for 2 levels: expected one for each"):
        clone("learner", "GoToObj+GoToLocal", [demos], tmp_path / "one", **shared)
    config.write_text(yaml.safe_dump({KEY: BC, "GuideGrid-GoToLocal-v0": BC | {"n_epochs": 4}}))
    with pytest.raises(ValueError, match=r"GoToObj\+GoToLocal are to be pooled but differ in their hyper-parameters"):
        clone("learner", "GoToObj+GoToLocal", [demos, other], tmp_path / "two", **shared)


def test_a_run_whose_settings_have_changed_runs_anew_and_says_so(demos, tmp_path, capsys):
    config = write_config(tmp_path / "bc.yml", BC | {"n_epochs": 1})
    shared = {"level": "GoToObj", "demos": [demos], "threads": 1, "resume": False, "renew": True, "config_file": config}
    clone("learner", out=tmp_path / "out", seed=0, **shared)
    clone("learner", out=tmp_path / "other", seed=1, **shared)
    clone("learner", out=tmp_path / "out", seed=1, **shared)
    assert "(seed), which is deleted" in capsys.readouterr().err
    assert equal(tmp_path / "out", tmp_path / "other")


@pytest.mark.parametrize(
    "mistake",
    [
        {"demos": [Path("none")]},
        {"params": ["train_episodes:1000"]},
        {"params": ["learning_rate:fast"]},
        {"params": ["batch_size:1000"]},
    ],
)
def test_nothing_is_deleted_or_claimed_for_a_clone_that_can_not_begin(mistake, demos, tmp_path):
    config = write_config(tmp_path / "bc.yml", BC | {"n_epochs": 1})
    shared = {"level": "GoToObj", "threads": 1, "seed": 0, "resume": False, "renew": True, "config_file": config}
    clone("learner", demos=[demos], out=tmp_path / "out", **shared)
    for folder in ("out", "new"):
        with pytest.raises((OSError, ValueError)):
            clone("learner", out=tmp_path / folder, **{"demos": [demos], **shared, **mistake})
    assert (tmp_path / "out" / "run.json").is_file()
    assert load_agent(tmp_path / "out")
    clone("learner", demos=[demos], out=tmp_path / "new", **shared | {"renew": False})


@pytest.mark.parametrize(
    "mistake", [{"n_stepss": 3}, {"policy": "MlpLstmPolicy"}, {"gamma": "abc"}, {"init": "guide"}, {"init": "none"}]
)
def test_nothing_is_deleted_or_claimed_for_an_expert_that_can_not_begin(mistake, tmp_path):
    short = PPO | {"n_timesteps": 64}
    good, bad = (write_config(tmp_path / f"{name}.yml", short | more) for name, more in (("good", {}), ("bad", mistake)))
    shared = {"level": "GoToObj", "seed": 0, "threads": 1}
    save_agent(make_policy(GuidePolicy), tmp_path / "guide")
    train_expert(out=tmp_path / "out", resume=False, config_file=good, **shared)
    wrong = {"config_file": good, "init": tmp_path / mistake["init"]} if "init" in mistake else {"config_file": bad}
    for folder in ("out", "new"):
        with pytest.raises((OSError, ValueError)):
            train_expert(out=tmp_path / folder, resume=False, renew=True, **shared, **wrong)
    assert (tmp_path / "out" / "run.json").is_file()
    assert load_agent(tmp_path / "out")
    train_expert(out=tmp_path / "new", resume=False, config_file=good, **shared)


def test_what_a_run_is_made_from_is_not_where_it_is_written(demos, tmp_path):
    config = write_config(tmp_path / "bc.yml", BC | {"n_epochs": 1})
    shared = {"level": "GoToObj", "demos": [demos], "threads": 1, "seed": 0, "resume": False, "config_file": config}
    clone("guide", out=tmp_path / "guide", **shared)
    for out in (tmp_path / "guide", tmp_path):
        with pytest.raises(ValueError, match=r"holds what the run is to be made from .*: choose another --out"):
            clone("guided", out=out, guide=str(tmp_path / "guide"), renew=True, **shared)
    load_agent(tmp_path / "guide")


def test_the_same_demonstrations_recorded_again_are_the_same(demos, tmp_path, capsys):
    config = write_config(tmp_path / "bc.yml", BC | {"n_epochs": 1})
    shared = {"level": "GoToObj", "threads": 1, "seed": 0, "resume": False, "renew": True, "config_file": config}
    for _ in range(3):  # the bytes differ, for the order of a file's header is not kept
        for split in ("train", "validation"):
            save_demonstrations(load_demonstrations(demos / f"{split}.safetensors"), tmp_path / f"{split}.safetensors")
        clone("learner", demos=[tmp_path], out=tmp_path.with_name(f"{tmp_path.name}-out"), **shared)
    assert "deleted" not in capsys.readouterr().err
    validation = load_demonstrations(tmp_path / "validation.safetensors")
    save_demonstrations(validation.first(9), tmp_path / "validation.safetensors")
    clone("learner", demos=[tmp_path], out=tmp_path.with_name(f"{tmp_path.name}-out"), **shared)
    assert "(made_from), which is deleted" in capsys.readouterr().err


@pytest.mark.parametrize("renew", [False, True])
def test_what_no_run_has_made_is_left_alone(demos, tmp_path, renew):
    config = write_config(tmp_path / "bc.yml", BC)
    project, agent = tmp_path / "project", tmp_path / "agent"
    project.mkdir()
    for name, content in (("settings.json", "{}"), ("thesis.txt", "mine"), ("film.partial", "mine")):
        (project / name).write_text(content)
    save_agent(load_agent(demos / "expert"), agent)
    before = (agent / "network.safetensors").read_bytes()
    for out, message in ((project, "is of no run of sb3-guide"), (agent, "holds an agent that no run has made")):
        with pytest.raises(ValueError, match=message):
            clone("learner", "GoToObj", [demos], out, seed=0, threads=1, resume=False, renew=renew, config_file=config)
    assert (project / "thesis.txt").read_text() == (project / "film.partial").read_text() == "mine"
    assert (agent / "network.safetensors").read_bytes() == before


def test_demonstrations_have_a_name_of_their_own(demos, tmp_path):
    with pytest.raises(ValueError, match=r"expected a name that ends in \.safetensors"):
        record_demonstrations("GoToObj", demos / "expert", "train", 10, tmp_path / "train.json", threads=1)


def test_a_full_disk_ends_a_stage_which_goes_on_when_there_is_room(tmp_path):
    config = write_config(tmp_path / "ppo.yml", PPO)
    train_expert(KEY, tmp_path / "whole", seed=1, threads=1, resume=True, config_file=config)
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, usual[1]))  # a checkpoint is larger
    try:
        with pytest.raises(OSError, match="File too large"):
            train_expert(KEY, tmp_path / "full", seed=1, threads=1, resume=True, config_file=config)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    assert not list((tmp_path / "full").rglob("*.pt")) + list((tmp_path / "full").rglob("*.partial"))
    train_expert(KEY, tmp_path / "full", seed=1, threads=1, resume=True, config_file=config)
    assert equal(tmp_path / "whole", tmp_path / "full")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stage_that_is_asked_to_end_says_no_more_than_a_line(number, tmp_path):
    config = write_config(tmp_path / "ppo.yml", PPO | {"n_timesteps": 10**9})
    program = [sys.executable, "-m", "sb3_guide.experiments.cli", "expert", "--level", "GoToObj", "--config", str(config)]
    process = subprocess.Popen([*program, "--out", tmp_path / "out"], stderr=subprocess.PIPE, text=True)
    while not (tmp_path / "out" / "progress.csv").exists():
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(number)
    said = process.communicate(timeout=100)[1]
    assert process.returncode in (-number, 1, 128 + number)
    assert "Traceback" not in said


def test_two_runs_in_one_folder(demos, tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "PATIENCE", 0.1)
    config = write_config(tmp_path / "ppo.yml", PPO)
    busy = pytest.raises(RuntimeError, match="is in use by another call: wait for it, or choose another --out")
    with FileLock(tmp_path / "lock"), busy:
        train_expert(KEY, tmp_path, seed=1, threads=1, resume=True, config_file=config)
    with FileLock(tmp_path / "demos.safetensors.lock"), busy:
        record_demonstrations("GoToObj", demos / "expert", "train", 10, tmp_path / "demos.safetensors", threads=1)


def test_a_run_knows_when_its_guide_has_changed(demos, tmp_path, capsys):
    config = write_config(tmp_path / "bc.yml", BC | {"n_epochs": 1})
    shared = {"level": "GoToObj", "demos": [demos], "threads": 1, "resume": False, "renew": True, "config_file": config}
    for seed in (0, 1):
        clone("guide", out=tmp_path / "guide", seed=seed, **shared)
        clone("guided", out=tmp_path / "guided", seed=0, guide=str(tmp_path / "guide"), **shared)
    assert "(made_from)" in capsys.readouterr().err


def test_a_guide_by_reinforcement_learning_is_analysed(demos, tmp_path):
    callbacks = ["sb3_guide.callbacks.CICCallback"]
    config = write_config(tmp_path / "ppo.yml", PPO | {"policy": "GuidePolicy", "n_timesteps": 128, "callback": callbacks})
    train_expert("GoToObj", tmp_path / "guide", seed=0, threads=1, resume=False, config_file=config, algo="ppo")
    assert "guide/uniform_cic" in read_table(tmp_path / "guide" / "progress.csv")[-1]
    analyze(tmp_path / "guide", None, demos / "analysis.safetensors", None, tmp_path / "analysis", threads=1, n_episodes=20)
    found = json.loads((tmp_path / "analysis" / "analysis.json").read_text())
    assert sum(map(sum, found["counts"])) == found["frames"]


def test_an_expert_starts_from_another_and_stops_early(tmp_path):
    stop = {"sb3_guide.callbacks.StopTrainingOnSuccessRate": {"success_rate": 0.01, "n_episodes": 2}}
    config = write_config(tmp_path / "ppo.yml", PPO | {"learning_rate": 0.0, "n_timesteps": 10_000, "callback": [stop]})
    save_agent(make_policy(LearnerPolicy), tmp_path / "start", "GoToObj")
    train_expert("GoToObj", tmp_path / "out", 1, threads=1, resume=False, config_file=config, init=tmp_path / "start")
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    assert run["init"] == str(tmp_path / "start")
    assert run["frames"] < 10_000
    assert equal(tmp_path / "start", tmp_path / "out")
    assert list((tmp_path / "out" / "tensorboard").glob("events.out.tfevents.*"))


def test_an_expert_that_carries_its_memory_starts_from_one_with_a_window(tmp_path):
    config = write_config(tmp_path / "ppo_lstm.yml", PPO | {"learning_rate": 0.0, "n_timesteps": 64})
    save_agent(make_policy(LearnerPolicy), tmp_path / "start", "GoToObj")
    arguments = {"threads": 1, "resume": False, "config_file": config, "init": tmp_path / "start"}
    train_expert("GoToObj", tmp_path / "out", 1, **arguments)
    assert isinstance(load_agent(tmp_path / "out"), RecurrentLearnerPolicy)
    assert equal(tmp_path / "start", tmp_path / "out")


def test_a_guide_is_no_start_for_a_learner(tmp_path):
    config = write_config(tmp_path / "ppo.yml", PPO)
    save_agent(make_policy(GuidePolicy), tmp_path / "guide")
    with pytest.raises(ValueError, match="holds a GuidePolicy: expected one of LearnerPolicy, RecurrentLearnerPolicy"):
        train_expert("GoToObj", tmp_path / "out", 1, threads=1, resume=False, config_file=config, init=tmp_path / "guide")


def test_an_algorithm_that_is_not_there(tmp_path):
    with pytest.raises(ValueError, match="algo='dqn' is unknown: expected one of ppo, ppo_lstm, a2c"):
        train_expert("GoToObj", tmp_path / "out", seed=0, threads=1, resume=False, algo="dqn")


def test_a_callback_that_is_not_ours(tmp_path):
    config = write_config(tmp_path / "ppo.yml", PPO | {"callback": ["os.system"]})
    with pytest.raises(ValueError, match=r"callback 'os\.system' is unknown: expected one of sb3_guide\.callbacks"):
        train_expert("GoToObj", tmp_path / "out", seed=0, threads=1, resume=False, config_file=config)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"agent": "teacher"}, "agent='teacher' is unknown: expected one of learner, guide, guided"),
        ({"agent": "guided"}, "a guided Learner needs a pretrained Guide: pass its folder with --guide"),
        ({"agent": "learner", "guide": "somewhere"}, "a learner hears no Guide"),
        ({"agent": "learner", "hears": "silent"}, "a learner hears no Guide"),
        ({"agent": "guide", "freeze_guide": True}, "there is no Guide to freeze"),
        ({"agent": "guide", "init": Path()}, "a guide starts from nothing: leave out --init"),
        (
            {"agent": "guided", "guide": "untrained", "hears": "whispers"},
            "intervention 'whispers' is unknown: expected one of",
        ),
        (
            {"agent": "learner", "params": ["epochs:1"]},
            "--params epochs are unknown: expected NAME:VALUE of analysis_episodes",
        ),
        (
            {"agent": "learner", "params": ["policy_kwargs:{message_length: 2}"]},
            r"can't be used \(TypeError: .*'message_length'\)",
        ),
        ({"agent": "guide", "params": ["policy_kwargs:{channel: analog}"]}, "channel='analog' is unknown: expected one of"),
        ({"agent": "learner", "params": ["n_epochs:["]}, r"--params n_epochs:\[: expected values in YAML"),
        (
            {"agent": "learner", "params": ["batch_size:1000000000"]},
            "batch_size=1000000000: expected a whole number from 1 to",
        ),
        ({"agent": "learner", "params": ["train_episodes:11"]}, "train_episodes=11: expected 1 to 10"),
        ({"agent": "learner", "level": "GoToMars"}, "GoToMars"),
        ({"agent": "learner", "threads": 0}, "threads=0: expected at least 1"),
    ],
)
def test_wrong_arguments(arguments, message, demos, tmp_path):
    config = write_config(tmp_path / "bc.yml", BC)
    usual = {"level": "GoToObj", "demos": [demos], "seed": 0, "threads": 1, "resume": False, "config_file": config}
    with pytest.raises(ValueError, match=message):
        clone(out=tmp_path / "out", **{**usual, **arguments})


def test_a_folder_holds_one_run(demos, tmp_path):
    config = write_config(tmp_path / "bc.yml", BC | {"n_epochs": 1})
    shared = {"level": "GoToObj", "demos": [demos], "out": tmp_path / "out", "threads": 1, "config_file": config}
    clone("learner", seed=0, resume=False, **shared)
    written = (tmp_path / "out" / "run.json").read_text()
    clone("learner", seed=0, resume=True, **shared)
    assert (tmp_path / "out" / "run.json").read_text() == written
    with pytest.raises(ValueError, match="holds a run already: pass --resume"):
        clone("learner", seed=0, resume=False, **shared)
    with pytest.raises(ValueError, match=r"holds a run of other settings \(seed\): choose another --out, or pass --renew"):
        clone("learner", seed=1, resume=True, **shared)


def test_demonstrations_of_another_level(demos, tmp_path):
    config = tmp_path / "bc.yml"
    config.write_text(yaml.safe_dump({"GuideGrid-GoToLocal-v0": BC}))
    shared = {"demos": [demos], "out": tmp_path / "out", "seed": 0, "threads": 1, "resume": False, "config_file": config}
    with pytest.raises(ValueError, match="holds demonstrations of GoToObj: expected GoToLocal"):
        clone("learner", level="GoToLocal", **shared)
