"""Backlash: what neither noise nor the Jacobian of a fit tells of the uncertainty of its gap.

A recording may show one flank only.

With drive torque throughout, a shaft crosses its backlash once at most: what part of the gap was ahead at the start is
known, what part was behind is not. χ² is then constant in the gap from some value on, so the fit ends anywhere there,
and its Jacobian takes that value for well known.

The gap is the way from one flank to the other, so it is known no better than the time of contact. A rattling shaft
magnifies every difference, and its Jacobian takes that for knowledge of times far below a sampling interval, where
neither the channels of a sample nor two integrations of the motion agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from matching.diagnosis.candidates.cause import Cause
from matching.diagnosis.candidates.motion import simulated_motion
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.uncertainty import Estimate
from modelling.effects import EFFECTS

CONTACT_TIME_SHARE = 0.01  # of the sampling interval: how well the channels of a sample belong to the same instant
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


def as_late_as_contact(estimates: Mapping[str, Estimate], fit: Fit, causes: Sequence[Cause]) -> dict[str, Estimate]:
    """Estimates with gaps as uncertain, besides noise, as the twist that passes while a contact may be."""
    out = dict(estimates)
    backlashes = [cause for cause in causes if EFFECTS[cause.kind].free_play]
    if not backlashes:
        return out
    motion = simulated_motion(fit)
    unknown_time = CONTACT_TIME_SHARE * fit.problem.data.sampling_interval
    for cause in backlashes:
        shaft, name = cause.at.split(".")[1], cause.names()[EFFECTS[cause.kind].free_play]
        gap = out[name]
        crossing = motion.twist_rate[shaft][np.abs(motion.twist[shaft]) < gap.value / 2]
        if len(crossing):
            passed = unknown_time * float(np.sqrt(np.mean(crossing**2)))
            out[name] = replace(gap, standard_uncertainty=float(np.hypot(gap.standard_uncertainty, passed)))
    return out
