"""Observations that no environment is needed for."""

import pytest
import torch as th

from sb3_guide.policies.sequences import Observations
from tests.policies.helpers import HISTORY, random_images, random_missions


@pytest.fixture
def window() -> Observations:
    """Observations of four worlds, 0 to 3 steps into their episodes."""
    history = random_images(4, HISTORY, seed=1)
    began = th.arange(HISTORY) >= HISTORY - th.arange(4).unsqueeze(1)  # (4, HISTORY)
    return {"image": random_images(4), "mission": random_missions(4), "history": history * began[..., None, None, None]}
