"""Generated C → a shared library in the cache, where there is a compiler."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca

from modelling.simulation.integrator.functions import Functions

FLAGS = ("-shared", "-fPIC", "-std=c11", "-fno-math-errno", "-fno-semantic-interposition", "-w")
GENERATED, DRIVER = "-O1", "-O2"  # the generated part differs by model: here the compiler's own time counts
DRIVER_FILES = ("types.h", "rates.c", "readings.c", "steps.c", "run.c")  # one translation unit, in this order
SECONDS = 300  # after which a compiler is given up

# The C library's own are calls, and a lash takes ten of them. What is not a number gives way here too.
PRELUDE = """#include <math.h>
static inline double larger(double x, double y) { double found = x > y ? x : y; return y == y ? found : x; }
static inline double smaller(double x, double y) { double found = x < y ? x : y; return y == y ? found : x; }
#define fmax larger
#define fmin smaller
"""


@functools.cache
def compiler() -> str | None:
    """Path of the C compiler: ``CC``, cc, gcc or clang; None if there is none or ``RIGMATCH_COMPILE`` is 0."""
    if os.environ.get("RIGMATCH_COMPILE", "") == "0":
        return None
    wanted = os.environ.get("CC", "")
    return next((path for name in (wanted, "cc", "gcc", "clang") if name and (path := shutil.which(name))), None)


@functools.cache
def folder() -> Path:
    """Where libraries are kept: ``RIGMATCH_CACHE``, the user's cache, or one of this process if that is closed."""
    own = os.environ.get("RIGMATCH_CACHE") or os.path.join(os.environ.get("XDG_CACHE_HOME") or "~/.cache", "rigmatch")
    path = Path(own).expanduser()
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.access(path, os.W_OK) and path.stat().st_uid == os.getuid():  # nobody else's code is loaded
            return path
    except (OSError, AttributeError):
        pass
    return Path(tempfile.mkdtemp(prefix="rigmatch-"))


_LIBRARIES: dict[int, tuple[Functions, ctypes.CDLL | None]] = {}


def library(functions: Functions) -> ctypes.CDLL | None:
    """The library with all functions of a step, compiled if the cache lacks it; None without a working compiler."""
    if not compiler():
        return None
    kept = _LIBRARIES.get(id(functions))
    if kept is None:
        made = _load(generated(*functions.all), GENERATED)
        kept = _LIBRARIES[id(functions)] = (functions, made)
    return kept[1]


def driver() -> ctypes.CDLL | None:
    """The library with ``run``, one for all models; None without a working compiler."""
    return _driver() if compiler() else None


@functools.cache
def _driver() -> ctypes.CDLL | None:
    here = Path(__file__).with_name("c")
    return _load("\n".join((here / name).read_text(encoding="utf-8") for name in DRIVER_FILES), DRIVER)


def external(function: ca.Function) -> ca.Function:
    """A CasADi function compiled, some twenty times faster than as it was; itself without a working compiler."""
    if not compiler():
        return function
    source = generated(function)
    return loaded(function.name(), shared(source, lambda: source, GENERATED)) or function


def generated(*functions: ca.Function) -> str:
    """C of CasADi functions."""
    generator = ca.CodeGenerator("generated", {"with_header": False})
    for function in functions:
        generator.add(function)
    return PRELUDE + str(generator.dump())


def loaded(name: str, library: Path | None) -> ca.Function | None:
    """A CasADi function out of a library; None without one, or where it cannot be loaded."""
    try:
        return None if library is None else ca.external(name, str(library))
    except RuntimeError:  # e.g. a folder mounted noexec
        return None


def compile_ahead(functions: Iterable[Functions], processes: int = 2) -> None:
    """Compile many at once, for a search over structures; afterwards :func:`library` finds them."""
    with ThreadPoolExecutor(processes) as pool:  # the work is the compiler's, in processes of its own
        list(pool.map(library, functions))


def shared(content: str, source: Callable[[], str], optimisation: str) -> Path | None:
    """The shared library of C that ``source`` writes, which is called only if the cache lacks it.

    ``content`` is all that the source is made from. None without a working compiler.
    """
    cc = compiler()
    if cc is None:
        return None
    flags = (optimisation, *FLAGS)
    made_from = (content, PRELUDE, _version(cc), *flags, platform.machine())
    key = hashlib.sha256("\0".join(made_from).encode()).hexdigest()[:32]
    target = folder() / f"{key}.so"
    return target if target.exists() or _compile([cc, *flags], source(), target) else None


def _load(source: str, optimisation: str) -> ctypes.CDLL | None:
    target = shared(source, lambda: source, optimisation)
    try:
        return None if target is None else ctypes.CDLL(str(target))
    except OSError:  # e.g. a folder mounted noexec
        return None


def _compile(command: list[str], source: str, target: Path) -> bool:
    """Compile beside the target and move there at once, so that processes may race."""
    try:
        with tempfile.TemporaryDirectory(dir=target.parent) as work:
            code, made = Path(work) / "step.c", Path(work) / "step.so"
            code.write_text(source, encoding="utf-8")
            command = [*command, "-o", str(made), str(code), "-lm"]
            subprocess.run(command, check=True, capture_output=True, timeout=SECONDS)
            os.replace(made, target)
    except (OSError, subprocess.SubprocessError):  # no working compiler, or a full disk
        return False
    return True


@functools.cache
def _version(cc: str) -> str:
    try:
        return subprocess.run([cc, "--version"], capture_output=True, text=True, timeout=SECONDS).stdout
    except (OSError, subprocess.SubprocessError):
        return cc
