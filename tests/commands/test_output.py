"""Strict JSON and files that are whole or not there."""

import json
import os
import pathlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modelling.errors import InputError, of_the_machine
from modelling.writing import strict_json, write_all, write_results

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**100), 10**100) | st.floats(-1e100, 1e100) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=15,
)


@given(PLAIN)
def test_json_gives_back_what_went_in(value):
    assert json.loads(strict_json(value)) == value


def test_json_of_numpy():
    value = {"a": np.float64(0.5), "b": np.arange(3), "c": np.bool_(True), "d": (np.int64(2),), "e": np.ones((2, 2))}
    assert json.loads(strict_json(value)) == {"a": 0.5, "b": [0, 1, 2], "c": True, "d": [2], "e": [[1, 1], [1, 1]]}


@pytest.mark.parametrize(
    "bad", [float("nan"), float("inf"), -float("inf"), np.float64("nan"), np.float32("inf"), 4.8e288]
)
def test_json_refuses_what_is_not_finite_and_says_where(bad):
    with pytest.raises(FloatingPointError, match=r"^modes\[1\]\.frequency is -?(nan|inf|4.8e)"):
        strict_json({"modes": [{"frequency": 1.0}, {"frequency": bad}]})
    with pytest.raises(FloatingPointError, match=r"^values\[1\]\[0\] is"):
        strict_json({"values": np.array([[1.0], [float(bad)]])})


@pytest.mark.parametrize("bad", [{"a": 1j}, {"a": object()}, {"a": {1: 2}}, {"a": {3, 4}}])
def test_json_refuses_what_it_cannot_hold(bad):
    with pytest.raises(TypeError, match=r"^a "):
        strict_json(bad)


def contents(directory):
    return {str(path.relative_to(directory)): path.read_bytes() for path in directory.rglob("*") if path.is_file()}


def test_files_are_written_and_nothing_beside_them(tmp_path):
    out = tmp_path / "new" / "out"
    write_all(out, {"result.json": "{}", "figures/modes.png": b"\x89PNG", "ω.txt": "ω"})
    assert contents(tmp_path) == {
        "new/out/result.json": b"{}",
        "new/out/figures/modes.png": b"\x89PNG",
        "new/out/ω.txt": "ω".encode(),
    }
    assert sorted(path.name for path in out.iterdir()) == ["figures", "result.json", "ω.txt"]


def test_a_name_that_is_no_utf_8_is_no_fault(tmp_path):
    write_all(tmp_path, {"result.json": strict_json({"case": "a\udcff"}), "report.html": "<p>a\udcff</p>"})
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8")) == {"case": "a\udcff"}
    assert (tmp_path / "report.html").read_bytes() == b"<p>a?</p>"


def test_old_files_are_replaced_and_others_left(tmp_path):
    (tmp_path / "result.json").write_text("old")
    (tmp_path / "notes.txt").write_text("mine")
    write_all(tmp_path, {"result.json": "new"})
    assert contents(tmp_path) == {"result.json": b"new", "notes.txt": b"mine"}


def test_nothing_changes_when_a_file_cannot_be_made(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(TypeError):
        write_all(tmp_path, {"a.txt": "new", "b.txt": 3})
    assert contents(tmp_path) == {"a.txt": b"old"}
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_nothing_changes_when_the_disk_is_full(tmp_path, monkeypatch):
    out = tmp_path / "out"

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_all(out, {"a.txt": "new"})
    assert list(tmp_path.iterdir()) == []


def test_a_reader_never_sees_half_a_file(tmp_path, monkeypatch):
    (tmp_path / "a.txt").write_text("old")
    seen, replace = [], pathlib.Path.replace

    def watch(path, target):
        seen.append((path.read_text(), target.read_text()))
        return replace(path, target)

    monkeypatch.setattr(pathlib.Path, "replace", watch)
    write_all(tmp_path, {"a.txt": "new"})
    assert seen == [("new", "old")]


def test_a_place_that_cannot_be_written_is_bad_input(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder" / "result.json").mkdir(parents=True)
    for directory, files in [
        (tmp_path / "file", {"a.txt": ""}),
        (tmp_path / "file" / "deeper", {"a.txt": ""}),
        (tmp_path, {"file/a.txt": ""}),
        (tmp_path / "folder", {"a.txt": "", "result.json": ""}),
    ]:
        with pytest.raises(InputError, match="cannot be written"):
            write_all(directory, files)
    assert contents(tmp_path) == {"file": b"mine"}


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_directory_without_access_is_bad_input(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="permission denied"):
        write_all(tmp_path / "out", {"a.txt": ""})


OLD, NEW = ({f"figures/{name}": text for name in "abc"} | {"result.json": text} for text in ("old", "new"))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_kill_at_any_step_leaves_whole_files_and_the_next_run_all_of_them(tmp_path):
    for step in range(100):
        out = tmp_path / str(step)
        write_all(out, OLD)
        was_killed = killed_at(step, out)
        assert {(out / name).read_text() for name in OLD if (out / name).exists()} <= {"old", "new"}
        write_all(out, NEW)
        assert contents(out) == {name: text.encode() for name, text in NEW.items()}
        if not was_killed:
            break
    assert not was_killed
    assert step >= len(NEW)


def killed_at(step, directory):
    """A process that writes NEW and is killed at one of its steps; whether it was."""
    if (process := os.fork()) == 0:
        steps = iter(range(step))

        def counted(function):
            def call(*arguments, **named):
                if next(steps, None) is None:
                    os._exit(9)
                return function(*arguments, **named)

            return call

        for owner, name in ((os, "fsync"), (os, "replace"), (pathlib.Path, "replace"), (pathlib.Path, "rename")):
            setattr(owner, name, counted(getattr(owner, name)))
        write_all(directory, NEW)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 9


@pytest.mark.parametrize(("fault", "words"), [
    (OSError(28, "No space left on device", "out/a.txt"), "out/a.txt: no space is left on the disk; free some"),
    (OSError(30, "Read-only file system", "out"), "out: the disk is read-only"),
    (OSError(24, "Too many open files"), "this machine: too many files are open"),
    (MemoryError(), "this machine: there is not enough memory"),
    (RuntimeError("std::bad_alloc"), "there is not enough memory"),
])  # fmt: skip
def test_what_the_machine_lacks_is_said_in_words(fault, words):
    try:
        try:
            raise fault
        finally:
            raise RuntimeError("in clearing up")
    except RuntimeError as error:
        line = of_the_machine(error)
    assert words in str(line)
    assert of_the_machine(ValueError("out of range")) is None


@pytest.mark.parametrize("name", ["", "/etc/a", "../a", "b/../../a"])
def test_names_stay_inside(tmp_path, name):
    with pytest.raises(ValueError, match="stay inside"):
        write_all(tmp_path / "out", {name: ""})
    assert list(tmp_path.iterdir()) == []


def test_pictures_of_an_earlier_run_do_not_stay_beside_other_results(tmp_path):
    first = {"figures/a.svg": "a", "figures/b.svg": "b", "report.html": "page", "tuned.toml": "model"}
    write_results(tmp_path, "result.json", {"value": 1}, first)
    (tmp_path / "figures" / "mine.svg").write_text("mine")
    write_results(tmp_path, "map.json", {"value": 2}, {"map.svg": "of another command"})
    write_results(tmp_path, "result.json", {"value": 3}, {"figures/b.svg": "new"})
    kept = contents(tmp_path)
    assert set(kept) == {"result.json", "map.json", "map.svg", "tuned.toml", "figures/b.svg", "figures/mine.svg"}
    assert json.loads(kept["result.json"]) == {"value": 3, "files": ["figures/b.svg", "result.json"]}


@pytest.mark.parametrize("name", ["../outside.svg", "{absolute}", "link/outside.svg", "a\0.svg"])
def test_a_list_of_files_cannot_lead_out_of_its_folder(tmp_path, name):
    outside, out = tmp_path / "outside.svg", tmp_path / "out"
    outside.write_text("mine")
    out.mkdir()
    (out / "link").symlink_to(tmp_path)
    (out / "result.json").write_text(json.dumps({"files": [name.format(absolute=outside)]}))
    write_results(out, "result.json", {}, {})
    assert outside.read_text() == "mine"
