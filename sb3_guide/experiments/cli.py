"""The command line: every stage of the paper, and all of them at once."""

import sys
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Agents that guide each other by emergent language. 'sb3-guide reproduce GoToObj' runs all stages of the paper; "
    "the other commands are its stages.",
)

Level = Annotated[str, typer.Option(help="Name of the level, such as GoToObj, or PACKAGE:ID of another environment.")]
Seed = Annotated[int, typer.Option(min=0, help="Of everything that is random in this stage.")]
Threads = Annotated[int, typer.Option(min=1, help="Of torch. Results depend on their number.")]
Resume = Annotated[bool, typer.Option("--resume", help="Continue a run that was killed; do nothing if it has finished.")]
Renew = Annotated[bool, typer.Option("--renew", help="As --resume, but delete a run of other settings and begin anew.")]
Config = Annotated[Path | None, typer.Option(help="YAML file in rl-zoo's format instead of the packaged zoo_configs/.")]
Agent = Annotated[Path, typer.Argument(help="Folder of the agent.")]
Speaker = Annotated[
    str, typer.Argument(help="Folder of an agent with a channel, or 'pretrained' for the shipped guided Learner.")
]
OwnLevel = Annotated[
    str | None, typer.Option(help="Name of the level; may be left out where the agent was trained on one, and is not shipped.")
]
Dataset = Annotated[str, typer.Argument(metavar="DATASET", help="Id of the dataset, such as guidegrid/GoToLocal/expert-v0.")]


class Split(str, Enum):
    """Which missions; no mission is in two of them."""

    train = "train"
    validation = "validation"
    analysis = "analysis"


class Algo(str, Enum):
    """Which algorithm, as rl-zoo names them."""

    ppo = "ppo"
    ppo_lstm = "ppo_lstm"
    a2c = "a2c"


class Kind(str, Enum):
    """Which agent."""

    learner = "learner"
    guide = "guide"
    guided = "guided"


class Page(str, Enum):
    """What is reported of the finished runs."""

    guidance = "guidance"
    channel = "channel"


@app.command()
def expert(
    level: Level,
    out: Annotated[Path, typer.Option(help="Folder for the agent.")],
    seed: Seed = 0,
    threads: Threads = 1,
    resume: Resume = False,
    renew: Renew = False,
    config: Config = None,
    init: Annotated[Path | None, typer.Option(help="Folder of an agent whose weights to start from.")] = None,
    algo: Annotated[Algo, typer.Option(help="SB3's PPO or A2C, or sb3-contrib's RecurrentPPO (ppo_lstm).")] = Algo.ppo_lstm,
) -> None:
    """Stage 1: train an expert, from easier levels to its own, with RecurrentPPO or another of SB3's algorithms."""
    from sb3_guide.experiments.stages.expert import train_expert

    train_expert(level, out, seed, threads, resume, config, init, algo.value, renew)


@app.command()
def record(
    level: Level,
    expert: Annotated[str, typer.Option(help="Folder of the expert, or 'pretrained' for the one that is shipped.")],
    out: Annotated[Path, typer.Option(help="File for the demonstrations (.safetensors).")],
    episodes: Annotated[int, typer.Option(help="Successful episodes to keep.")],
    split: Annotated[Split, typer.Option(help="Missions to play.")] = Split.train,
    threads: Threads = 1,
    minari: Annotated[str | None, typer.Option(help="Id of a dataset of Minari to make of them too.")] = None,
) -> None:
    """Record demonstrations of an expert: its successful episodes."""
    from sb3_guide.experiments.stages.record import record_demonstrations
    from sb3_guide.experts import expert_folder

    if minari:
        from sb3_guide.cloning.minari import free_place

        free_place(level, minari)
    folder = expert_folder(level) if expert == "pretrained" else Path(expert)
    record_demonstrations(level, folder, split.value, episodes, out, threads)
    if minari:
        export_demonstrations(out, minari)


@app.command("export")
def export_demonstrations(
    demos: Annotated[Path, typer.Argument(help="File with demonstrations (.safetensors).")], minari: Dataset
) -> None:
    """Make a dataset of Minari of demonstrations, among the local ones that Minari lists."""
    from sb3_guide.cloning import load_demonstrations
    from sb3_guide.cloning.minari import save_minari

    save_minari(load_demonstrations(demos), minari)


@app.command("import")
def import_demonstrations(
    minari: Dataset, out: Annotated[Path, typer.Argument(help="File for the demonstrations (.safetensors).")]
) -> None:
    """
    Make demonstrations of a local dataset of Minari: one of 'export', or of Minigrid's BabyAI levels. Of demonstrations that
    'record' has made there before, it takes the place, and deletes the record beside them (.json).
    """
    from sb3_guide.cloning import save_demonstrations
    from sb3_guide.cloning.minari import load_minari
    from sb3_guide.experiments.stages.runs import check_result

    recorded = out.with_suffix(".json")  # of demonstrations that were recorded there before
    check_result(recorded, "record")
    save_demonstrations(load_minari(minari), out)
    recorded.unlink(missing_ok=True)


@app.command()
def clone(
    agent: Annotated[Kind, typer.Option(help="Stage 2: learner or guide. Stage 3: guided.")],
    level: Annotated[str, typer.Option(help="Name of the level, or several joined by +, whose demonstrations are pooled.")],
    demos: Annotated[list[Path], typer.Option(help="Folder with train.safetensors and validation.safetensors, a level.")],
    out: Annotated[Path, typer.Option(help="Folder for the agent.")],
    guide: Annotated[str | None, typer.Option(help="Folder of the Guide that is heard, or 'untrained' for a new one.")] = None,
    freeze_guide: Annotated[bool, typer.Option("--freeze-guide", help="Keep that Guide as it is.")] = False,
    hears: Annotated[
        str,
        typer.Option(help="What happens to that Guide's messages: silent, uniform, shuffled, delayed, swapped, or nothing."),
    ] = "spoken",
    init: Annotated[Path | None, typer.Option(help="Folder of a Learner, or of a Guide for its trunk, to start from.")] = None,
    params: Annotated[list[str] | None, typer.Option(help="Hyper-parameter to override, such as n_epochs:5.")] = None,
    tensorboard: Annotated[
        bool, typer.Option("--tensorboard", help="Show validations and pictures of the language in OUT/tensorboard.")
    ] = False,
    seed: Seed = 0,
    threads: Threads = 1,
    resume: Resume = False,
    renew: Renew = False,
    config: Config = None,
) -> None:
    """Stages 2 and 3: clone demonstrations into a Learner, a Guide or a Learner that hears a Guide."""
    from sb3_guide.experiments.stages.clone import clone as clone_agent

    clone_agent(
        *(agent.value, level, demos, out, seed, threads, resume),
        renew=renew,
        guide=guide,
        freeze_guide=freeze_guide,
        hears=hears,
        init=init,
        params=params or (),
        config_file=config,
        tensorboard=tensorboard,
    )


@app.command()
def evaluate(
    agent: Agent,
    level: Level,
    out: Annotated[Path, typer.Option(help="JSON file for the result.")],
    episodes: Annotated[int, typer.Option(help="Missions to play, each of them fresh.")] = 500,
    threads: Threads = 1,
) -> None:
    """Measure an agent's success rate on fresh missions."""
    from sb3_guide.experiments.stages.evaluate import evaluate as evaluate_agent

    evaluate_agent(agent, level, episodes, out, threads)


@app.command()
def analyze(
    agent: Speaker,
    out: Annotated[Path, typer.Option(help="Folder for analysis.json, its figures and episode.gif.")],
    level: OwnLevel = None,
    demos: Annotated[Path | None, typer.Option(help="Demonstrations along which to measure CIC too, as in the paper.")] = None,
    episodes: Annotated[int, typer.Option(help="Missions to play, each of them fresh.")] = 500,
    guide: Annotated[
        str | None, typer.Option(help="Folder of the Guide that it learned from, or 'pretrained', to show how words changed.")
    ] = None,
    threads: Threads = 1,
) -> None:
    """Read an agent's language: what its messages go together with and what they cause, and an episode to watch."""
    from sb3_guide.experiments.stages.analyze import analyze as analyze_agent
    from sb3_guide.experiments.stages.levels import level_of_agent

    folder = folder_of(agent, level)
    before = None if guide is None else folder_of(guide, level_of_agent(folder, level), "guide")
    analyze_agent(folder, level, demos, before, out, threads, episodes)


@app.command()
def ablate(
    agent: Speaker,
    out: Annotated[Path, typer.Option(help="JSON file for the result.")],
    level: OwnLevel = None,
    episodes: Annotated[int, typer.Option(help="Missions to play with each intervention, the same for all.")] = 500,
    threads: Threads = 1,
) -> None:
    """Measure success with messages as spoken, silent, random, shuffled, delayed or changed."""
    from sb3_guide.experiments.stages.ablate import ablate_agent

    ablate_agent(folder_of(agent, level), level, episodes, out, threads)


@app.command()
def speak(
    agent: Speaker,
    out: Annotated[Path, typer.Option(help="Folder for speech.json and walk.png.")],
    level: OwnLevel = None,
    say: Annotated[list[str] | None, typer.Option(help="Message ('w0 w2') or action ('left') to tell it; repeat it.")] = None,
    choreography: Annotated[str | None, typer.Option(help="pirouette, waltz, or a text file with a step a line.")] = None,
    obedience: Annotated[bool, typer.Option("--obedience", help="Tell it 500 random messages; count the obeyed.")] = False,
    seed: Seed = 0,
    threads: Threads = 1,
) -> None:
    """Learn an agent's words, and tell it what to do in them."""
    from sb3_guide.experiments.stages.speak import speak_to

    speak_to(folder_of(agent, level), level, say or [], choreography, obedience, out, seed, threads)


@app.command()
def play(
    agents: Annotated[
        list[str] | None, typer.Argument(help="Folders of agents with a channel, besides those that are shipped.")
    ] = None,
    level: Annotated[
        str | None, typer.Option(help="Name of the level to begin with, or PACKAGE:ID of these agents' own.")
    ] = None,
    host: Annotated[str, typer.Option(help="Address to listen at: by default, of this machine alone.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen at.")] = 8080,
    export: Annotated[Path | None, typer.Option(help="Write a page of episodes (.html), which needs no server.")] = None,
    episodes: Annotated[int, typer.Option(help="Of each agent on that page.")] = 3,
) -> None:
    """Watch agents in the browser, see what each message would do, and speak in the Guide's place."""
    from sb3_guide.experiments.stages.levels import environment
    from sb3_guide.playground import play as playground

    level = None if level is None else environment(level)
    folders = [folder_of(agent, level) for agent in agents or []]
    if export is None:
        playground.play(folders, level, host, port)
    else:
        playground.export(folders, level, episodes, export)


@app.command()
def reproduce(
    levels: Annotated[list[str] | None, typer.Argument(help="Levels of the study, such as GoToObj; all if left out.")] = None,
    study: Annotated[
        str, typer.Option(help="stages, intra, curriculum, multilevel, lowdata, language, channel, or one of your own.")
    ] = "stages",
    out: Annotated[Path, typer.Option(help="Folder for all that is made. Studies may share one.")] = Path("runs/reproduce"),
    seeds: Annotated[int | None, typer.Option(help="Repetitions of stages 2 and 3, if not the study's own number.")] = None,
    cores: Annotated[int, typer.Option(help="Cores to use. Results don't depend on their number.")] = 2,
    conditions: Annotated[Path | None, typer.Option(help="YAML with conditions and studies of your own.")] = None,
) -> None:
    """Run a study of the paper and report it. Call it again to continue after a kill; what is finished is kept."""
    from sb3_guide.experiments.reproduce import reproduce as reproduce_study

    reproduce_study(study, levels or [], seeds, cores, out, conditions)


@app.command()
def collect(
    runs: Annotated[Path, typer.Argument(help="Folder of runs, as 'sb3-guide reproduce' makes it, finished or not.")],
    out: Annotated[Path, typer.Option(help="Folder for curves.csv and finals.csv; other runs that they hold stay.")],
) -> None:
    """Merge all finished runs into two tables."""
    from sb3_guide.experiments.report.tables import write_tables

    write_tables(runs, out)


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(help="Folder with curves.csv and finals.csv.")],
    page: Annotated[Page, typer.Option(help="The paper's claims on guidance, or how much language there is.")] = Page.guidance,
) -> None:
    """Write pages and figures beside the tables of a study: the paper's claims judged, or how much language there is."""
    from sb3_guide.experiments.reproduce import write_pages

    write_pages(page.value, folder)


def folder_of(agent: str, level: str | None, kind: str = "guided") -> Path:
    """
    :param agent: folder, or "pretrained"
    :param level: of the shipped agent
    :param kind: of shipped agent, "guide" or "guided"
    :raises ValueError: if a shipped agent is asked for without a level, or there is none for it
    """
    from sb3_guide.speakers import speaker_folder

    if agent != "pretrained":
        return Path(agent)
    if level is None:
        raise ValueError("which of the shipped agents? expected --level, such as --level GoToLocal")
    return speaker_folder(level, kind)


def main() -> None:
    """Entry point: wrong use ends with one line that says what to do, not with a traceback."""
    try:
        app()
    except ModuleNotFoundError as error:
        sys.exit(f"sb3-guide: {error}: expected the extras too, as by pip install 'sb3-guide[imitation,experiments,minari]'")
    except (ValueError, OSError, RuntimeError) as error:
        sys.exit(f"sb3-guide: {error}")


if __name__ == "__main__":
    main()
