"""The compiled gridworld: Minigrid's BabyAI levels, seed for seed, on arrays of worlds."""
