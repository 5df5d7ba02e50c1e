"""A command ends within a second when asked, whatever it does, and nothing of it stays."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

import rigmatch
from matching import cli as supervision
from matching.cli import _temporary_folder

ROOT = Path(__file__).parents[2]
BEGIN = """
import os, subprocess, sys, time
from matching.cli import _say
from matching.supervision import supervised
def command():
    try:
        return work()
    except KeyboardInterrupt as interrupt:
        return _say(str(interrupt), interrupt.exit_code)
def begun(*what):
    print(os.environ["TMPDIR"], *what, flush=True)
"""
WAITS = "def work():\n    begun()\n    time.sleep(60)"
STUCK_IN_C = "def work():\n    begun()\n    sum(range(10**11))"  # no signal handler runs before its end
SWALLOWS = """
def work():
    try:
        begun()
        time.sleep(60)
    except KeyboardInterrupt:
        time.sleep(60)
"""
HAS_PROCESSES = """
def work():
    own = "import subprocess, sys; print(subprocess.Popen(['sleep', '60']).pid, flush=True); sum(range(10**11))"
    child = subprocess.Popen([sys.executable, "-c", own], stdout=subprocess.PIPE, text=True, start_new_session=True)
    begun(child.pid, child.stdout.readline().strip())
    sum(range(10**11))
"""

HAS_A_SEMAPHORE = """
def work():
    from multiprocessing import get_context
    kept = get_context("spawn").Lock()
    begun(kept._semlock.name)
    sum(range(10**11))
"""


@pytest.fixture
def begin(tmp_path):
    """Begin a command; its process, and what it printed first."""
    processes = []

    def of(work):
        code = f"{BEGIN}\n{work}\nsys.exit(supervised(command))"
        where = os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)}
        process = subprocess.Popen(
            [sys.executable, "-c", code], env=where, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        processes.append(process)
        return process, process.stdout.readline().split()

    yield of
    for process in processes:
        process.kill()
        process.communicate()


def runs(pid):
    state = Path(f"/proc/{pid}/stat")
    try:
        return state.read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("work", [WAITS, STUCK_IN_C, SWALLOWS, HAS_PROCESSES])
@pytest.mark.parametrize(("number", "code", "line"), [
    (signal.SIGINT, 130, "rigmatch: interrupted\n"), (signal.SIGTERM, 143, "rigmatch: ended by SIGTERM\n"),
])  # fmt: skip
def test_a_signal_ends_it_and_all_it_began(work, number, code, line, begin, tmp_path):
    process, (temporary, *pids) = begin(work)
    assert Path(temporary).parent == tmp_path
    began = time.monotonic()
    process.send_signal(number)
    _, said = process.communicate(timeout=20)
    assert time.monotonic() - began < 5.0  # 0.5 s on a machine with nothing else to do
    assert (process.returncode, said) == (code, line)
    assert not [pid for pid in pids if runs(pid)]
    assert list(tmp_path.iterdir()) == []


def test_its_exit_code_is_the_command_s(begin, tmp_path):
    process, _ = begin("def work():\n    begun()\n    open(os.environ['TMPDIR'] + '/left', 'w').close()\n    return 7")
    _, said = process.communicate(timeout=20)
    assert (process.returncode, said) == (7, "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("number", "code", "words"), [
    ("SIGSEGV", 1, "a fault of rigmatch or of a library, not of your input: segmentation fault"),
    ("SIGKILL", 137, "killed from outside"),
])  # fmt: skip
def test_a_crash_is_one_line(number, code, words, begin, tmp_path):
    process, _ = begin(f"import signal\ndef work():\n    begun()\n    os.kill(os.getpid(), signal.{number})")
    _, said = process.communicate(timeout=20)
    assert process.returncode == code
    assert words in said
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_library_that_ends_the_command_by_itself_is_one_line_and_no_fault(begin, tmp_path):
    """As OpenBLAS does where it gets no memory; the command's own code 1 stays what it is."""
    process, _ = begin("import ctypes\ndef work():\n    begun()\n    ctypes.CDLL(None).exit(1)")
    _, said = process.communicate(timeout=20)
    assert (process.returncode, said.count("\n")) == (2, 1)
    assert "a library ended the program, perhaps because memory ran out" in said
    process, _ = begin("def work():\n    begun()\n    return 1")
    _, said = process.communicate(timeout=20)
    assert (process.returncode, said) == (1, "")
    assert list(tmp_path.iterdir()) == []


def test_it_ends_with_its_parent(begin):
    process, (_, pid) = begin("def work():\n    begun(os.getpid())\n    sum(range(10**11))")
    assert int(pid) != process.pid
    process.kill()
    process.wait()
    deadline = time.monotonic() + 20
    while runs(pid) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not runs(pid)


def test_an_ignored_signal_stays_ignored(begin):
    code = "signal.signal(signal.SIGINT, signal.SIG_IGN)"
    process, _ = begin(f"import signal\n{code}\ndef work():\n    begun()\n    time.sleep(0.3)\n    return 0")
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=20)
    assert process.returncode == 0


def test_an_interruption_before_the_command_begins_is_one_line(monkeypatch, capsys):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(rigmatch, "replaced_package", interrupted)
    assert rigmatch.main() == 130
    assert capsys.readouterr().err == "rigmatch: interrupted\n"


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="semaphores are files there on Linux only")
def test_semaphores_of_workers_are_removed_in_silence(begin):
    process, (_, name) = begin(HAS_A_SEMAPHORE)
    place = Path("/dev/shm", f"sem.{name.removeprefix('/')}")
    assert place.exists()
    process.send_signal(signal.SIGTERM)
    assert process.communicate()[1] == "rigmatch: ended by SIGTERM\n"
    assert not place.exists()


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_stream_gets_nothing_of_another_file(tmp_path, closed):
    """A file opened later does not take the stream's number: what was printed would stand in it."""
    work = """
import rigmatch
def printed():
    import os
    with open("opened.txt", "w") as file:
        assert file.fileno() > 2
        for number in (1, 2):
            os.write(number, b"printed")
    print(sys.stdin.read(), sys.stderr.write("said"))
    return 7
import matching.cli
matching.cli.main = printed
sys.exit(rigmatch.main())
"""
    shell = f'exec "$0" -c "$1" {closed}'
    words = ["bash", "-c", shell, sys.executable, f"import sys\n{work}"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    ended = subprocess.run(words, cwd=tmp_path, env=environment, stdin=subprocess.DEVNULL, timeout=60, check=False)
    assert ended.returncode == 7
    assert (tmp_path / "opened.txt").read_text(encoding="utf-8") == ""


@pytest.mark.parametrize("home", ["/dev/null/home", "", None], ids=["no folder", "writable", "kept"])
def test_without_a_home_to_write_to_nothing_is_said_about_it(tmp_path, home):
    """Matplotlib says in two lines where it keeps its fonts instead, in every worker."""
    code = f"{BEGIN}\ndef work():\n    import matplotlib\n    print(matplotlib.get_configdir())\n    return 0\n"
    own = {"HOME": str(tmp_path) if home == "" else home or "/dev/null"}
    own |= {"TMPDIR": str(tmp_path), "PYTHONPATH": str(ROOT)}
    if home is None:
        own["MPLCONFIGDIR"] = str(tmp_path / "mine")
    where = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "MPL"))} | own
    ended = subprocess.run(
        [sys.executable, "-c", f"{code}sys.exit(supervised(command))"], env=where, text=True, capture_output=True,
        check=True,
    )  # fmt: skip
    assert ended.stderr == ""
    wanted = {"": str(tmp_path / ".config"), None: str(tmp_path / "mine")}.get(home, str(tmp_path / "rigmatch-"))
    assert ended.stdout.startswith(wanted)
    assert not list(tmp_path.glob("rigmatch-*"))


@pytest.mark.parametrize("name", ["TMPDIR", "TEMP", "TMP"])
def test_temporary_files_go_where_python_puts_them(monkeypatch, tmp_path, name):
    for other in ("TMPDIR", "TEMP", "TMP"):
        monkeypatch.delenv(other, raising=False)
    monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    assert Path(_temporary_folder()).parent == Path(tempfile.gettempdir()) == tmp_path


def test_nothing_is_waited_for_where_nothing_was_left_behind(monkeypatch):
    monkeypatch.setattr(supervision, "_children", list)
    monkeypatch.setattr(supervision.time, "sleep", lambda _: pytest.fail("waited"))
    supervision._kill_orphans()
