"""A CasADi function of scalars worked out for very many points at once: compiled with vector operations.

CasADi's own C works out one point after the other. Here each of its instructions becomes one operation on eight
neighbouring points, which the compiler makes of whatever this processor has (GCC's vector extensions, Clang's too).
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import functools
import hashlib
import os
import platform
import re
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
import warnings
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from ctypes import c_longlong, c_void_p
from itertools import pairwise
from pathlib import Path

import casadi as ca
import numpy as np

from modelling.errors import InputError
from modelling.simulation.task import (
    ALPHA,
    GAMMA,
    GAMMA_SUM,
    A,
    C,
    Functions,
    IntegrationTask,
    Trajectories,
    band_order,
    functions,
)

# --- The C compiler of this machine.
#
# A command line holds nothing but flags and fixed names of files; what is compiled is written by CasADi and this
# package.

COMPILE_SECONDS = 300.0  # after which a compiler is given up
LIBRARY = "made.so"  # name of what is compiled, in a folder of its own
TRIAL = "#include <math.h>\ndouble trial(double x) { return floor(x); }\n"  # needs the headers of the C library


class CompilerFault(Exception):
    """The compiler cannot be called, says that the source is wrong, takes too long, or makes no library."""


class CompilerWarning(UserWarning):
    """A compiler that is there but does not work."""


@functools.cache
def compiler() -> str | None:
    """Path of the C compiler: ``CC``, cc, gcc or clang; None if there is none or ``RIGMATCH_COMPILE`` is 0."""
    if os.environ.get("RIGMATCH_COMPILE", "") == "0":
        return None
    wanted = os.environ.get("CC", "")
    return next((path for name in (wanted, "cc", "gcc", "clang") if name and (path := shutil.which(name))), None)


@functools.cache
def fault_of(cc: str) -> str:
    """Why a compiler does not compile a function of one line, as without the C library's headers; empty if it does."""
    try:
        compile_library(cc, ("-shared", "-fPIC"), {"trial.c": TRIAL}, "trial.c")
    except (CompilerFault, OSError) as fault:
        return str(fault)
    return ""


@functools.cache
def works(cc: str) -> bool:
    """Whether a compiler compiles; if not, a :class:`CompilerWarning` says so, once a process."""
    if fault := fault_of(cc):
        line = f"the C compiler {cc} does not work ({fault}): simulations run without it, some forty times slower"
        warnings.warn(line, CompilerWarning, stacklevel=3)
    return not fault


def check(cc: str) -> None:
    """Raise for a compiler that does not work.

    Raises
    ------
    InputError
        Naming it and what is wrong.
    """
    if fault := fault_of(cc):
        right = "name a working compiler in CC, or set RIGMATCH_COMPILE=0 to go without"
        raise InputError(cc, f"the C compiler does not work: {fault}", right)


def compile_library(cc: str, flags: Sequence[str], files: Mapping[str, str], source: str) -> bytes:
    """The shared library of C files by name, of which ``source`` includes the others.

    Raises
    ------
    CompilerFault
        With the compiler's first error.
    OSError
        If there is no room for the files.
    """
    with tempfile.TemporaryDirectory(prefix="rigmatch-") as work:
        for name, text in files.items():
            (Path(work) / name).write_text(text, encoding="utf-8")
        _run([cc, *flags, "-o", LIBRARY, source, "-lm"], work)  # no folder: the library tells of none
        made = Path(work) / LIBRARY
        content = made.read_bytes() if made.is_file() else b""
    if not content:
        raise CompilerFault("it made no library")
    return content


@functools.cache
def version(cc: str) -> str:
    """What a compiler says of itself; its path if it says nothing."""
    try:
        return _run([cc, "--version"], None) or cc
    except CompilerFault:
        return cc


def _run(command: Sequence[str], folder: str | None) -> str:
    """What a command prints.

    Raises
    ------
    CompilerFault
        If it cannot be run, fails or takes longer than :data:`COMPILE_SECONDS`.
    """
    environment = os.environ | ({"TMPDIR": folder} if folder else {})  # what a killed compiler leaves goes with it
    try:
        done = subprocess.run(
            command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True,
            errors="replace", timeout=COMPILE_SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise CompilerFault(f"no end after {COMPILE_SECONDS:g} s") from None
    except OSError as fault:
        raise CompilerFault(f"{fault.strerror or fault}") from None
    if done.returncode:
        lines = done.stderr.splitlines()
        raise CompilerFault(next((line for line in lines if "error" in line), lines[0] if lines else "it fails"))
    return done.stdout.strip()


# --- Where compiled libraries are kept: only what was written here, whole, is loaded again.
#
# An entry ``KEY-DIGEST.so`` carries two checksums: of all that it was made from, and of its content. It is written
# beside its place and moved there in one step. Before it is loaded its content is compared with its name, and what is
# wrong is removed, to be made anew. Folder and entries belong to this user and nobody else may write to them.

SUFFIX = ".so"
DIGITS = 32  # of a checksum, hexadecimal
OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH


@functools.cache
def folder() -> Path:
    """``RIGMATCH_CACHE`` or the user's cache; one of this process alone where that is missing or open to others."""
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    path = Path(os.environ.get("RIGMATCH_CACHE") or Path(caches) / "rigmatch").absolute()
    with contextlib.suppress(OSError):
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.access(path, os.W_OK | os.X_OK) and only_mine(path):
            return path
    own = tempfile.mkdtemp(prefix="rigmatch-")
    atexit.register(shutil.rmtree, own, ignore_errors=True)
    return Path(own)


def only_mine(path: Path) -> bool:
    """Whether a folder or file is this user's and nobody else may write to it."""
    if sys.platform == "win32":
        return True  # the folder lies in the user's profile, which others may not write to
    status = path.lstat()
    return status.st_uid == os.getuid() and not status.st_mode & OTHERS_MAY_WRITE


def kept(key: str) -> Path | None:
    """The entry of a key if there is one that is whole; others are removed."""
    for path in sorted(folder().glob(f"{key}-*{SUFFIX}")):
        with contextlib.suppress(OSError):
            if only_mine(path) and path.is_file() and path.stem.partition("-")[2] == _digest(path.read_bytes()):
                return path
            path.unlink()
    return None


def keep(key: str, content: bytes) -> Path:
    """Keep a library under a key.

    Raises
    ------
    OSError
        If there is no room.
    """
    target = folder() / f"{key}-{_digest(content)}{SUFFIX}"
    with tempfile.TemporaryDirectory(prefix=".new-", dir=target.parent) as work:
        made = Path(work) / LIBRARY
        made.write_bytes(content)
        made.chmod(0o600)
        os.replace(made, target)
    return target


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:DIGITS]


# --- Generated C → a shared library in the cache, where there is a compiler.

FLAGS = ("-shared", "-fPIC", "-std=c11", "-fno-math-errno", "-fno-semantic-interposition", "-w")
# the generated part differs by model: here the compiler's own time counts
GENERATED, DRIVER = "-O1 -fstrict-aliasing", "-O3"  # speed only
SOURCE = "step.c"
# one translation unit, in this order
DRIVER_FILES = ("types.h", "rates.c", "readings.c", "steps.c", "errors.c", "run.c")

# fmax and fmin of the C library are calls, and a lash takes ten of them. NaN operands are ignored, as in C's fmax: of a
# comparison that is false the second operand remains, so a constant, which is a number, needs no further test.
PRELUDE = """#include <math.h>
#define NUMBER(x) (__builtin_constant_p(x) && x == x)
static inline double larger(double x, double y)
{
    if (NUMBER(x)) return y > x ? y : x;
    double found = x > y ? x : y;
    return NUMBER(y) || y == y ? found : x;
}
static inline double smaller(double x, double y)
{
    if (NUMBER(x)) return y < x ? y : x;
    double found = x < y ? x : y;
    return NUMBER(y) || y == y ? found : x;
}
#define fmax larger
#define fmin smaller
"""
HELPER = re.compile(r"^casadi_real (?=casadi_\w+\()", re.MULTILINE)  # CasADi's own functions of numbers, e.g. fmax
# each input is looked up, and each result written, only where there is one
INPUT, RESULT = re.compile(r"(arg\[\d+\])\? (\1\[\d+\]) : 0;"), re.compile(r"if \((res\[\d+\])!=0\) (?=\1\[)")

_LIBRARIES: dict[int, tuple[Functions, ctypes.CDLL | None]] = {}


def library(functions: Functions) -> ctypes.CDLL | None:
    """The library with all functions of a step, compiled if the cache lacks it; None without a working compiler."""
    if not compiler():
        return None
    kept = _LIBRARIES.get(id(functions))
    if kept is None:
        source = RESULT.sub("", INPUT.sub(r"\2;", generated(*functions.all)))  # the driver gives them all
        made = library_of(source, GENERATED, [function.name() for function in functions.all])
        kept = _LIBRARIES[id(functions)] = (functions, made)
    return kept[1]


def driver() -> ctypes.CDLL | None:
    """The library with ``run``, one for all models; None without a working compiler."""
    return _driver() if compiler() else None


@functools.cache
def _driver() -> ctypes.CDLL | None:
    here = Path(__file__).with_name("c")
    return library_of("\n".join((here / name).read_text(encoding="utf-8") for name in DRIVER_FILES), DRIVER, ["run"])


def external(function: ca.Function) -> ca.Function:
    """A CasADi function compiled, some twenty times faster than as it was; itself without a working compiler."""
    if not compiler():
        return function
    library = shared(generated(function), GENERATED)
    try:
        return function if library is None else ca.external(function.name(), str(library))
    except RuntimeError:  # e.g. a folder mounted noexec
        return function


def generated(*functions: ca.Function) -> str:
    """C of CasADi functions."""
    generator = ca.CodeGenerator("generated", {"with_header": False})
    for function in functions:
        generator.add(function)
    return PRELUDE + HELPER.sub("static inline casadi_real ", str(generator.dump()))  # calls cost more than they do


def compile_ahead(functions: Iterable[Functions], processes: int = 2) -> None:
    """Compile many at once, for a search over structures; afterwards :func:`library` finds them."""
    with ThreadPoolExecutor(processes) as pool:  # the work is the compiler's, in processes of its own
        list(pool.map(library, functions))


def shared(source: str, optimisation: str) -> Path | None:
    """The shared library of C, compiled if the cache lacks it; None without a working compiler."""
    cc = compiler()
    if cc is None:
        return None
    flags = (*optimisation.split(), *FLAGS)
    made_from = (source, version(cc), cc, *flags, platform.machine())
    key = hashlib.sha256("\0".join(made_from).encode()).hexdigest()[:32]
    if (library := kept(key)) or not works(cc):
        return library
    try:
        return keep(key, compile_library(cc, flags, {SOURCE: source}, SOURCE))
    except (OSError, CompilerFault):  # a full disk, or a source that this compiler does not take
        return None


def library_of(source: str, optimisation: str, names: Iterable[str]) -> ctypes.CDLL | None:
    """The library with all these functions, made from C; None without a working compiler.

    One in the cache that cannot be loaded, as where a disk was full or another system wrote it, is made anew.
    """
    for _ in range(2):
        target = shared(source, optimisation)
        if target is None:
            return None
        try:
            library = ctypes.CDLL(str(target))
        except OSError:
            if _mounted_noexec(target):  # compiling again would not help
                return None
            target.unlink(missing_ok=True)
            continue
        return library if all(hasattr(library, name) for name in names) else None
    return None


def _mounted_noexec(path: Path) -> bool:
    """Whether nothing may be run from where a file lies; only some systems tell."""
    if sys.platform == "win32":
        return False
    flag = getattr(os, "ST_NOEXEC", 0)
    return bool(flag and os.statvfs(path).f_flag & flag)


# --- The compiled integrator, called through ctypes.

SHARES = 2  # a thread, at least: threads end together though not all shares take as long
INTERRUPTIBLE = 3e7  # operations, some 30 ms: what takes longer runs beside the main thread, which takes signals

_COUNTS = [
    "first_row", "end_row", "samples", "states", "coordinates", "inputs", "sensors", "columns", "groups", "constants",
    "parameters", "sz_iw", "sz_w",
]  # fmt: skip
_ARRAYS = [
    "steps", "time", "input", "constant", "start", "input_delay", "group_delay", "group", "state", "out", "error",
    "failed", "stop",
    "selected", "start_derivative", "input_delay_derivative", "sensor_delay_derivative", "derivative",
]  # fmt: skip
_PATTERNS = tuple("ABPCDQ")


class _Pattern(ctypes.Structure):
    _fields_ = [("start", c_void_p), ("row", c_void_p)]


class _Run(ctypes.Structure):
    """``Run`` of ``c/types.h``, field by field."""

    _fields_ = [
        *((name, c_void_p) for name in ("field", "reading", "jacobian")),
        *((name, c_longlong) for name in _COUNTS),
        *((name, c_void_p) for name in _ARRAYS),
        *((name, _Pattern) for name in _PATTERNS),
        ("method", c_void_p),
        ("place", c_void_p),
        *((name, c_longlong) for name in ("lower", "upper")),
    ]


_METHOD = np.concatenate([part.ravel() for part in (A, C, ALPHA, GAMMA_SUM)] + [np.array([GAMMA])])


def run_compiled(
    task: IntegrationTask, states: bool = True, readings: bool = True, threads: int = 1, errors: bool = False
) -> Trajectories | None:
    """Run a task; None without a compiler.

    What is not asked for comes back empty. The rows of a batch may be shared out among ``threads``; no result depends
    on how many. Ctrl-C ends a long run at once.
    """
    done = run_all_compiled([task], states, readings, threads, errors)
    return None if done is None else done[0]


def run_all_compiled(
    tasks: Sequence[IntegrationTask], states: bool = True, readings: bool = True, threads: int = 1, errors: bool = False
) -> list[Trajectories] | None:
    """The same for several tasks of one model, side by side.

    Raises
    ------
    MemoryError
        If the integrator gets no memory.
    """
    made = functions(tasks[0].model, tasks[0].columns > 0, tasks[0].implicit)
    code = library(made)
    general = driver() if code else None
    if code is None or general is None:
        return None
    stop = ctypes.c_int(0)
    last_rows = np.cumsum([len(task.p) for task in tasks])
    constants = np.split(made.constants_of(np.concatenate([task.p for task in tasks])), last_rows[:-1])
    prepared = [
        _Prepared(task, made, code, constant, stop, states, readings, errors)
        for task, constant in zip(tasks, constants, strict=True)
    ]
    runs = [task.run for task in prepared]
    work = sum(task.step_count for task in tasks) * 4 * made.field.n_instructions()
    if threads > 1:
        pieces = -(-SHARES * threads // len(tasks))
        runs = [share for whole in runs for share in _shares(whole, pieces)]
    if threads > 1 or (work > INTERRUPTIBLE and threading.current_thread() is threading.main_thread()):
        ends = _run_beside(general, runs, stop, threads)
    else:
        ends = [general.run(ctypes.byref(each)) for each in runs]
    if any(ends):
        raise MemoryError("the integrator found no memory")
    return [task.results for task in prepared]


def _run_beside(general: ctypes.CDLL, runs: Sequence[_Run], stop: ctypes.c_int, threads: int) -> list[int]:
    """Run in other threads, which ctypes lets go on during a call; whatever interrupts the wait ends the runs."""
    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(general.run, ctypes.byref(each)) for each in runs]
        try:
            return [future.result() for future in futures]
        except BaseException:
            stop.value = 1
            raise


class _Prepared:
    """The integrator's view ``run`` of a task, the arrays that it points to, and the results that it fills."""

    def __init__(
        self,
        task: IntegrationTask,
        made: Functions,
        code: ctypes.CDLL,
        constant: np.ndarray,
        stop: ctypes.c_int,
        states: bool,
        readings: bool,
        errors: bool,
    ):  # what a run consists of
        model, b, t, s = task.model, len(task.p), len(task.time), task.columns
        x, y = len(model.states), len(model.sensors)
        self.results = Trajectories(
            np.full((b, t, x) if states else (0,), np.nan),
            np.full((b, t, y) if readings else (0,), np.nan),
            np.full((b, 2), -1, dtype=np.int64),
            np.full((b, t, y, s), np.nan),
            np.full((b, t - 1, y + x - model.n) if errors else (0,), np.nan),
        )
        pointers = [ctypes.cast(getattr(code, function.name()), c_void_p) for function in made.all]
        self.run = _Run(
            *pointers, *[None] * (3 - len(pointers)), 0, b, t, x, model.n, len(model.inputs), y, s,
            task.group_delay.shape[1], constant.shape[1], len(model.parameters),
            max(function.sz_iw() for function in made.all), max(function.sz_w() for function in made.all),
            stop=ctypes.addressof(stop),
        )  # fmt: skip
        self._kept: list = [stop]
        reals = {
            "time": task.time, "input": task.inputs, "constant": constant, "start": task.start,
            "input_delay": task.input_delay, "group_delay": task.group_delay,
            "start_derivative": task.start_derivative, "input_delay_derivative": task.input_delay_derivative,
            "sensor_delay_derivative": task.sensor_delay_derivative,
        }  # fmt: skip
        for name, array in reals.items():
            self._point(name, np.ascontiguousarray(array, dtype=float))
        self._point("steps", task.steps)
        self._point("group", task.group)
        self._point("selected", task.selected)
        self._point("failed", self.results.failed)
        self._point("derivative", self.results.derivatives)
        if states:
            self._point("state", self.results.states)
        if errors:
            self._point("error", self.results.errors)
        if readings:
            self._point("out", self.results.readings)
        if s:
            outputs = [function.sparsity_out(i) for function in (made.field, made.reading) for i in (1, 2, 3)]
            self._patterns(dict(zip(_PATTERNS, outputs, strict=True)))
        if made.jacobian is not None:
            order = band_order(made.jacobian)
            self._patterns({"A": made.jacobian.sparsity_out(0), "B": made.jacobian.sparsity_out(1)})
            self._point("place", order.place)
            self._point("method", _METHOD)
            self.run.lower, self.run.upper = order.lower, order.upper

    def _point(self, name: str, array: np.ndarray) -> None:
        self._kept.append(array)
        setattr(self.run, name, array.ctypes.data)

    def _patterns(self, patterns: dict) -> None:
        for name, sparsity in patterns.items():
            start, row = (np.array(part, dtype=np.int64) for part in (sparsity.colind(), sparsity.row()))
            self._kept += [start, row]
            setattr(self.run, name, _Pattern(start.ctypes.data, row.ctypes.data))


def _shares(run: _Run, pieces: int) -> list[_Run]:
    """The same run in pieces, each for some rows of the batch only."""
    out = []
    for first, last in pairwise(np.linspace(0, run.end_row, min(pieces, run.end_row) + 1).astype(int)):
        share = _Run.from_buffer_copy(run)
        share.first_row, share.end_row = int(first), int(last)
        out.append(share)
    return out
