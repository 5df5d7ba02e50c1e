"""The C compiler of this machine: found, tried once on a program with a known answer, and called.

A command line holds nothing but flags and fixed names of files; what is compiled is written by CasADi and this package.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

from modelling.common.errors import InputError

COMPILE_SECONDS = 300.0  # after which a compiler is given up
TRIAL_SECONDS = 20.0  # the same for its version and for the trial, which take a twentieth of a second
LIBRARY = "made.so"  # name of what is compiled, in a folder of its own
TRIAL_FLAGS = ("-O1", "-shared", "-fPIC", "-std=c11")
TRIAL = """#include <math.h>
double trial(double x, int n) { double y = 0.5; while (n--) y = y * x + floor(3.7 * y) - 0.25; return y; }
"""
TOO_MANY_FILES = (errno.EMFILE, errno.ENFILE)
TRIAL_ANSWER = "[35.25, 1693.25]"  # by hand: of (1.5, 3) and of (2.0, 5)
ELF_HEAD = struct.Struct("<40xQ10xHH2x")  # where the table of sections begins, size and number of its entries
CALL_TRIAL = """import ctypes, sys
trial = ctypes.CDLL(sys.argv[1]).trial
trial.restype, trial.argtypes = ctypes.c_double, [ctypes.c_double, ctypes.c_int]
print([trial(1.5, 3), trial(2.0, 5)])
"""


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
    """What is wrong with a compiler; empty if its trial program gives the right answer.

    Raises
    ------
    OSError
        If too many files are open to try it.
    """
    try:
        made = compile_library(cc, TRIAL_FLAGS, {"trial.c": TRIAL}, "trial.c", TRIAL_SECONDS)
        with tempfile.TemporaryDirectory(prefix="rigmatch-") as work:
            (Path(work) / LIBRARY).write_bytes(made)
            call = [sys.executable, "-I", "-S", "-c", CALL_TRIAL, str(Path(work) / LIBRARY)]
            answer = _printed(call, work)
    except CompilerFault as fault:
        return str(fault)
    except OSError as fault:  # no room for temporary files, say
        if fault.errno in TOO_MANY_FILES:  # nothing else would work either
            raise
        return fault.strerror or str(fault)
    return "" if answer == TRIAL_ANSWER else "what it makes does not run or gives wrong answers"


def works(cc: str) -> bool:
    """Whether a compiler passes its trial; if not, a :class:`CompilerWarning` says so, once a process."""
    fault = fault_of(cc)
    if fault:
        _warn(f"the C compiler {cc} does not work ({fault}): simulations run without it, which takes ten times as long")
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


def compile_library(
    cc: str, flags: Sequence[str], files: Mapping[str, str], source: str, seconds: float = COMPILE_SECONDS
) -> bytes:
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
        _run([cc, *flags, "-o", LIBRARY, source, "-lm"], work, seconds)  # no folder: the library tells of none
        made = Path(work) / LIBRARY
        content = made.read_bytes() if made.is_file() else b""
    if not content:
        raise CompilerFault("it made no library")
    if _is_cut_off(content):  # loading it would end this process, and every later one that finds it in the cache
        raise CompilerFault("the library that it made is cut off")
    return content


def _is_cut_off(library: bytes) -> bool:
    """Whether an ELF file of 64 bits, as Linux has them, ends before its table of sections, which stands last."""
    if not library.startswith(b"\x7fELF\x02\x01"):
        return False
    if len(library) < ELF_HEAD.size:
        return True
    begin, size, count = ELF_HEAD.unpack_from(library)
    return bool(begin + size * count > len(library))


@functools.cache
def version(cc: str) -> str:
    """What a compiler says of itself; its path if it says nothing."""
    try:
        return _run([cc, "--version"], None, TRIAL_SECONDS) or cc
    except CompilerFault:
        return cc


@functools.cache
def processor_options(cc: str) -> str:
    """What ``-march=native`` means to GCC on this machine; empty for a compiler that does not say it."""
    try:
        return _run([cc, "-march=native", "-Q", "--help=target"], None, TRIAL_SECONDS)
    except CompilerFault:
        return ""


def _printed(command: Sequence[str], folder: str) -> str:
    try:
        return _run(command, folder, TRIAL_SECONDS)
    except CompilerFault:  # it crashes, or does not end
        return ""


@functools.cache
def _warn(line: str) -> None:
    warnings.warn(line, CompilerWarning, stacklevel=4)


def _run(command: Sequence[str], folder: str | None, seconds: float) -> str:
    """What a command prints; it and all that it began are ended after so many seconds, or when this is interrupted.

    Raises
    ------
    CompilerFault
        If it cannot be run, fails or takes longer.
    OSError
        If it says that the disk is full, or too many files are open to run it.
    """
    environment = os.environ | ({"TMPDIR": folder} if folder else {})  # what a killed compiler leaves goes with it
    try:
        running = subprocess.Popen(
            command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True, errors="replace", start_new_session=True,
        )  # fmt: skip
    except OSError as fault:
        if fault.errno in TOO_MANY_FILES:
            raise
        raise CompilerFault(f"{fault.strerror or fault}") from None
    with running:
        try:
            out, said = running.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            raise CompilerFault(f"no end after {seconds:g} s") from None
        finally:
            if running.returncode is None:
                with contextlib.suppress(OSError):
                    if hasattr(os, "killpg"):
                        os.killpg(running.pid, signal.SIGKILL)
                    else:
                        running.kill()
    if running.returncode:
        lines = said.splitlines()
        if (full := os.strerror(errno.ENOSPC)) in said:
            raise OSError(errno.ENOSPC, full, folder)
        raise CompilerFault(next((line for line in lines if "error" in line), lines[0] if lines else "it fails"))
    return out.strip()
