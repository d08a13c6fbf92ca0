"""Episodes as arrays, and demonstrations on disk."""

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from safetensors.numpy import load_file, save_file

from sb3_guide.cloning import Demonstrations, Episodes, load_demonstrations, mission_seeds, save_demonstrations
from sb3_guide.cloning.demonstrations import check_space
from sb3_guide.cloning.episodes import concatenate
from sb3_guide.envs import observation_space
from sb3_guide.files import checksum
from tests.cloning.helpers import make_demonstrations, make_episodes


def equal(one: Episodes, other: Episodes) -> bool:
    return all(np.array_equal(one.arrays()[name], array) for name, array in other.arrays().items())


@given(lengths=st.lists(st.integers(1, 9), min_size=1, max_size=6), data=st.data())
def test_selected_episodes_keep_their_frames(lengths, data):
    episodes = make_episodes(lengths)
    chosen = np.array(data.draw(st.lists(st.sampled_from(range(len(lengths))), min_size=1, max_size=6)))
    selected = episodes.select(chosen)
    for row, episode in enumerate(chosen):
        old, new = (slice(*e.offsets[i : i + 2]) for e, i in ((episodes, episode), (selected, row)))
        assert np.array_equal(episodes.images[old], selected.images[new])
        assert np.array_equal(episodes.actions[old], selected.actions[new])
    assert np.array_equal(selected.missions, episodes.missions[chosen])


def test_concatenation_is_undone_by_selection():
    one, other = make_episodes([2, 3], seed=1), make_episodes([4], seed=2)
    both = concatenate([one, other])
    assert equal(both.select(np.array([0, 1])), one)
    assert equal(both.select(np.array([2])), other)


def test_arrays_must_fit():
    arrays = make_episodes([2, 3]).arrays()
    with pytest.raises(ValueError, match="arrays of 2 episodes and 4 frames don't fit together"):
        Episodes(**{**arrays, "actions": arrays["actions"][:4]})


def test_demonstrations_survive_the_disk(tmp_path):
    demonstrations = make_demonstrations([3, 1, 5])
    save_demonstrations(demonstrations, tmp_path / "new" / "train.safetensors")
    loaded = load_demonstrations(tmp_path / "new" / "train.safetensors")
    assert equal(loaded.episodes, demonstrations.episodes)
    assert (loaded.level, loaded.provenance) == ("GoToObj", {"expert": "none"})
    assert [file.name for file in (tmp_path / "new").iterdir()] == ["train.safetensors"]


def test_failed_episodes_are_no_demonstrations():
    with pytest.raises(ValueError, match="2 episodes, 2 of them failed"):
        Demonstrations(make_episodes([1, 2], returns=0.0), "GoToObj", {})


@pytest.mark.parametrize("kept", [0, 7, 100, 0.5, -1])
def test_a_truncated_file_is_named(tmp_path, kept):
    path = tmp_path / "train.safetensors"
    save_demonstrations(make_demonstrations([3, 1, 5]), path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * kept) if isinstance(kept, float) else kept])
    with pytest.raises(ValueError, match=r"train\.safetensors holds no usable demonstrations.*record them anew"):
        load_demonstrations(path)


def test_a_flipped_bit_is_noticed_wherever_it_is(tmp_path):
    path = tmp_path / "train.safetensors"
    save_demonstrations(make_demonstrations([3, 1, 5]), path)
    whole = path.read_bytes()
    header = 8 * (8 + int.from_bytes(whole[:8], "little"))
    for bit in [*range(header), 8 * len(whole) - 1]:
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        with pytest.raises(ValueError, match="holds no usable demonstrations"):
            load_demonstrations(path)


def test_a_file_of_an_earlier_version_is_read_with_a_warning(tmp_path):
    path, demonstrations = tmp_path / "train.safetensors", make_demonstrations([3, 1, 5])
    arrays = demonstrations.episodes.arrays()
    header = {"format": "sb3-guide demonstrations 1", "level": "GoToObj", "provenance": "{}", "sha256": checksum(arrays)}
    save_file(arrays, path, header)
    with pytest.warns(UserWarning, match="its checksum leaves out level and provenance"):
        assert equal(load_demonstrations(path).episodes, demonstrations.episodes)
    save_file({**arrays, "returns": arrays["returns"] + 1}, path, header)
    with pytest.raises(ValueError, match="its contents don't match its checksum"):
        load_demonstrations(path)


def test_another_safetensors_file(tmp_path):
    path = tmp_path / "weights.safetensors"
    save_file({"weight": np.zeros(3)}, path)
    with pytest.raises(ValueError, match="its format is None, expected 'sb3-guide demonstrations 2'"):
        load_demonstrations(path)
    assert load_file(path)


def test_a_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.safetensors does not exist"):
        load_demonstrations(tmp_path / "none.safetensors")


def test_the_agent_must_be_able_to_see_what_was_seen():
    demonstrations = make_demonstrations([3])
    check_space(demonstrations, observation_space(0))
    other = spaces.Dict({"image": spaces.Box(0, 10, (5, 5, 3), np.uint8), "mission": observation_space(0)["mission"]})
    with pytest.raises(
        ValueError, match=r"image of the demonstrations is uint8 \(7, 7, 3\).*record demonstrations of that level"
    ):
        check_space(demonstrations, other)
    few_words = spaces.Dict({"image": observation_space(0)["image"], "mission": spaces.Box(0, 5, (72,), np.uint8)})
    with pytest.raises(ValueError, match="mission of the demonstrations"):
        check_space(demonstrations, few_words)


def test_no_mission_serves_two_purposes():
    splits = [set(mission_seeds(split, 1000).tolist()) for split in ("train", "validation", "analysis")]
    assert len(set.union(*splits)) == 3000
    assert set(mission_seeds("train", 10, skip=10)) == set(mission_seeds("train", 20)) - set(mission_seeds("train", 10))


@pytest.mark.parametrize(
    ("split", "n", "message"), [("test", 1, "split='test' is unknown"), ("train", 0, "0 episodes were asked for")]
)
def test_missions_that_do_not_exist(split, n, message):
    with pytest.raises(ValueError, match=message):
        mission_seeds(split, n)
