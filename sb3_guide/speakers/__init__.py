"""
Trained agents with a channel: for each level a Guide (stage 2) and a Learner that hears it (stage 3), with model cards and
what their words mean.
"""

from pathlib import Path

from sb3_guide.envs import level_of
from sb3_guide.language import Dictionary, read_dictionary
from sb3_guide.policies import AgentPolicy, load_agent
from sb3_guide.policies.folder import AGENT

FOLDER = Path(__file__).parent
DICTIONARY = "dictionary.json"


def speaker_folder(level: str, agent: str) -> Path:
    """
    :param level: name or id of the level
    :param agent: "guide" or "guided"
    :return: folder of the trained agent, as :func:`~sb3_guide.policies.save_agent` writes it; a Guide's can be passed on as
        ``policy_kwargs={"guide": ...}``
    :raises ValueError: if the level is unknown, or there is no such agent for it
    """
    folder = FOLDER / level_of(level).name / agent
    if not (folder / AGENT).is_file():
        trained = ", ".join(sorted(str(path.parent.relative_to(FOLDER)) for path in FOLDER.glob(f"*/*/{AGENT}")))
        raise ValueError(f"there is no trained {agent} for {level_of(level).name}: expected one of {trained}")
    return folder


def load_guide(level: str) -> AgentPolicy:
    """
    Load the trained Guide of a level. Nothing is downloaded, and nothing in its files can execute code.

    :param level: name or id of the level
    :return: a policy that acts through its messages
    :raises ValueError: if the level is unknown, or there is no trained Guide for it
    """
    return load_agent(speaker_folder(level, "guide"))


def load_guided_learner(level: str) -> AgentPolicy:
    """
    Load the trained Learner that hears the Guide of a level. Nothing is downloaded, and nothing in its files can execute code.

    :param level: name or id of the level
    :return: a policy with both, the Guide fine-tuned along
    :raises ValueError: if the level is unknown, or there is no such Learner for it
    """
    return load_agent(speaker_folder(level, "guided"))


def load_dictionary(level: str, agent: str = "guided") -> Dictionary:
    """
    Load what the words of a trained agent mean to it, learned on 500 missions.

    :param level: name or id of the level
    :param agent: "guide" or "guided"
    :return: its dictionary; ``load_dictionary("GoToLocal").word("left")`` is the message to tell the guided Learner
    :raises ValueError: if the level is unknown, or there is no such agent for it
    """
    return read_dictionary(speaker_folder(level, agent) / DICTIONARY)
