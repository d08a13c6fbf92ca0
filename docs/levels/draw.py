"""Draw the pictures of docs/levels.md: `python docs/levels/draw.py`. Prints the missions that belong to them."""

from pathlib import Path

from PIL import Image

from sb3_guide.envs import LEVELS, GuideGridEnv

WIDEST = 352  # pixels

for seed, name in enumerate(LEVELS):
    env = GuideGridEnv(name, render_mode="rgb_array")
    env.reset(seed=seed)
    picture = Image.fromarray(env.render())
    picture.reduce(-(-picture.width // WIDEST)).save(Path(__file__).with_name(f"{name}.png"), optimize=True)
    print(f"{name}: {env.mission}")
