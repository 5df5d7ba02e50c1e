"""The command in a process of its own: the parent sees to it that it ends when asked, and that nothing stays behind.

Libraries in C notice Ctrl-C late, or swallow it. The parent does nothing but wait: a signal is passed on, and what has
not ended half a second later is killed with all its processes. A crash of the command becomes one line. Temporary files
go to a folder that the parent removes.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from modelling.common import interruption, memory_limits
from modelling.common.errors import BAD_INPUT, FAULT
from modelling.common.interruption import ENDING_SIGNALS, Interrupted

GRACE_SECONDS = 0.5  # from a signal until the command is killed
CLEARING_SECONDS = 2.0  # at most, until killed processes are gone
DIE_WITH_PARENT, ADOPT_ORPHANS = 1, 36  # prctl of Linux: PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER
SILENT_CLEARING = "ignore:resource_tracker:UserWarning"  # it says what it removes, which is nobody's concern


def supervised(command: Callable[[], int]) -> int:
    """Run a command in a process of its own; its exit code, or 128 and the signal's number where one ended it."""
    if "_ARGCOMPLETE" in os.environ or not (hasattr(os, "fork") and hasattr(signal, "sigtimedwait")):
        interruption.install()
        return command()
    watched = {number for number in ENDING_SIGNALS if signal.getsignal(number) is not signal.SIG_IGN}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, watched | {signal.SIGCHLD})
    temporary = _temporary_folder()
    answered, answer = os.pipe()
    parent, child = os.getpid(), os.fork()
    if child == 0:
        os.close(answered)
        _prctl(DIE_WITH_PARENT, signal.SIGKILL)
        if os.getppid() != parent:  # it died before that
            os._exit(128 + signal.SIGKILL)
        if temporary:
            os.environ["TMPDIR"] = temporary
            if not all(map(_can_be_made, _folders_of_matplotlib())):
                os.environ.setdefault("MPLCONFIGDIR", temporary)  # or it complains, in every worker too
        os.environ["PYTHONWARNINGS"] = f"{os.environ.get('PYTHONWARNINGS', '')},{SILENT_CLEARING}".lstrip(",")
        interruption.install()
        memory_limits.end_where_a_thread_has_none()
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        try:
            code = command()
        finally:
            os.write(answer, b".")
        if code:  # nothing more is waited for: not after an interrupt, nor for threads that got no memory
            with contextlib.suppress(OSError, ValueError):
                sys.stdout.flush()
            os._exit(code)
        return code
    os.close(answer)
    _prctl(ADOPT_ORPHANS, 1)
    try:
        return _wait(child, watched, answered)
    finally:
        os.close(answered)
        if temporary:
            import shutil

            shutil.rmtree(temporary, ignore_errors=True)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _wait(child: int, watched: set[signal.Signals], answered: int) -> int:
    """Wait for the command, passing signals on; into the pipe ``answered`` it writes when it ends as it means to."""
    asked, deadline, killed = 0, 0.0, False
    while (status := _ended(child)) is None:
        seconds = max(0.0, deadline - time.monotonic()) if asked else 3600.0
        came = signal.sigtimedwait(watched | {signal.SIGCHLD}, seconds)
        if came is not None and came.si_signo != signal.SIGCHLD:
            if not asked:
                asked, deadline = came.si_signo, time.monotonic() + GRACE_SECONDS
            os.kill(child, came.si_signo)
        if asked and not killed and time.monotonic() >= deadline:
            killed = True
            os.kill(child, signal.SIGKILL)
            deadline = time.monotonic() + CLEARING_SECONDS
    code = os.waitstatus_to_exitcode(status)
    if asked or code:
        _kill_orphans()
    if code >= 0:
        return _left() if code == FAULT and not _readable(answered) else code
    if asked:
        end = Interrupted(asked)
        return _say(str(end), end.exit_code)
    return _died(-code)


def _readable(pipe: int) -> bool:
    """Whether something was written into a pipe; processes that outlive the command may still hold its other end."""
    os.set_blocking(pipe, False)
    try:
        return bool(os.read(pipe, 1))
    except BlockingIOError:
        return False


def _left() -> int:
    """One line on a library in C that ended the command by itself; OpenBLAS does so where it gets no memory."""
    return _say("a library ended the program, perhaps because memory ran out: free some, or work on less", BAD_INPUT)


def _ended(child: int) -> int | None:
    """Wait status of the command if it has ended; orphans that ended are let go."""
    while True:
        try:
            process, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return FAULT << 8
        if process == child:
            return status
        if process == 0:
            return None


def _died(number: int) -> int:
    """One line on a command that a signal ended from outside."""
    if number == signal.SIGKILL:
        line = "killed from outside, perhaps because memory ran out; results are whole or not there: run it again"
        return _say(f"{line} (map and tolerance go on from what they had finished)", 128 + number)
    name = signal.strsignal(number) or f"signal {number}"
    return _say(f"a fault of rigmatch or of a library, not of your input: {name.lower()}", FAULT)


def _kill_orphans() -> None:
    """Kill what the command had begun: its processes became ours when it ended.

    Python's own process that removes the semaphores of worker processes ends by itself once these are gone.
    """
    end = time.monotonic() + CLEARING_SECONDS
    while (children := _children()) and time.monotonic() < end:
        for child in children:
            with contextlib.suppress(ProcessLookupError):
                if not _clears_up(child):
                    os.kill(child, signal.SIGKILL)
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        time.sleep(0.005)


def _children() -> list[int]:
    with contextlib.suppress(OSError):
        return [
            int(child) for child in Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split()
        ]
    return []


def _clears_up(process: int) -> bool:
    """Whether a process is the one that removes the semaphores of others."""
    with contextlib.suppress(OSError):
        return b"resource_tracker" in Path(f"/proc/{process}/cmdline").read_bytes()
    return False


def _temporary_folder() -> str:
    """A folder for this run, or an empty text where none can be made."""
    for above in _folders_for_temporary_files():
        path = os.path.join(above, f"rigmatch-{os.urandom(8).hex()}")
        with contextlib.suppress(OSError):
            os.mkdir(path, 0o700)
            return path
    return ""


def _folders_for_temporary_files() -> Iterable[str]:
    """As :func:`tempfile.gettempdir` has them, whose module takes longer to import than this command to begin."""
    return filter(None, (*(os.environ.get(name) for name in ("TMPDIR", "TEMP", "TMP")), "/tmp", "/var/tmp"))


def _folders_of_matplotlib() -> Iterable[str]:
    """Where it keeps its settings and its list of fonts."""
    for variable, usual in (("XDG_CONFIG_HOME", ".config"), ("XDG_CACHE_HOME", ".cache")):
        yield os.path.join(os.environ.get(variable) or os.path.join(os.path.expanduser("~"), usual), "matplotlib")


def _can_be_made(folder: str) -> bool:
    """Whether a folder exists and can be written to, or can be made."""
    while not os.path.lexists(folder) and os.path.dirname(folder) != folder:
        folder = os.path.dirname(folder)
    return os.path.isdir(folder) and os.access(folder, os.W_OK | os.X_OK)


def _prctl(option: int, value: int) -> None:
    with contextlib.suppress(ImportError, OSError, AttributeError):  # not on Linux
        import ctypes

        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def _say(line: str, code: int) -> int:
    print(f"rigmatch: {line}", file=sys.stderr)
    return code
