"""The binary of an FMU, where there is a C compiler."""

from __future__ import annotations

import platform
from collections.abc import Mapping

from modelling.simulation.integrator.c_compiler import CompilerFault, check, compile_library, compiler

# no -march: a binary runs on every machine of the platform; no contraction: the same figures everywhere
FLAGS = (
    "-O2", "-std=c11", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno", "-w",
)  # fmt: skip
SUFFIX = {"linux": "so", "darwin": "dylib", "windows": "dll"}


def folder(fmi: str) -> str:
    """Name of this platform in the folder ``binaries`` of an FMU."""
    system = platform.system().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    if fmi == "2.0" and machine == "x86_64":
        return {"linux": "linux64", "darwin": "darwin64", "windows": "win64"}.get(system, f"{machine}-{system}")
    return f"{machine}-{system}"


def binary(files: Mapping[str, str], source: str) -> bytes | None:
    """The shared library of C files by name, of which ``source`` includes the others; None without a compiler.

    Raises
    ------
    InputError
        If there is a compiler that does not work.
    RuntimeError
        If a compiler that works does not compile the sources.
    """
    cc = compiler()
    if cc is None:
        return None
    check(cc)
    try:
        return compile_library(cc, FLAGS, files, source)
    except CompilerFault as fault:
        raise RuntimeError(f"the sources of the FMU do not compile: {fault}") from None
