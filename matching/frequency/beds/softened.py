"""Beds whose cut shafts have opened: what a lash between its flanks lets a bed appear to be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from matching.frequency.beds.closed_loop import SampledBeds, sampled_beds
from matching.frequency.case.case import Case

# Of stiffness and damping that is left, from a shaft that carries next to nothing to one that opens for moments. A
# lash that is crossed within a swing acts on the swing like a softer spring and damper, by the share of it that the
# flanks touch (describing function: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968).
SHARES = (0.001, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7)


def softened(case: Case, values: Mapping[str, float], share: float) -> dict[str, float]:
    """Values (SI) of a bed by name, the shafts that its dynamometers follow with ``share`` of stiffness and damping."""
    known, made = case.rig.parameters, dict(values)
    for dynamometer in case.loop.dynamometers:
        for quantity in ("stiffness", "damping"):
            name = f"shafts.{dynamometer.follows}.{quantity}"
            if name in known:
                made[f"rig.{name}"] = share * values.get(f"rig.{name}", known[name].value)
    return made


def damping_left(share: float) -> float:
    """Part of a shaft's damping ratio that is left with ``share`` of its stiffness and damping: the root of it."""
    return float(np.sqrt(share))


def beds_at(case: Case, positions: np.ndarray, left: float = 1.0) -> SampledBeds:
    """Beds at positions (b, p) of the case's box, with ``left`` of the stiffness and damping of their cut shafts."""
    return sampled_beds(case, [softened(case, case.uncertainty.at(position), left) for position in positions])
