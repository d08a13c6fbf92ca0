"""Who can be watched."""

import pytest

from sb3_guide.experts import expert_folder
from sb3_guide.playground.cast import Cast
from sb3_guide.policies import load_agent, save_agent
from sb3_guide.speakers import load_guide, speaker_folder


def test_shipped_agents_come_along(cast):
    assert list(cast.folders) == [
        f"{level}/{agent}" for level in ("GoToObj", "GoToLocal", "PutNextLocal", "PickupLoc") for agent in ("guided", "guide")
    ]
    assert cast.first == {"agent": "GoToLocal/guided", "level": "GoToLocal", "seed": "3"}
    assert Cast(level="PickupLoc").first["agent"] == "PickupLoc/guided"
    assert Cast([speaker_folder("GoToObj", "guide")]).folders == cast.folders


def test_agents_of_ones_own_come_first(tmp_path):
    save_agent(load_guide("GoToLocal"), tmp_path / "mine", "GoToLocal+PickupLoc")
    cast = Cast([tmp_path / "mine"])
    assert next(iter(cast.folders)) == cast.first["agent"] == str(tmp_path / "mine")
    assert cast.level(str(tmp_path / "mine")) == "GoToLocal"
    assert cast.speaker(str(tmp_path / "mine")).kind == "a Guide, which acts on its own messages, trained on GoToLocal"


def test_an_agent_that_does_not_say_where_it_was_trained(tmp_path):
    save_agent(load_guide("GoToObj"), tmp_path / "mine")
    with pytest.raises(
        ValueError, match="mine does not say where it was trained: expected --level, such as --level GoToLocal"
    ):
        Cast([tmp_path / "mine"])
    assert Cast([tmp_path / "mine"], "GuideGrid-GoToObj-v0").first["level"] == "GoToObj"


def test_agents_without_a_channel():
    with pytest.raises(ValueError, match="LearnerPolicy sends no messages: expected a GuidePolicy or a GuidedLearnerPolicy"):
        Cast([expert_folder("GoToObj")])
    assert load_agent(expert_folder("GoToObj"))


def test_folders_without_an_agent(tmp_path):
    with pytest.raises(FileNotFoundError, match="is no agent's folder"):
        Cast([tmp_path])
