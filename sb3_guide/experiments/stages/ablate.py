"""How much of an agent's success its messages are worth: paired missions, with and without each intervention."""

import time
from pathlib import Path

from sb3_guide.cloning import mission_seeds
from sb3_guide.experiments.stages.levels import level_of_agent
from sb3_guide.experiments.stages.runs import check_result, record, use_threads
from sb3_guide.experiments.stages.statistics import paired_successes, wilson_interval
from sb3_guide.files import write_json
from sb3_guide.language import ablate, ablations, read
from sb3_guide.policies import load_agent


def ablate_agent(agent: Path, level: str | None, n_episodes: int, out: Path, threads: int) -> None:
    """
    :param agent: folder of an agent with a channel
    :param level: see :func:`~sb3_guide.experiments.stages.levels.level_of_agent`
    :param n_episodes: missions to play with each intervention, from the analysis split; how often the agent says what is
        learned on as many of the validation split
    :param out: JSON file to write
    :param threads: of torch
    :raises ValueError: if the agent has no channel or is of another level, or the file holds something else
    """
    check_result(out, "ablate")
    if n_episodes < 2:
        raise ValueError(f"episodes={n_episodes}: expected at least 2, for intervals and tests")
    level = level_of_agent(agent, level)
    use_threads(threads)
    started = time.monotonic()
    policy = load_agent(agent)
    interventions = ablations(read(policy, level, mission_seeds("validation", n_episodes)))
    successes = ablate(policy, level, mission_seeds("analysis", n_episodes), interventions)
    found = {}
    for name, outcome in successes.items():
        low, high = wilson_interval(int(outcome.sum()), len(outcome))
        found[name] = {"success_rate": float(outcome.mean()), "low": low, "high": high}
        if name != "spoken":
            found[name] |= paired_successes(outcome, successes["spoken"])
    out.parent.mkdir(parents=True, exist_ok=True)
    settings = {"level": level, "folder": str(agent), "episodes": n_episodes, "threads": threads}
    write_json(out, {**record("ablate", settings, time.monotonic() - started), "interventions": found})
    for name, row in found.items():
        print(f"{name:10} {row['success_rate']:6.1%}" + (f"   p = {row['p_value']:.2g}" if "p_value" in row else ""))
