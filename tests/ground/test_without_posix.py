"""Every module imports, and a command runs, where the system is not POSIX."""

import subprocess
import sys

from structure.imports import ROOT, modules

WITHOUT_POSIX = """
import importlib, os, signal, subprocess, sys
import argcomplete, casadi, jinja2, matplotlib.pyplot, numpy, pint, scipy.linalg, scipy.optimize, scipy.signal
import sympy, tomli_w
for module in ("fcntl", "resource", "pwd", "grp", "termios", "syslog"):
    sys.modules[module] = None  # its import fails
for name in ("fork", "forkpty", "killpg", "getuid", "geteuid", "getpgid", "setsid", "sched_getaffinity"):
    if hasattr(os, name):
        delattr(os, name)
for name in ("SIGHUP", "SIGKILL", "SIGCHLD", "SIGALRM", "pthread_sigmask", "sigtimedwait", "SIG_BLOCK", "SIG_SETMASK"):
    if hasattr(signal, name):
        delattr(signal, name)
for module in sys.argv[2:]:
    importlib.import_module(module)
import rigmatch
sys.argv = ["rigmatch", "modes", sys.argv[1], "--out", "modes"]
sys.exit(rigmatch.main())
"""
EXTRAS = ("matching.explore.live",)  # need packages of an extra


def test_every_module_imports_and_a_command_runs_without_posix(tmp_path):
    """As on Windows: no fork, no signals of POSIX, no locks on folders, no users."""
    names = [name for name in modules() if not name.startswith(EXTRAS) and name != "matching.__main__"]
    model = ROOT / "examples" / "diagnosis" / "model.toml"
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_POSIX, model, *names], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "modes" / "modes.json").exists()
