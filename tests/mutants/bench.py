"""Copies of the project in which faults are planted, one at a time each, and the tests run in a forked process.

The libraries are imported once, before forking; the program itself is imported by each child, from its copy.
"""

import contextlib
import importlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import traceback
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.mutants.coverage_map import ROOT

LIBRARIES = """
numpy scipy.optimize scipy.signal scipy.linalg scipy.interpolate scipy.integrate scipy.sparse.linalg scipy.stats
casadi sympy sympy.printing.mathml pint matplotlib.figure matplotlib.pyplot jinja2 tqdm hypothesis xdist
"""
PASSED, FAILED = 0, 1  # pytest's ends


def copy(target: Path) -> Path:
    """The project as it stands here, committed or not; kept files keep their times, so that bytecode stays valid."""
    names = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", "-z"], cwd=ROOT, capture_output=True)
    for name in filter(None, names.stdout.decode().split("\0")):
        if (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)
    return target


def warm() -> None:
    """Import what every child needs."""
    for name in LIBRARIES.split():
        importlib.import_module(name)


@dataclass
class Run:
    """Tests running in a copy, with a fault planted or without."""

    tree: Path
    tests: list[str]
    seconds: float  # processor time after which the run is ended
    file: str = ""
    source: str = ""
    pid: int = 0
    began: float = field(default_factory=time.monotonic)

    def start(self) -> "Run":
        if self.file:
            plant(self.tree / self.file, self.source)
        self.pid = os.fork()
        if self.pid == 0:
            self._child()
        return self

    def _child(self) -> None:
        end = 3
        try:
            os.setsid()
            os.chdir(self.tree)
            log = os.open(self.tree / "mutant.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(log, 1), os.dup2(log, 2)
            resource.setrlimit(resource.RLIMIT_CPU, (int(self.seconds), int(self.seconds) + 5))
            os.environ |= {"PYTHONPATH": str(self.tree), "RIGMATCH_CACHE": str(self.tree.parent / "compiled")}
            os.environ["PYTHONDONTWRITEBYTECODE"] = "1" if self.file else ""
            sys.dont_write_bytecode = bool(self.file)
            sys.path[:] = [str(self.tree), *(path for path in sys.path if Path(path).resolve() != ROOT)]
            for name in [name for name in sys.modules if name.partition(".")[0] == "tests"]:
                del sys.modules[name]
            importlib.invalidate_caches()
            settings = ["-x", "-q", "-p", "no:randomly", "-p", "no:cacheprovider", "--assert=plain", "--timeout=0"]
            no_dump = ["-o", "faulthandler_timeout=0", "-o", "faulthandler_exit_on_timeout=false"]
            end = int(pytest.main([*settings, *no_dump, *self.tests], plugins=[FirstFailure(self.tree)]))
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(end)

    def ended(self) -> int | None:
        """pytest's exit code, negative of a signal, None while it runs; the fault is taken out again at the end."""
        pid, status = os.waitpid(self.pid, os.WNOHANG)
        if pid == 0 and time.monotonic() - self.began < 300 + 10 * self.seconds:
            return None
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)  # and what the tests began
        if pid == 0:
            _, status = os.waitpid(self.pid, 0)
        if self.file:
            shutil.copy2(ROOT / self.file, self.tree / self.file)
        return os.waitstatus_to_exitcode(status)

    @property
    def failure(self) -> str:
        """The first test that failed."""
        path = self.tree / "mutant.failure"
        return path.read_text(encoding="utf-8") if path.exists() else ""


class FirstFailure:
    """Writes the name of the first test that fails."""

    def __init__(self, tree: Path):
        self.path = tree / "mutant.failure"
        self.path.unlink(missing_ok=True)

    def pytest_runtest_logreport(self, report) -> None:
        if report.failed and not self.path.exists():
            self.path.write_text(report.nodeid, encoding="utf-8")


def plant(path: Path, source: str) -> None:
    """Write a file anew, with a time that no bytecode has."""
    before = path.stat().st_mtime
    path.write_text(source, encoding="utf-8")
    os.utime(path, (before - 1e6, before - 1e6))
