"""A limit that leaves too little memory is one line at once, and no command waits for a thread that got none."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODEL = str(ROOT / "examples" / "road_to_rig" / "vehicle.toml")
COMMAND = [sys.executable, "-m", "matching", "modes", MODEL]
FAILS = """
import sys, threading, time
from matching.supervision import supervised
def command():
    thread = threading.Thread(target=lambda: {work})
    thread.start()
    thread.join()
    time.sleep({seconds})
    return 0
sys.exit(supervised(command))
"""


def run(words, before=""):
    where = os.environ | {"PYTHONPATH": str(ROOT)}
    shell = ["bash", "-c", f'{before}exec "$@"', "bash", *words]
    return subprocess.run(shell, env=where, capture_output=True, text=True, timeout=25)


@pytest.mark.parametrize(("limit", "megabytes"), [("-v", 234), ("-v", 600), ("-d", 400)])
def test_a_limit_too_small_for_the_libraries_is_one_line(limit, megabytes):
    """With 210 to 230 MB OpenBLAS asks for memory for ever; with 600 a match waited for a thread that was gone."""
    end = run([*COMMAND, "--check"], f"ulimit {limit} {megabytes * 1_000_000 // 1024} && ")
    assert (end.returncode, end.stdout, end.stderr.count("\n")) == (2, "", 1)
    assert f"ulimit {limit}: {megabytes} MB are allowed, too few" in end.stderr
    assert f"allow at least 1000 MB (ulimit {limit} 976563)" in end.stderr


@pytest.mark.parametrize("limit", ["-v", "-d"])
def test_the_limit_that_the_line_names_is_enough(limit):
    assert run([*COMMAND, "--check"], f"ulimit {limit} 976563 && ").returncode == 0


def test_help_needs_no_room():
    assert run([*COMMAND, "--help"], "ulimit -v 200000 && ").returncode == 0


def test_a_thread_without_memory_ends_the_command():
    """What waits for its result would wait for ever."""
    end = run([sys.executable, "-c", FAILS.format(work="bytearray(1 << 62)", seconds=60)])
    assert (end.returncode, end.stderr.count("\n")) == (2, 1)
    assert "there is not enough memory" in end.stderr


def test_a_thread_that_fails_otherwise_is_shown_as_always():
    end = run([sys.executable, "-c", FAILS.format(work="1 / 0", seconds=0)])
    assert end.returncode == 0
    assert "ZeroDivisionError" in end.stderr
