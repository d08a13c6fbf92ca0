from pathlib import Path

import pytest

from sb3_guide.experiments.workflow.display import Display, last_lines


def test_stages_are_told_as_they_start_finish_and_fail(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "b.log").write_text("10 %\r20 %\nout of cheese\n")
    display = Display(tmp_path, cores=2)
    for line in (
        "total      3\n",
        "Job 1: log in log/a.log\n",
        "Job 2: log in log/b.log\n",
        "Reason: Missing output files: a\n",
        "",
        "Finished jobid: 1 (Rule: a)\n",
        "Error in rule b:\n",
        "    jobid: 2\n",
        "Finished jobid: 0 (Rule: all)\n",
    ):
        display.show(line)
    display.close()
    assert capsys.readouterr().err.splitlines() == [
        "a: started",
        "b: started",
        "a: finished in 0 s",
        f"b: FAILED. The end of {tmp_path / 'log' / 'b.log'}:",
        "10 %",
        "20 %",
        "out of cheese",
    ]


def test_the_last_lines_of_a_log_are_what_a_progress_bar_shows_now(tmp_path: Path) -> None:
    log = tmp_path / "log"
    assert last_lines(log) == []
    log.write_bytes(b"x" * 100_000 + b"\nstart\n\r 5 %\r10 % \xff\r")
    assert last_lines(log)[-2:] == [" 5 %", "10 % \N{REPLACEMENT CHARACTER}"]
