"""Files that are whole or not there, and bounds for what is read."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sb3_guide.files import atomically, checksum, read_arrays, read_json, read_yaml, write_arrays, write_text


def test_a_file_that_could_not_be_finished_leaves_the_one_before_alone(tmp_path: Path) -> None:
    write_text(tmp_path / "text", "before")
    with pytest.raises(FileNotFoundError), atomically(tmp_path / "text") as partial:
        partial.write_bytes(b"half" + (tmp_path / "nothing").read_bytes())
    assert [file.name for file in tmp_path.iterdir()] == ["text"]
    assert (tmp_path / "text").read_text() == "before"


def test_arrays_may_be_read_by_whom_other_files_may(tmp_path: Path) -> None:
    write_text(tmp_path / "text", "words")
    write_arrays(tmp_path / "arrays", {"numbers": np.zeros(3)})
    assert (tmp_path / "arrays").stat().st_mode == (tmp_path / "text").stat().st_mode


def test_a_full_disk_is_an_error_and_leaves_the_file_before_alone(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("before")
    code = f"""
import resource
from pathlib import Path
import numpy as np
from sb3_guide.callbacks.checkpoint import save_state
from sb3_guide.files import write_arrays, write_text

resource.setrlimit(resource.RLIMIT_FSIZE, (10**5, 10**5))
text = "x" * 10**6
for write, content in ((write_text, text), (save_state, {{"x": text}}), (write_arrays, {{"x": np.zeros(10**6)}})):
    try:
        write(Path({str(tmp_path / "file")!r}), content)
    except OSError:
        print("refused")
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout == "refused\n" * 3
    assert [file.name for file in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "before"


def bomb(start: str, line: str) -> str:
    """Lines each of which has the one before twice."""
    return start + "".join(line.format(new=chr(98 + place), old=chr(97 + place)) for place in range(20))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a: [", "expected the node content"),
        ("a: !!python/object/apply:os.system [ls]", "could not determine a constructor"),
        ("a: !!timestamp never", "no YAML"),
        ("[" * 10_000, "recursion"),
        ("a: &a [*a]", "it has more than 100000 values"),
        (bomb("a: &a [x, x]\n", "{new}: &{new} [*{old}, *{old}]\n"), "it has more than 100000 values"),
        (bomb("a: &a {x: 1}\n", "{new}: &{new} {{<<: [*{old}, *{old}]}}\n"), "it has more than 100000 values"),
        ("x" * 2**20, "expected at most 262144"),
    ],
)
def test_yaml_that_asks_for_too_much(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "file.yml").write_text(content)
    with pytest.raises(ValueError, match=f"file.yml .*{message}") as caught:
        read_yaml(tmp_path / "file.yml")
    assert "\n" not in str(caught.value)


def test_yaml_as_it_is_meant(tmp_path: Path) -> None:
    (tmp_path / "file.yml").write_text("a: &a {x: 1}\nb: {<<: *a, y: [2, null]}\n")
    assert read_yaml(tmp_path / "file.yml") == {"a": {"x": 1}, "b": {"x": 1, "y": [2, None]}}
    (tmp_path / "file.yml").write_text("# nothing")
    assert read_yaml(tmp_path / "file.yml") is None


def test_numbers_of_yaml_are_numbers(tmp_path: Path) -> None:
    texts = {"1e-3": 0.001, "1e4": 1e4, "-2.5E+1": -25.0, ".5e1": 5.0, "!!float 1e6": 1e6, "7": 7, "1e": "1e", "e1": "e1"}
    (tmp_path / "file.yml").write_text("\n".join(f"- {text}" for text in texts))
    found = read_yaml(tmp_path / "file.yml")
    assert found == list(texts.values())
    assert [type(value) for value in found] == [type(value) for value in texts.values()]


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"{", "is no JSON"), (b"\xff", "is no JSON"), (b"1" * 10_000, "is no JSON"), (b"[]", "holds a list: expected a dict")],
)
def test_json_of_another_kind(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "file.json").write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_json(tmp_path / "file.json")


def test_a_checksum_is_of_all_that_was_written(tmp_path: Path) -> None:
    arrays = {"a": np.arange(6, dtype=np.int16).reshape(2, 3), "b": np.array(0.5)}
    write_arrays(tmp_path / "file", arrays, {"level": "GoToObj"})
    read, metadata = read_arrays(tmp_path / "file")
    assert metadata == {"level": "GoToObj"}
    same = checksum(arrays, {"level": "GoToObj", "seed": 1})
    assert checksum(dict(reversed(read.items())), {"seed": 1, "level": "GoToObj"}) == same
    others = [
        checksum(arrays),
        checksum(arrays, {"level": "GoToObj"}),
        checksum({**arrays, "b": np.array(0.25)}, {"level": "GoToObj", "seed": 1}),
        checksum({**arrays, "a": arrays["a"].reshape(3, 2)}, {"level": "GoToObj", "seed": 1}),
        checksum({"a": arrays["a"], "c": arrays["b"]}, {"level": "GoToObj", "seed": 1}),
    ]
    assert len({same, *others}) == 6
