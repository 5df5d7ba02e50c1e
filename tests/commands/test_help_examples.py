"""The examples that `--help` shows work as typed, in the program's folder after `make run`."""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from structure.imports import ROOT

from matching import cli
from matching.cli import WITHOUT
from matching.commands import COMMANDS, calls

MADE_BY_MAKE_RUN = "out/road_to_rig"
SHOWN_UNTIL_ENDED = "explore"


def examples_of(command: str) -> list[list[str]]:
    """Words of every example of a command's help."""
    return [shlex.split(example) for example in calls(command)]


def written_by(words: list[str]) -> list[str]:
    """Where an example writes to."""
    places = [words[words.index(option) + 1] for option in ("--out", "--fmu", "--controller") if option in words]
    return places + (words[-1:] if words[0] == "python" else [])


def read_by(words: list[str]) -> list[str]:
    """Files that an example names and does not write; ``1/min`` is none."""
    return [word for word in words[1:] if "/" in word and word not in written_by(words) and "1/min" not in word]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_file_that_an_example_names_is_there_or_written_before(command):
    written = [MADE_BY_MAKE_RUN]
    for words in examples_of(command):
        files = [file for file in read_by(words) if "://" not in file]
        for file in files:
            made = any(file.startswith(place) for place in written) or (command == "new" and words[1] == "new")
            to_come = file == "out/bed_recordings"  # the folder that commission waits for recordings in
            assert made or to_come or (ROOT / file).exists(), file
        written += written_by(words)
    assert "'" not in " ".join(calls(command)), "no quote in the shell of Windows"


@pytest.mark.parametrize("command", [name for name in COMMANDS if name not in WITHOUT])
def test_an_example_of_files_that_are_there_passes_a_dry_run(command, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    tried = 0
    for words in examples_of(command):
        if words[:2] == ["rigmatch", command] and all((ROOT / file).exists() for file in read_by(words)):
            assert cli.main([*words[1:], "--check"]) == 0, capsys.readouterr().err
            tried += 1
    assert tried or command in ("diagnose", "tolerance", "verify", "commission", "learn")  # their inputs are made first


GROUPS = ("match tolerance", "map", "diagnose identify", "verify commission learn")  # that take long, or share results


@pytest.mark.long
@pytest.mark.parametrize("group", ["", *GROUPS])
def test_every_example_works_as_typed(group, tmp_path):
    """In the order of the commands, in a copy of the program's folder; those of no group are one of their own."""
    pytest.importorskip("fmpy")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    others = [name for name in COMMANDS if name != SHOWN_UNTIL_ENDED and name not in " ".join(GROUPS).split()]
    calls = [words for name in group.split() or others for words in examples_of(name)]
    if any(MADE_BY_MAKE_RUN in words for words in calls):
        calls = [["rigmatch", "match", "examples/road_to_rig/observer.toml", "--out", MADE_BY_MAKE_RUN], *calls]
    for words in dict.fromkeys(tuple(words) for words in calls):
        begin = [sys.executable] if words[0] == "python" else [sys.executable, "-m", "matching"]
        done = subprocess.run(
            [*begin, *words[1:]],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )
        assert done.returncode == 0, f"{shlex.join(words)}\n{done.stderr}"
        for place in written_by(list(words)):
            assert (
                any(Path(tmp_path / place).iterdir()) if (tmp_path / place).is_dir() else (tmp_path / place).is_file()
            )
