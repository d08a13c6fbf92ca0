"""The command, without a browser."""

import socket
import subprocess
import sys

import pytest

from sb3_guide.experiments import cli
from sb3_guide.experts import expert_folder
from sb3_guide.playground.play import check_free


def run(monkeypatch, *arguments: str) -> None:
    monkeypatch.setattr(sys, "argv", ["sb3-guide", "play", *arguments])
    cli.main()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "nowhere is no agent's folder"),
        ([str(expert_folder("GoToObj"))], "sends no messages: expected a GuidePolicy or a GuidedLearnerPolicy"),
        (["--level", "GoToMars"], "unknown environment 'GoToMars': expected a level ("),
        (["pretrained"], "which of the shipped agents? expected --level"),
        (["--host", "203.0.113.1"], "can't listen at 203.0.113.1:8080 (Cannot assign requested address)"),
        (["--export", ".", "--episodes", "2"], "is a folder: expected a file to write, such as episodes.html"),
        (["--export", "page.html", "--episodes", "0"], "0 episodes of each agent were asked for: expected 1 to 20"),
        (["--export", "page.html", "nowhere"], "nowhere is no agent's folder"),
    ],
)
def test_wrong_use_ends_with_one_line(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        run(monkeypatch, *arguments)
    assert message in str(ended.value)
    assert "\n" not in str(ended.value)
    assert not list(tmp_path.iterdir())


def test_a_port_in_use(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(SystemExit) as ended:
            run(monkeypatch, "--port", str(port))
    assert f"can't listen at 127.0.0.1:{port} (Address already in use): expected a free port" in str(ended.value)
    check_free("127.0.0.1", port)


def test_without_the_extra(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "sb3_guide.playground.page", None)
    monkeypatch.setitem(sys.modules, "sb3_guide.playground.export", None)
    for arguments in ([], ["--export", str(tmp_path / "page.html")]):
        with pytest.raises(SystemExit, match=r"pip install 'sb3-guide\[playground\]'"):
            run(monkeypatch, *arguments)


def test_the_commands_don_t_load_what_the_playground_needs():
    code = "import sys, sb3_guide.experiments.cli; assert not {'nicegui', 'jinja2'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_page_of_an_agent_s_episodes(monkeypatch, tmp_path, capsys):
    page = str(tmp_path / "a" / "page.html")
    with pytest.raises(SystemExit, match=r"^0$"):
        run(monkeypatch, "pretrained", "--level", "GoToObj", "--export", page, "--episodes", "2")
    assert "shows 2 episodes; open it in a browser" in capsys.readouterr().out
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["page.html"]
    assert "GoToObj/guided" in (tmp_path / "a" / "page.html").read_text()
