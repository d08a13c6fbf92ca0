"""
Print pip constraints that give every dependency its lowest supported version, as pyproject.toml has it. Torch is the pinned
one: older ones are only served with several gigabytes of CUDA.
"""

import re
from pathlib import Path

import tomllib

ROOT = Path(__file__).parents[2]
EXTRAS = ("imitation", "experiments")


def main() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [requirement for extra in EXTRAS for requirement in project["optional-dependencies"][extra]]
    for requirement in (*project["dependencies"], *extras):
        name, lowest = re.match(r"([\w-]+)>=([\w.]+)", requirement).groups()  # type: ignore[union-attr]
        if name != "torch":
            print(f"{name}=={lowest}")
    print(*re.findall(r"^torch==.*$", (ROOT / "constraints.txt").read_text(), flags=re.MULTILINE))


if __name__ == "__main__":
    main()
