"""Steps of an FMU timed in C, without Python between."""

import platform
import subprocess
from dataclasses import dataclass
from pathlib import Path

import fmpy

from modelling.simulation.compiled import compiler


@dataclass(frozen=True)
class Timing:
    """Times of a step in µs, and how often memory was asked for during all of them and, to begin with, before."""

    mean: float
    median: float
    slow: float
    longest: float
    allocations: int
    early_allocations: int


def possible():
    return compiler() is not None and platform.libc_ver()[0] == "glibc"


def timed(fmu, work, steps=2000, span=1e-3):
    """Time steps of ``span`` (s) of an FMI 2.0 FMU; ``work`` is a folder to build in."""
    about = fmpy.read_model_description(str(fmu))
    program, folder = Path(work) / "step", fmpy.extract(str(fmu), str(Path(work) / Path(fmu).stem))
    if not program.exists():
        source = Path(__file__).with_name("step.c")
        subprocess.run([compiler(), "-O2", "-rdynamic", "-o", program, source, "-ldl", "-lm"], check=True)
    (library,) = Path(folder).glob("binaries/*/*")
    many = [sum(own.causality == kind for own in about.modelVariables) for kind in ("input", "output")]
    words = [program, library, about.guid, *many, steps, span]
    said = subprocess.run([str(word) for word in words], check=True, capture_output=True, text=True).stdout.split()
    return Timing(*(float(word) for word in said[:4]), *(int(word) for word in said[4:]))
