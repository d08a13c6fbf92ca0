"""
What becomes of corrupted files: `python -m benchmarks.faults --cases 100000 --out docs/results/faults.json`

Each case takes a file as this package writes it, damages it (bits flipped; parts cut out, doubled, moved or taken from another
file; keys removed, doubled, given huge numbers, NaN or another type; code hidden in it) and reads it. The reader must refuse
it with an error that is documented, or return what the file meant before; without a crash, a hang, more than a gigabyte or
code run. Some are sealed anew, with a checksum that is right: these must be refused or be within bounds. Every case is a
function of its kind and number. A worker process reads; if it dies or hangs, that is counted and the next one goes on.
"""

from __future__ import annotations

import argparse
import copy
import io
import json
import os
import resource
import selectors
import shutil
import signal
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch as th
import yaml
from stable_baselines3 import PPO
from tqdm import tqdm

from sb3_guide.callbacks.checkpoint import first_line, load_state, save_state
from sb3_guide.cloning import Demonstrations, Episodes, load_demonstrations, save_demonstrations
from sb3_guide.envs import observation_space
from sb3_guide.envs.spaces import action_space
from sb3_guide.experiments.stages.clone import shared_config
from sb3_guide.experiments.stages.configs import in_use, load_config
from sb3_guide.experiments.stages.expert import build, build_callbacks
from sb3_guide.experiments.workflow.conditions import load_catalogue
from sb3_guide.files import checksum, read_arrays, read_json, write_arrays, write_json
from sb3_guide.policies import load_agent, save_agent
from sb3_guide.policies.folder import AGENT, NETWORK, Description, read_agent
from sb3_guide.policies.recurrent import RecurrentGuidedLearnerPolicy, RecurrentGuidePolicy, RecurrentLearnerPolicy

GIGABYTE = 2**30
SECONDS = 60  # of computing, after which a case hangs
SILENCE = 1200  # seconds after which a worker that says nothing is ended
REFUSALS = (ValueError, FileNotFoundError)
CODE = {"os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "socket.connect", "ctypes.dlopen"}
HUGE: tuple[Any, ...] = (10**9, -1, 2**31, 2**63, 10**40, 1e308, float("nan"), float("inf"))
STRANGE: tuple[Any, ...] = (None, True, 0, "", "x" * 1000, [], {}, [[[[]]]], [0.5], {"x": 1}, "lin_nan", -0.0, "\udcff")
TAGS = (
    "!!python/object/apply:os.system [touch hacked]",
    "!!python/name:os.system ''",
    "!!binary x",
    "!!timestamp x",
    "&a [*a]",
)
OUTCOMES = ("refused", "as before", "within bounds", "read with a warning", "crash", "hang", "memory", "code run")


# Damage to bytes ----------------------------------------------------------------------------------------------------------


def place(content: bytes, rng: np.random.Generator) -> tuple[int, int]:
    """:return: where a part of a file begins and ends; the first kilobyte, where most of the meaning is, half of the time"""
    end = min(len(content), 1024) if rng.random() < 0.5 else len(content)
    start = int(rng.integers(end + 1))
    return start, min(len(content), start + int(rng.geometric(1 / 16)))


def flip(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    start, _ = place(content, rng)
    return (
        content[:start] + bytes(byte ^ 1 << int(rng.integers(8)) for byte in content[start : start + 1]) + content[start + 1 :]
    )


def truncate(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    return content[: place(content, rng)[0]]


def cut(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    start, end = place(content, rng)
    return content[:start] + content[end:]


def double(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    start, end = place(content, rng)
    return content[:end] + content[start:]


def move(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    (start, end), to = place(content, rng), place(content, rng)[0]
    return content[:to] + content[start:end] + content[to:]


def blank(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    start, end = place(content, rng)
    return content[:start] + bytes([int(rng.choice([0, 32, 255]))]) * (end - start) + content[end:]


def splice(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    start, _ = place(content, rng)
    return content[:start] + other[start:]


def double_line(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    lines = content.split(b"\n")
    lines.insert(int(rng.integers(len(lines) + 1)), lines[int(rng.integers(len(lines)))])
    return b"\n".join(lines)


DAMAGES = (flip, flip, flip, truncate, cut, double, move, blank, splice, double_line)


def damaged(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """:return: the file with one to three damages"""
    for _ in range(int(rng.integers(1, 4))):
        content = DAMAGES[int(rng.integers(len(DAMAGES)))](content, other, rng)
    return content


# Damage to what JSON and YAML say -----------------------------------------------------------------------------------------


def containers(value: Any) -> Iterator[Any]:
    """:return: every dict and list in a value that isn't empty"""
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    if len(inside):
        yield value
    for each in inside:
        yield from containers(each)


def misstated(value: Any, rng: np.random.Generator) -> Any:
    """:return: the value with one to three of its entries gone, renamed, or something else"""
    value = copy.deepcopy(value)
    for _ in range(int(rng.integers(1, 4))):
        if not (found := list(containers(value))):
            return value
        chosen = found[int(rng.integers(len(found)))]
        keys = list(chosen) if isinstance(chosen, dict) else list(range(len(chosen)))
        key = keys[int(rng.integers(len(keys)))]
        act = rng.random()
        if act < 0.2:
            del chosen[key]
        elif act < 0.3 and isinstance(chosen, dict):
            chosen[f"{key}s"] = chosen.pop(key)
        else:
            pool = HUGE if rng.random() < 0.5 else STRANGE
            chosen[key] = copy.deepcopy(pool[int(rng.integers(len(pool)))])
    return value


# The four kinds of files --------------------------------------------------------------------------------------------------


class Kind:
    """
    A kind of file.

    :param folder: in which the originals are made and the damaged ones written
    """

    files: dict[str, Any]  # originals by name

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def damage(self, rng: np.random.Generator) -> bool:
        """:return: whether what was damaged was sealed anew"""
        raise NotImplementedError

    def read(self, name: str) -> Any:
        """:return: what the damaged file means, to be compared"""
        raise NotImplementedError


class Agents(Kind):
    """Learner, Guide and guided Learner of the compact size."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        made: dict[str, Any] = {}
        for kind in (RecurrentLearnerPolicy, RecurrentGuidePolicy, RecurrentGuidedLearnerPolicy):
            guide = {"guide": folder / "RecurrentGuidePolicy"} if kind is RecurrentGuidedLearnerPolicy else {}
            policy = kind(observation_space(0), action_space(), lambda _: 0.0, **guide)
            save_agent(policy, folder / kind.__name__, "GoToObj")
            made[kind.__name__] = {file: (folder / kind.__name__ / file).read_bytes() for file in (AGENT, NETWORK)}
        self.files, self.names = made, list(made)

    def damage(self, rng: np.random.Generator) -> bool:
        name, other = (self.names[int(index)] for index in rng.choice(3, 2, replace=False))
        files, how = dict(self.files[name]), rng.random()
        if how < 0.6:
            file = AGENT if rng.random() < 0.5 else NETWORK
            files[file] = damaged(files[file], self.files[other][file], rng)
        elif how < 0.65:
            files[NETWORK] = self.files[other][NETWORK]
        elif how < 0.75:
            files[AGENT] = as_json(misstated(json.loads(files[AGENT]), rng))
        write(self.folder / "damaged", files)
        if how >= 0.75:
            self.seal_anew(self.folder / "damaged", rng, checked=how < 0.95)
        return how >= 0.75

    def seal_anew(self, folder: Path, rng: np.random.Generator, checked: bool) -> None:
        """Change the description or a weight, and write the checksum of it, or none as the format before."""
        content, (arrays, _) = json.loads((folder / AGENT).read_bytes()), read_arrays(folder / NETWORK)
        del content["sha256"]
        if rng.random() < 0.8:
            content = misstated(content, rng)
        else:
            name = list(arrays)[int(rng.integers(len(arrays)))]
            arrays[name] = misshapen(arrays[name], rng)
        write_arrays(folder / NETWORK, arrays)
        write_json(folder / AGENT, {**content, "sha256": checksum(arrays, content)} if checked else {**content, "format": 1})

    def read(self, name: str) -> Any:
        policy = load_agent(self.folder / name)
        assert all(weight.isfinite().all() for weight in policy.state_dict().values())
        return asdict(read_agent(self.folder / name)[0]), policy.state_dict()


class Sets(Kind):
    """Demonstrations of a few episodes."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        for seed, level in enumerate(("GoToObj", "GoToLocal")):
            episodes, expert = episodes_of([3, 1, 5], seed), asdict(Description("LearnerPolicy", {"size": "compact"}, 0))
            save_demonstrations(Demonstrations(episodes, level, {"split": "train", "expert": expert}), folder / level)
        self.files = {level: (folder / level).read_bytes() for level in ("GoToObj", "GoToLocal")}

    def damage(self, rng: np.random.Generator) -> bool:
        how = rng.random()
        if how < 0.75:
            write(self.folder, {"damaged": damaged(self.files["GoToObj"], self.files["GoToLocal"], rng)})
            return False
        arrays, header = read_arrays(self.folder / "GoToObj")
        if how < 0.85:
            write_arrays(
                self.folder / "damaged", arrays, {name: said(value) for name, value in misstated(header, rng).items()}
            )
            return False
        del header["sha256"]
        if rng.random() < 0.5:
            header = {**header, "provenance": json.dumps(misstated(json.loads(header["provenance"]), rng))}
        else:
            name = list(arrays)[int(rng.integers(len(arrays)))]
            arrays[name] = misshapen(arrays[name], rng)
        if how > 0.97:
            header["format"] = "sb3-guide demonstrations 1"
        seal = checksum(arrays, None if how > 0.97 else header)
        write_arrays(self.folder / "damaged", arrays, {**header, "sha256": seal})
        return True

    def read(self, name: str) -> Any:
        found = load_demonstrations(self.folder / name)
        return found.episodes.arrays(), found.level, found.provenance


class Configs(Kind):
    """Hyper-parameters of PPO and of cloning, and now and then conditions, of which each takes a fifth of a second."""

    PPO = """\
# of an expert
GuideGrid-GoToObj-v0: &room
  policy: LearnerPolicy
  n_envs: 4
  n_timesteps: 1600
  n_steps: 16
  batch_size: 32
  n_epochs: 1
  learning_rate: lin_0.001
  gamma: 0.99
  env_kwargs: {history: 3}
  policy_kwargs:
    net_arch: [16]
    optimizer_kwargs: {fused: true}
  callback:
    - sb3_guide.callbacks.StopTrainingOnSuccessRate:
        success_rate: 0.99
GuideGrid-GoToLocal-v0:
  <<: *room
"""
    BC = """\
GuideGrid-GoToObj-v0:
  recorded_episodes: 1000
  train_episodes: 1000
  validation_episodes: 500
  analysis_episodes: 500
  n_epochs: 8
  validate_every: 1
  validate_at: [0, 0.0625, 0.5, 2.5]
  batch_size: 32
  learning_rate: lin_0.001
  ent_weight: 0.01
"""
    CONDITIONS = """\
conditions:
  later: {agent: guided, guide: guide, hears: delayed}
  short: {agent: learner, params: {n_epochs: 2}}
studies:
  mine:
    grids:
      - {levels: [GoToObj], conditions: [later, short], seeds: 2}
    expert: pretrained
    analyze: [later]
"""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.files = {"ppo": self.PPO.encode(), "bc": self.BC.encode(), "conditions": self.CONDITIONS.encode()}
        self.parsed = {name: yaml.safe_load(content) for name, content in self.files.items()}
        write(folder, self.files)

    def damage(self, rng: np.random.Generator) -> bool:
        name, other = (str(each) for each in rng.choice(list(self.files), 2, replace=False, p=(0.49, 0.49, 0.02)))
        content, how = self.files[name], rng.random()
        if how < 0.5:
            content = damaged(content, self.files[other], rng)
        elif how < 0.9:
            content = yaml.safe_dump(misstated(self.parsed[name], rng)).encode()
        else:
            lines = content.decode().splitlines()
            line = int(rng.integers(len(lines)))
            lines[line] = f"{lines[line].partition(':')[0]}: {TAGS[int(rng.integers(len(TAGS)))]}"
            content = "\n".join(lines).encode()
        write(self.folder, {"damaged": content})
        self.name = name
        return True  # a text that people write has no checksum

    def read(self, name: str) -> Any:
        path, kind = self.folder / name, self.name if name == "damaged" else name
        if kind == "conditions":
            catalogue = load_catalogue(path)
            return catalogue.conditions, [catalogue.runs(study) for study in set(catalogue.studies) & {"mine"}]
        if kind == "bc":
            return shared_config(["GoToObj"], path)
        config = load_config("ppo", "GoToObj", path)
        if config != self.parsed["ppo"]["GuideGrid-GoToObj-v0"]:
            with in_use(config):
                build(PPO, "GoToObj", 0, config)
                build_callbacks(config)
        return config


class Checkpoints(Kind):
    """States of a training."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        for seed in (0, 1):
            weights = {"weight": th.arange(100.0) + seed, "bias": th.zeros(7)}
            rows = [{"epoch": 1, "loss": 0.5}, {"epoch": 2, "loss": 0.25 + seed}]
            save_state(folder / f"state{seed}", {"policy": weights, "rows": rows, "random": (3, None, "x"), "seconds": 1.5})
        self.files = {name: (folder / name).read_bytes() for name in ("state0", "state1")}

    def damage(self, rng: np.random.Generator) -> bool:
        content, how = self.files["state0"], rng.random()
        packed = content[len(first_line(b"")) :]
        if how < 0.8:
            content = damaged(content, self.files["state1"], rng)
        elif how < 0.85:
            content = damaged(packed, self.files["state1"], rng)  # as earlier versions wrote it
        elif how < 0.95:
            packed = damaged(packed, self.files["state1"], rng)
            content = first_line(packed) + packed
        else:
            hidden = io.BytesIO()
            th.save({"policy": Hidden()}, hidden)
            content = first_line(hidden.getvalue()) + hidden.getvalue()
        write(self.folder, {"damaged": content})
        return how >= 0.8

    def read(self, name: str) -> Any:
        return load_state(self.folder / name)


class Hidden:
    """Runs a command where it is unpickled."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str]]:
        return os.system, ("touch hacked",)


KINDS: dict[str, type[Kind]] = {"agents": Agents, "demonstrations": Sets, "configs": Configs, "checkpoints": Checkpoints}


def episodes_of(lengths: list[int], seed: int) -> Episodes:
    """:return: episodes of these lengths, which nobody played"""
    rng, frames, episodes = np.random.default_rng(seed), sum(lengths), len(lengths)
    return Episodes(
        images=rng.integers(1, 3, (frames, 7, 7, 3), dtype=np.uint8),
        actions=rng.integers(0, 7, frames, dtype=np.uint8),
        missions=rng.integers(1, 26, (episodes, 72), dtype=np.uint8),
        offsets=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        returns=np.full(episodes, 0.5),
        seeds=np.arange(episodes, dtype=np.int64),
    )


def misshapen(array: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """:return: the array with another shape, type, or a value that it should not have"""
    how = rng.integers(5)
    if how == 0:
        return array[..., :-1] if array.ndim else array
    if how == 1:
        return array.astype([np.float16, np.int8, np.float64, np.uint8, np.bool_][int(rng.integers(5))])
    if how == 2:
        return array.reshape(-1)
    array = array.copy()
    extreme = np.iinfo(array.dtype).max if array.dtype.kind in "iu" else [np.nan, np.inf, -np.inf][int(rng.integers(3))]
    array.reshape(-1)[int(rng.integers(array.size))] = extreme
    return array


def said(value: Any) -> str:
    """:return: as a header can hold it"""
    return str(value).encode(errors="replace").decode()


def as_json(content: Any) -> bytes:
    """:return: as files hold it"""
    return json.dumps(content, indent=2).encode()


def write(folder: Path, files: dict[str, bytes]) -> None:
    """Write damaged files."""
    folder.mkdir(exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)


def same(one: Any, other: Any) -> bool:
    """:return: whether two things that were read mean the same"""
    if type(one) is not type(other):
        return False
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(value, other[key]) for key, value in one.items())
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, th.Tensor | np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and bool((one == other).all())
    return bool(one == other)


# Judging ------------------------------------------------------------------------------------------------------------------


class Hung(BaseException):
    """A case took too long."""


def work(name: str, first: int, last: int) -> None:
    """Read the cases of a range, and print the outcome of each."""
    folder = Path(tempfile.mkdtemp(prefix="faults", dir="/dev/shm"))
    os.chdir(folder)
    index, seen, started = list(KINDS).index(name), [], False
    try:
        kind = KINDS[name](folder)
        originals = [kind.read(each) for each in kind.files]
        sys.addaudithook(lambda event, _: seen.append(event) if started and event in CODE else None)
        signal.signal(signal.SIGPROF, hang)
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (taken + GIGABYTE, taken + GIGABYTE))
        for case in range(first, last):
            sealed = kind.damage(np.random.default_rng([index, case]))
            started = True
            outcome, words = judged(kind, originals, sealed)
            started = False
            if seen or Path("hacked").exists():
                outcome, words = "code run", str(seen)
            seen.clear()
            print(json.dumps([outcome, words[:300]]), flush=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def hang(*_: Any) -> None:
    """Of the watchdog."""
    raise Hung


def judged(kind: Kind, originals: list[Any], sealed: bool) -> tuple[str, str]:
    """:return: outcome of the damaged file that stands there, and what was said; a splice may be all of another original"""
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found = kind.read("damaged")
    except Hung:
        return "hang", ""
    except Exception as error:
        causes = [error, error.__cause__, error.__context__]
        if any(isinstance(each, MemoryError) or "allocate" in str(each) for each in causes):
            return "memory", repr(error)
        return ("refused" if isinstance(error, REFUSALS) else "crash"), repr(error)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    if any("earlier version" in str(each.message) for each in said):
        return "read with a warning", ""
    if any(same(found, original) for original in originals):
        return "as before", ""
    return ("within bounds" if sealed else "crash"), "" if sealed else "read as something else"


def run(name: str, cases: int) -> tuple[Counter[str], list[dict[str, Any]]]:
    """
    :param name: of a kind
    :param cases: how many
    :return: how often each outcome came, and the cases that should not be
    """
    counts: Counter[str] = Counter()
    bad = []
    with tqdm(total=cases, desc=name, unit="case", mininterval=5) as progress:
        while progress.n < cases:
            command = [sys.executable, "-m", "benchmarks.faults", "--worker", name, str(progress.n), str(cases)]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as worker:
                for outcome, words in outcomes(worker):
                    counts[outcome] += 1
                    if outcome in OUTCOMES[4:]:
                        bad.append({"kind": name, "case": progress.n, "outcome": outcome, "said": words})
                        progress.write(str(bad[-1]))
                    progress.update()
            if progress.n < cases:
                counts["crash"] += 1
                bad.append(
                    {"kind": name, "case": progress.n, "outcome": "crash", "said": f"worker ended: {worker.returncode}"}
                )
                progress.write(str(bad[-1]))
                progress.update()
    return counts, bad


def outcomes(worker: subprocess.Popen[str]) -> Iterator[tuple[str, str]]:
    """:return: what a worker says, until it ends, or is ended as it says nothing any more"""
    assert worker.stdout is not None
    with selectors.DefaultSelector() as selector:
        selector.register(worker.stdout, selectors.EVENT_READ)
        while selector.select(timeout=SILENCE):
            if not (line := worker.stdout.readline()):
                return
            yield tuple(json.loads(line))
    worker.kill()


def main() -> None:
    """Run all cases, print a table, write it down; the exit status is 1 if one of them should not be."""
    parser = argparse.ArgumentParser(description="Read corrupted files.")
    parser.add_argument("--cases", type=int, default=100_000, help="of all kinds together")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--out", type=Path, help="JSON file for the numbers; those of other kinds in it stay")
    parser.add_argument("--worker", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        work(arguments.worker[0], *map(int, arguments.worker[1:]))
        return
    print(f"| | cases | {' | '.join(OUTCOMES)} |\n|{'---|' * (len(OUTCOMES) + 2)}")
    fine = True
    for name in arguments.kinds:
        counts, bad = run(name, arguments.cases // len(arguments.kinds))
        numbers = [counts[outcome] for outcome in OUTCOMES]
        print(f"| {name} | {counts.total():,} | {' | '.join(f'{number:,}' for number in numbers)} |", flush=True)
        if arguments.out:
            known = read_json(arguments.out) if arguments.out.exists() else {}
            row = {"cases": counts.total(), **dict(zip(OUTCOMES, numbers, strict=True)), "bad": bad}
            write_json(arguments.out, {**known, name: row})
        fine = fine and not bad
    sys.exit(not fine)


if __name__ == "__main__":
    main()
