"""Compiles what numba compiles in this package, once on a machine: the levels' engine, then the agents' networks."""

from sb3_guide.cloning import mission_seeds, play
from sb3_guide.envs.batch import compile_engine
from sb3_guide.experts import expert_folder
from sb3_guide.policies import load_agent
from sb3_guide.speakers import speaker_folder


def main() -> None:
    """Fill numba's cache before stages that run side by side would each compile the same."""
    compile_engine()
    for folder in (expert_folder("GoToObj"), speaker_folder("GoToObj", "guided")):
        play(load_agent(folder), "GoToObj", mission_seeds("train", 1))


if __name__ == "__main__":
    main()
