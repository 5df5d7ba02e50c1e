"""Commands in processes of their own: answered, wrong, ended."""

import pytest
from structure.imports import ROOT

from matching.explore import elements as equivalents
from matching.explore.jobs import Job, Task

MODEL = str(ROOT / "matching" / "starter" / "vehicle.toml")
CASE = str(ROOT / "matching" / "starter" / "case.toml")


def test_a_command_answers_with_its_result_and_runs_nothing_of_the_folder_it_is_begun_in(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("json", "numpy", "casadi", "matching"):
        (tmp_path / f"{name}.py").write_text("open('executed', 'w')\n")
    ended = Job(["modes", MODEL, "--check"]).wait(60)
    assert ended.code == 0
    assert ended.result["checked"][MODEL].startswith("a model: 5 inertias")
    assert not (tmp_path / "executed").exists()


def test_wrong_input_is_one_line(tmp_path):
    ended = Job(["modes", str(tmp_path / "none.toml"), "--out", str(tmp_path)]).wait(60)
    assert ended.code == 2
    assert ended.line.endswith("none.toml: does not exist; name an existing file")
    assert not ended.cancelled


def test_a_command_that_is_cancelled_tells_its_progress_until_then_and_leaves_nothing(tmp_path):
    told = []

    def tell(line):
        told.append(line)
        job.cancel()

    job = Job(["match", CASE, "--out", str(tmp_path / "out"), "--workers", "1"], tell)
    ended = job.wait(120)
    assert ended.cancelled
    assert told[0].startswith("match")
    assert not (tmp_path / "out" / "result.json").exists()


def test_commands_and_python_name_the_same_and_quote_what_needs_it():
    same = equivalents.same("match", 'my "case".toml', out="out dir", starts=3, seed=0)
    assert same.command == """rigmatch match 'my "case".toml' --starts 3 --seed 0 --out 'out dir'"""
    assert 'rm.match("my \\"case\\".toml", starts=3, seed=0)' in same.python
    assert len(same.python.splitlines()) == 3
    with pytest.raises(AttributeError):
        same.command = ""


def test_an_answer_that_cannot_be_read_is_an_end_too():
    ended = Job(["--version"]).wait(60)  # it writes a line that is no JSON, and exit code 0
    assert ended.code == 1
    assert "gave no answer that can be read" in ended.line


def test_a_command_is_followed_from_several_windows_until_it_ends():
    heard: list[list[str]] = [[], []]
    task = Task(["modes", MODEL, "--check"])
    followers = [lambda told=told: told.append("ended" if task.ended else task.line) for told in heard]
    for follower in followers:
        task.follow(follower)
    task.forget(followers[1])
    assert task.job.wait(60).code == 0
    task.follow(followers[1])  # a window that is opened afterwards
    assert [told[-1] for told in heard] == ["ended", "ended"]
    assert heard[1].count("ended") == 1
