"""Free play of which a recording shows one side only.

With drive torque throughout, a shaft crosses its free play once at most: what part of the width lay ahead at the start
is told, what lay behind is not. χ² is then flat in the width down to a kink, so the fit ends anywhere on that, and the
Jacobian takes the place for well known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from matching.diagnosis.candidates.candidates import Cause
from matching.diagnosis.candidates.motion import seen
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.uncertainty import Estimate
from modelling.effects import EFFECTS

TOUCHED = 0.02  # of the largest torque of the shaft: on that side it was in contact


def bounded_below(numbers: Mapping[str, Estimate], fit: Fit, causes: Sequence[Cause]) -> dict[str, Estimate]:
    """Estimates with those of free play touched on one side only as uncertain as they are large, and said to be so."""
    out = dict(numbers)
    lashes = [cause for cause in causes if EFFECTS[cause.kind].free_play]
    if not lashes:
        return out
    motion = seen(fit)
    for cause in lashes:
        shaft, name = cause.at.split(".")[1], cause.names()[EFFECTS[cause.kind].free_play]
        torque, twist, own = motion.torque[shaft], motion.twist[shaft], out[name]
        least = TOUCHED * abs(torque).max()
        if torque.min() > -least:
            crossed = own.value / 2 - float(twist.min())
        elif torque.max() < least:
            crossed = own.value / 2 + float(twist.max())
        else:
            continue
        note = f"only one side of the free play is touched: it is at least {min(crossed, own.value):.3g} rad"
        out[name] = replace(own, standard_uncertainty=max(own.standard_uncertainty, abs(own.value)), note=note)
    return out
