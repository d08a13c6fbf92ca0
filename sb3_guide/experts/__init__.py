"""Trained experts (stage 1), a folder for each level with its weights and its model card."""

from pathlib import Path

from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

from sb3_guide.envs import GuideGridVecEnv, level_of
from sb3_guide.policies.agents import LearnerAgent
from sb3_guide.policies.folder import AGENT
from sb3_guide.policies.saving import load_agent, load_weights, weights_of
from sb3_guide.policies.sequences import history_of

FOLDER = Path(__file__).parent


def expert_folder(level: str) -> Path:
    """
    :param level: name or id of the level
    :return: the folder of the level's trained expert, as :func:`~sb3_guide.policies.save_agent` writes it
    :raises ValueError: if the level is unknown, or there is no trained expert for it
    """
    name = level_of(level).name
    if not (FOLDER / name / AGENT).is_file():
        trained = ", ".join(sorted(path.parent.name for path in FOLDER.glob(f"*/{AGENT}")))
        raise ValueError(f"there is no trained expert for {name}: expected one of {trained}; train one with sb3-guide expert")
    return FOLDER / name


def load_expert(level: str, n_envs: int = 1) -> PPO | RecurrentPPO:
    """
    Load the trained expert of a level. Nothing is downloaded, and nothing in its files can execute code.

    :param level: name or id of the level
    :param n_envs: worlds of ``model.get_env()``, in which it can play at once or be trained further
    :return: the expert as a model of SB3, with SB3's default settings for further training: a RecurrentPPO, whose ``predict``
        takes and returns a state, where the expert carries its memory through the episode
    :raises ValueError: if the level is unknown, or there is no trained expert for it
    """
    policy = load_agent(expert_folder(level), LearnerAgent)
    venv = VecMonitor(GuideGridVecEnv(level, n_envs, history=history_of(policy.observation_space)))
    policy_kwargs = {**policy.agent_kwargs, "net_arch": policy.net_arch, "activation_fn": policy.activation_fn}
    model = (RecurrentPPO if policy.carries_memory else PPO)("LearnerPolicy", venv, policy_kwargs=policy_kwargs)
    assert isinstance(model.policy, LearnerAgent)
    load_weights(model.policy, weights_of(policy))
    return model
