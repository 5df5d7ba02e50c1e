"""The binary of an FMU, where there is a C compiler."""

from __future__ import annotations

import platform
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from modelling.simulation.integrator.c_library import SECONDS, compiler

# no -march: a binary runs on every machine of the platform; no contraction: the same figures everywhere
FLAGS = (
    "-O2", "-std=c11", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno", "-w",
)  # fmt: skip
SUFFIX = {"linux": "so", "darwin": "dylib"}


def folder(fmi: str) -> str:
    """Name of this platform in the folder ``binaries`` of an FMU."""
    system = platform.system().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    if fmi == "2.0" and machine == "x86_64":
        return {"linux": "linux64", "darwin": "darwin64"}.get(system, f"{machine}-{system}")
    return f"{machine}-{system}"


def binary(files: Mapping[str, str], source: str) -> tuple[bytes | None, str]:
    """The shared library of C files by name, of which ``source`` includes the others; or why there is none."""
    cc = compiler()
    if cc is None:
        return None, "no C compiler was found"
    with tempfile.TemporaryDirectory() as work:
        for name, text in files.items():
            (Path(work) / name).write_text(text, encoding="utf-8")
        command = [cc, *FLAGS, "-o", "fmu.so", source, "-lm"]  # names without a folder: the binary tells of none
        try:
            done = subprocess.run(command, cwd=work, capture_output=True, text=True, timeout=SECONDS)
        except (OSError, subprocess.SubprocessError) as fault:
            return None, f"the C compiler {cc} failed: {fault}"
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error" in line] or done.stderr.splitlines() or [""]
            return None, f"the C compiler {cc} failed: {lines[0]}"
        return (Path(work) / "fmu.so").read_bytes(), ""
