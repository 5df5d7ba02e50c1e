"""The way without make runs what the Makefile runs, and the container installs what the lock names."""

import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tasks():
    spec = importlib.util.spec_from_file_location("tasks", ROOT / "tasks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_target_that_sets_up_an_environment_is_there(tasks):
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    expected = dict(re.findall(r"^([a-z-]+): \.venv/(\w+)\.stamp", makefile, flags=re.M))
    expected.pop("lock")  # needs a network and a shell
    assert {name: lock for name, (lock, _) in tasks.targets().items()} == expected


@pytest.mark.parametrize(("target", "limited"), [("run", False), ("explore", False), ("test", True), ("bench", True)])
def test_all_cores_work_where_one_process_is_begun(target, limited, tasks, monkeypatch):
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert (target in re.search(r"^([a-z ]+): OMP_NUM_THREADS", makefile, flags=re.M)[1].split()) != limited
    passed = []
    monkeypatch.setattr(tasks, "set_up", lambda lock: None)
    monkeypatch.setattr(tasks, "_run", lambda words, **more: passed.append(more))
    monkeypatch.setattr(tasks.sys, "argv", ["tasks.py", target])
    tasks.main()
    assert all(("OMP_NUM_THREADS" not in more) == limited for more in passed)


def test_lines_become_words(tasks):
    _, (first, *_, last) = tasks.targets()["test"]
    assert tasks.command(first)[1:] == ["check", "."]
    assert tasks.command(last)[1:] == ["-m", "pytest", "-q", "-n", "2", "--dist", "worksteal"]
    assert tasks.command(tasks.targets()["test-long"][1][0])[-1] == "faulthandler_timeout=1860"
    assert Path(tasks.command(first)[0]).stem == "ruff"


def test_no_word_is_left_to_a_shell(tasks):
    words = [word for _, lines in tasks.targets().values() for line in lines for word in tasks.command(line)]
    assert [word for word in words if "$" in word or word in ("|", "||", "&&", ">", ";")] == []


def test_a_stamp_newer_than_the_lock_means_that_nothing_is_installed(tasks, tmp_path, monkeypatch):
    (tmp_path / "run.stamp").touch()
    monkeypatch.setattr(tasks, "ENVIRONMENT", tmp_path)
    monkeypatch.setattr(tasks, "_run", lambda words: pytest.fail(f"{words} was run"))
    tasks.set_up("run")


def test_the_container_is_built_from_files_that_exist_and_without_a_network():
    text = (ROOT / "Containerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    copied = [word for line in re.findall(r"^COPY (?!--)(.*)$", text, flags=re.M) for word in line.split()[:-1]]
    assert {name for name in copied if not (ROOT / name).exists()} == {"wheels/"}  # downloaded beforehand
    installs = re.findall(r"pip install[^&\n]*", text)
    assert len(installs) == 2
    assert all("--no-index" in line for line in installs)
