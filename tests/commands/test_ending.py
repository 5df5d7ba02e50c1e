"""Ctrl-C ends a command at once, in native code too, in one line, and leaves neither processes nor half results."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from needs import compiles
from processes import started
from small_bed import CASE, write

from matching.progress import PROGRESS_ALWAYS

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 5.0  # 2 on a machine with nothing else to do
WHERE = os.environ | {"PYTHONPATH": str(ROOT), PROGRESS_ALWAYS: "1"}


def read_until(stream, words: str) -> str:
    """What comes from a stream, until it contains some words or ends."""
    read = ""
    while words not in read and (piece := os.read(stream.fileno(), 4096)):
        read += piece.decode("utf-8", "replace")
    return read


def ends(process, group: bool) -> tuple[int, str]:
    """Exit code and standard error of a process that gets SIGINT, alone or with its group as from a terminal."""
    begun = time.monotonic()
    if group:
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert time.monotonic() - begun < SECONDS
    return process.returncode, said.decode().replace("\r", "\n")


@pytest.mark.parametrize(
    ("step", "group"),
    [("controller", False), pytest.param("verification", True, marks=pytest.mark.long)],
    ids=["search-one process", "verification-Ctrl-C"],
)
def test_a_match_ends(tmp_path, step, group):
    """While the search runs, and while fresh beds are judged."""
    words = ["match", str(write(tmp_path, CASE)), "--out", str(tmp_path / "out")]
    command = [sys.executable, "-m", "matching", *words]
    with started(command, env=WHERE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert step in read_until(process.stderr, step)
        code, said = ends(process, group)
        assert (code, said.splitlines()[-1]) == (130, "rigmatch: interrupted")
        assert not list(tmp_path.rglob("*.json"))
        if group:
            with pytest.raises(ProcessLookupError):  # nobody of the group is left
                os.killpg(process.pid, 0)


NATIVE = """
from modelling.simulation.simulate import simulate
from tests.simulation.drives import excitation, system_with
simulate(system_with(), *excitation(0.05), steps_per_second=1e4)
print("begun", flush=True)
simulate(system_with(), *excitation(200.0), steps_per_second=1e7)
"""


@compiles
def test_a_simulation_in_native_code_ends():
    where = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with started([sys.executable, "-c", NATIVE], env=where, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        read_until(process.stdout, "begun")
        time.sleep(1.0)
        assert process.poll() is None  # well inside the run, which takes minutes
        _, said = ends(process, group=False)
    assert "KeyboardInterrupt" in said


ANSWERS = """
import os, sys, time
from matching.cli import main, supervised
from modelling.resources import ends_early, ended_early_by, limited, time_is_over

def command():
    with ends_early(), limited(None):
        print("begun", flush=True)
        while not time_is_over(0.1):
            time.sleep(0.01)
    time.sleep(float(sys.argv[1]))
    print("answer", flush=True)
    return 128 + ended_early_by()

fork = os.fork

def slow_parent():
    if child := fork():
        time.sleep(float(sys.argv[2]))
    return child

os.fork = slow_parent
sys.exit(supervised(command))
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("twice", [False, True])
@pytest.mark.parametrize("behind", ["0", "0.3"])  # s that the parent needs more than its child
def test_what_can_answer_with_what_it_has_is_given_the_time_to_write_and_a_second_signal_ends_it(number, twice, behind):
    seconds = "60" if twice else "1"  # of writing: longer than a command without an answer is given
    command = [sys.executable, "-c", ANSWERS, seconds, behind]
    with started(command, env=WHERE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        read_until(process.stdout, "begun")
        process.send_signal(number)
        assert "best answer so far" in read_until(process.stderr, "at once")
        if twice:
            process.send_signal(number)
        begun = time.monotonic()
        out, _ = process.communicate(timeout=30)
        assert time.monotonic() - begun < 2 * SECONDS
        assert process.returncode == 128 + number
        assert (b"answer" in out) is not twice
