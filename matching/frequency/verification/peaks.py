"""Largest torques, twists, speeds and powers over the manoeuvre, held against the limits of the case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.loop.parts import Parts
from matching.frequency.verification.simulation import Traces


@dataclass(frozen=True)
class Violation:
    """A limit of the case that is broken: its key, where, the value and what is allowed, SI."""

    limit: str
    where: str
    value: float
    allowed: float

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return dict(vars(self))


def peaks_of(parts: Parts, traces: Traces) -> dict[str, float]:
    """Largest magnitudes of the matched rig's dynamometer and shaft traces, operating point included, by name.

    ``dynamometers.NAME.torque_over_speed`` is the largest share of the torque that the dynamometer has at its speed.
    """
    names = [f"dynamometers.{dyno.name}.{what}" for dyno in parts.dynamometers for what in ("torque", "speed", "power")]
    names += [f"shafts.{shaft.name}.{what}" for shaft in parts.case.rig.shafts for what in ("torque", "twist")]
    peaks = {name: float(np.abs(traces.absolute(name)).max()) for name in names if name in traces.matched}
    curve = parts.case.torque_curve
    if curve is not None:
        for place in (f"dynamometers.{dyno.name}" for dyno in parts.dynamometers):
            used = curve.used(traces.matched[f"{place}.torque"], traces.matched[f"{place}.speed"])
            peaks[f"{place}.torque_over_speed"] = used
    return peaks


def violations_of(
    case: Case, peaks: Mapping[str, float], margin: float, least_damping: tuple[float, float]
) -> tuple[Violation, ...]:
    """Broken limits, furthest off first."""
    violations = []
    for limit, allowed in case.limits.items():
        if limit == "modulus_margin":
            if margin < allowed:
                violations.append(Violation(limit, "feedback loop", margin, allowed))
        elif limit == "damping_ratio":
            if least_damping[0] < allowed:
                violations.append(Violation(limit, f"mode at {least_damping[1]:.3g} Hz", least_damping[0], allowed))
        elif limit.startswith("dynamometer_"):
            what = limit.removeprefix("dynamometer_")
            values = {
                name: peak
                for name, peak in peaks.items()
                if name.startswith("dynamometers.") and name.endswith(f".{what}")
            }
            violations += [Violation(limit, name, value, allowed) for name, value in values.items() if value > allowed]
        elif peaks.get(limit, 0.0) > allowed:
            violations.append(Violation(limit, limit, peaks[limit], allowed))
    return tuple(sorted(violations, key=_excess, reverse=True))


def _excess(violation: Violation) -> float:
    value, allowed = violation.value, violation.allowed
    return value / allowed if value > allowed else allowed / max(value, 1e-12)
