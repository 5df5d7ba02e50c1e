"""Generated C → a shared library in the cache, where there is a compiler."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import platform
import re
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca

from modelling.simulation.integrator.c_compiler import (
    CompilerFault,
    compile_library,
    compiler,
    processor_options,
    version,
    works,
)
from modelling.simulation.integrator.functions import Functions
from modelling.simulation.integrator.library_cache import keep, kept

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
    source = generated(function)
    return loaded(function.name(), shared(source, lambda: source, GENERATED)) or function


def generated(*functions: ca.Function) -> str:
    """C of CasADi functions."""
    generator = ca.CodeGenerator("generated", {"with_header": False})
    for function in functions:
        generator.add(function)
    return PRELUDE + HELPER.sub("static inline casadi_real ", str(generator.dump()))  # calls cost more than they do


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
    flags = (*optimisation.split(), *FLAGS)
    made_from = (content, PRELUDE, version(cc), cc, *flags, platform.machine())
    key = hashlib.sha256("\0".join(made_from).encode()).hexdigest()[:32]
    if (library := kept(key)) or not works(cc):
        return library
    try:
        return keep(key, compile_library(cc, flags, {SOURCE: source()}, SOURCE))
    except (OSError, CompilerFault):  # a full disk, or a source that this compiler does not take
        return None


def library_of(
    source: str, optimisation: str, names: Iterable[str], *, this_processor: bool = False
) -> ctypes.CDLL | None:
    """The library with all these functions, made from C; None without a working compiler.

    Made for ``this_processor`` alone it is kept apart for each kind of processor.
    """
    processor = processor_options(compiler() or "") if this_processor and compiler() else ""
    content = f"{source}\n/* {processor} */"
    target = shared(content, lambda: source, f"{optimisation} -march=native" if processor else optimisation)
    try:
        library = None if target is None else ctypes.CDLL(str(target))
    except OSError:  # e.g. a folder mounted noexec
        return None
    return library if all(hasattr(library, name) for name in names) else None
