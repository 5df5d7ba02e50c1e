"""Python side of engine.c: describes a torsional chain by arrays, compiles the integrator once, runs it."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import shutil
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

SOURCE = Path(__file__).with_name("engine.c")
INTEGERS = ("n", "s", "u", "samples", "substeps", "rows_per_sample", "jump_sample", "disturbed")
SCALARS = ("dt", "disturbance_amplitude", "disturbance_frequency", "disturbance_phase", "warm_from")
INERTIA = (
    "J",
    "drag",
    "friction",
    "friction_reverse",
    "breakaway",
    "breakaway_reverse",
    "stribeck_speed",
    "quadratic",
    "constant",
    "ripple_order",
    "ripple_amplitude",
    "ripple_phase",
    "ripple_follows",
    "place_period",
    "place_amplitude",
    "place_phase",
    "drag_change",
    "drag_warm",
    "curve_over",
    "curve_count",
    "curve_at",
    "curve_torque",
    "imposed",
)
SHAFT_ENDS = ("first", "second")
SHAFT = (
    "ratio",
    "k",
    "c",
    "gap",
    "cubic",
    "dahl_torque",
    "dahl_angle",
    "series_damper",
    "wave_amplitude",
    "wave_order",
    "lost_driven",
    "lost_driving",
    "k_change",
    "k_warm",
    "c_change",
    "c_warm",
    "twist_count",
    "twist_at",
    "twist_torque",
    "slip_stiffness",
    "slip_peak",
    "slip_shape",
)
INPUT_FLAGS = ("on", "controlled")
INPUT = ("gain_change", "gain_warm", "delay", "lag", "factor", "limit", "offset", "gain_p", "gain_i", "torque_limit")
CURVE_POINTS = 33  # of a torque over speed, angle or twist
# values a component: J, drag, k and c have a second block that holds after a parameter jump
WIDTHS = dict.fromkeys(("J", "drag", "k", "c"), 2) | dict.fromkeys(
    ("curve_at", "curve_torque", "twist_at", "twist_torque"), CURVE_POINTS
)
ARRAYS = (
    *INERTIA,
    *SHAFT_ENDS,
    *SHAFT,
    *INPUT_FLAGS,
    *INPUT,
    "reference",
    "feedback_noise",
    "input",
    "start",
    "output",
)


class _Plant(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int) for name in INTEGERS),
        *((name, ctypes.c_double) for name in SCALARS),
        *((name, ctypes.c_void_p) for name in ARRAYS),
    ]


def compiler() -> str | None:
    """Path of a C compiler, or None."""
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


@functools.cache
def library() -> ctypes.CDLL:
    """Compile engine.c for this machine, once per content. Raises RuntimeError where no C compiler is found."""
    digest = hashlib.sha256(SOURCE.read_bytes()).hexdigest()[:16]
    target = Path(tempfile.gettempdir()) / f"truth-plant-{os.getuid()}-{digest}.so"
    if not target.exists():
        if (found := compiler()) is None:
            raise RuntimeError("the truth plant needs a C compiler (cc, gcc or clang) and found none")
        with tempfile.TemporaryDirectory() as folder:
            fresh = Path(folder) / "engine.so"
            subprocess.run([found, "-O3", "-fPIC", "-shared", "-o", fresh, SOURCE, "-lm"], check=True)
            partial = target.with_suffix(f".{os.getpid()}")
            shutil.copy(fresh, partial)
            partial.replace(target)  # atomic: two processes may compile at once
    loaded = ctypes.CDLL(str(target))
    loaded.run.argtypes = [ctypes.POINTER(_Plant)]
    loaded.run.restype = ctypes.c_int
    return loaded


@dataclass
class Chain:
    """A torsional chain as arrays; names are those of engine.c. Angles in rad, torques in N·m, SI throughout."""

    n: int
    s: int
    u: int
    values: dict[str, np.ndarray] = field(default_factory=dict)
    jump_time: float = np.inf
    disturbed: int = -1
    disturbance: tuple[float, float, float] = (0.0, 0.0, 0.0)  # amplitude N·m, frequency rad/s, phase rad
    warm_from: float = 0.0  # s, from which on values that drift do so

    def __post_init__(self) -> None:
        for names, size in ((INERTIA, self.n), (SHAFT, self.s), (INPUT, self.u)):
            for name in names:
                self.values.setdefault(name, np.zeros(WIDTHS.get(name, 1) * size))
        for name, size in (*((end, self.s) for end in SHAFT_ENDS), *((flag, self.u) for flag in INPUT_FLAGS)):
            self.values.setdefault(name, np.zeros(size, dtype=np.int32))
        self.values["ratio"][:] = 1.0
        self.values["ripple_follows"][:] = np.arange(self.n)
        self.values["factor"][:] = 1.0
        self.values["limit"][:] = np.inf
        self.values["torque_limit"][:] = np.inf

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    def fastest(self) -> float:
        """Largest rate of the smooth linear part, rad/s: what the step has to resolve."""
        stiff, damp = np.zeros((self.n, self.n)), np.diag(self["drag"][: self.n])
        for j in range(self.s):
            row = np.zeros(self.n)
            row[self["first"][j]] += 1 / self["ratio"][j]
            row[self["second"][j]] -= 1
            stiff += self["k"][j] * np.outer(row, row)
            damp += self["c"][j] * np.outer(row, row)
        inverse = 1 / self["J"][: self.n, None]
        return max(
            np.sqrt(np.abs(np.linalg.eigvals(inverse * stiff)).max()), np.abs(np.linalg.eigvals(inverse * damp)).max()
        )


@dataclass
class Motion:
    """What happened: (t, n) angle, speed, acceleration; (t, s) torque; (samples, u) recorded input torque."""

    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray
    input: np.ndarray


def simulate(
    chain: Chain,
    inputs: np.ndarray,
    start: np.ndarray,
    dt: float,
    *,
    step: float = 50e-6,
    rows_per_sample: int = 1,
    reference: np.ndarray | None = None,
    feedback_noise: np.ndarray | None = None,
) -> Motion:
    """Integrate the chain over inputs (samples, u) from start (2n: angles, speeds).

    `step` is the largest inner step in s; a chain with faster modes gets a finer one. Raises FloatingPointError when
    the motion is not finite.
    """
    samples = len(inputs)
    finest = min(step, 0.25 / max(chain.fastest(), 1e-3))
    substeps = int(np.ceil(dt / finest / rows_per_sample - 1e-9)) * rows_per_sample
    rows = (samples - 1) * rows_per_sample + 1
    arrays = {name: np.ascontiguousarray(chain[name]) for name in chain.values}
    arrays["input"] = np.array(inputs, dtype=float, order="C", copy=True)
    arrays["start"] = np.array(start, dtype=float)
    arrays["output"] = np.empty((rows, 3 * chain.n + chain.s))
    nothing = np.zeros_like(arrays["input"])
    arrays["reference"] = nothing if reference is None else np.ascontiguousarray(reference, dtype=float)
    arrays["feedback_noise"] = nothing if feedback_noise is None else np.ascontiguousarray(feedback_noise, dtype=float)
    plant = _Plant()
    late = 2**30 if not np.isfinite(chain.jump_time) else round(chain.jump_time / dt)
    sizes = (chain.n, chain.s, chain.u, samples, substeps, rows_per_sample, late, chain.disturbed)
    for name, value in zip((*INTEGERS, *SCALARS), (*sizes, dt, *chain.disturbance, chain.warm_from), strict=True):
        setattr(plant, name, value)
    for name in ARRAYS:
        setattr(plant, name, arrays[name].ctypes.data)
    failed = library().run(ctypes.byref(plant))
    if failed:
        raise FloatingPointError(f"the plant's motion is not finite at sample {failed - 1}")
    n, out = chain.n, arrays["output"]
    time = np.arange(rows) * dt / rows_per_sample
    return Motion(time, out[:, :n], out[:, n : 2 * n], out[:, 2 * n : 3 * n], out[:, 3 * n :], arrays["input"])
