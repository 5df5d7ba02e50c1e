"""Backlash of which a recording shows one flank only.

With drive torque throughout, a shaft crosses its backlash once at most: what part of the gap was ahead at the start is
known, what part was behind is not. χ² is then constant in the gap from some value on, so the fit ends anywhere there,
and its Jacobian takes that value for well known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from matching.diagnosis.candidates.cause import Cause
from matching.diagnosis.candidates.motion import simulated_motion
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.uncertainty import Estimate
from modelling.effects import EFFECTS

CONTACT_SHARE = 0.02  # of the largest torque of the shaft, from which a flank is in contact


def bounded_below(estimates: Mapping[str, Estimate], fit: Fit, causes: Sequence[Cause]) -> dict[str, Estimate]:
    """Estimates with gaps of which one flank was touched as uncertain as they are large, with a note that says so."""
    out = dict(estimates)
    backlashes = [cause for cause in causes if EFFECTS[cause.kind].free_play]
    if not backlashes:
        return out
    motion = simulated_motion(fit)
    for cause in backlashes:
        shaft, name = cause.at.split(".")[1], cause.names()[EFFECTS[cause.kind].free_play]
        torque, twist, gap = motion.torque[shaft], motion.twist[shaft], out[name]
        contact = CONTACT_SHARE * abs(torque).max()
        if torque.min() > -contact:
            crossed = gap.value / 2 - float(twist.min())
        elif torque.max() < contact:
            crossed = gap.value / 2 + float(twist.max())
        else:
            continue
        note = f"only one side of the free play is touched: it is at least {min(crossed, gap.value):.3g} rad"
        uncertainty = max(gap.standard_uncertainty, abs(gap.value))
        out[name] = replace(gap, standard_uncertainty=uncertainty, note=note)
    return out
