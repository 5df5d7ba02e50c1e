"""Small drives that several tests use: inertias in a row, made through the reader of model files."""

from collections.abc import Sequence
from typing import Any

from modelling.model_file import from_dict
from modelling.system import System


def chain(
    J: Sequence[float], stiffness: Sequence[float], damping: Sequence[float] | None = None,
    names: Sequence[str] | None = None, **more: Any,
) -> System:  # fmt: skip
    """Inertias (kg·m²) i0, i1, … or ``names`` in a row, on shafts s0, s1, … (N·m/rad, N·m·s/rad); ``more`` tables."""
    names = names or [f"i{i}" for i in range(len(J))]
    shafts = {
        f"s{i}": {"between": [names[i], names[i + 1]], "stiffness": float(k), "damping": float(d)}
        for i, (k, d) in enumerate(zip(stiffness, [0.0] * len(stiffness) if damping is None else damping, strict=True))
    }
    return from_dict({"inertias": {n: {"J": float(j)} for n, j in zip(names, J, strict=True)}, "shafts": shafts} | more)
