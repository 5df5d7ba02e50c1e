"""What a recording cannot tell from a named cause, by the Fisher information of each candidate beside all others.

Where a speed never changes its sign, friction, a constant torque and an offset change the readings alike. To first
order a candidate takes the place of a cause as far as what the cause changes, freed of what every fitted quantity can
change, lies in the span of what the candidate changes, freed likewise; the square of the part that is left is the
noncentrality of a test between both (Silvey, Statistical Inference, 1975, section 7.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from matching.diagnosis.candidates.cause import Cause
from matching.diagnosis.candidates.screening import ScreenedCandidate, Screening
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.reweighting import reweighted
from matching.diagnosis.search.hypothesis import Hypothesis
from modelling.effects import EFFECTS

TOLD_APART = 9.0  # χ² over its inflation by which a candidate has to fall short of a cause: three standard deviations
ABOVE_NOISE = 4.0  # times that which the cause itself has to explain, or everything would be alike


@dataclass(frozen=True)
class KnownScreening:
    """A screening that the search has made, and the best guess of each candidate of it; none where it is not known."""

    screening: Screening
    screened: Sequence[ScreenedCandidate]

    def of(self, fit: Fit) -> Screening | None:
        """The screening, to be asked something else; None where it is that of another fit."""
        return copy(self.screening) if self.screening.fit is fit else None

    def too_small(self, least: float) -> set[tuple[str, str]]:
        """Kinds and places that take less than that of the residual's length."""
        best: dict[tuple[str, str], float] = {}
        for candidate in self.screened:
            name = candidate.kind_and_place
            best[name] = max(best.get(name, 0.0), candidate.reduction)
        return {name for name, reduction in best.items() if np.sqrt(reduction) < least}


def not_told_apart(
    final: Hypothesis, without: Hypothesis, cause: Cause, inflation: float, known: KnownScreening | None
) -> list[tuple[str, str]]:
    """Kinds and places of no more parameters that a recording cannot tell from a cause, the nearest first.

    Parameters
    ----------
    final, without : Hypothesis
        The final hypothesis, and the same without the cause.
    inflation : float
        By how much χ² overstates what is known.
    known : KnownScreening or None
        Taken where it is that of ``without``.
    """
    fit = without.fit
    if fit.residual.shape != final.fit.residual.shape:  # one of them fitted to windows, where shafts rattle
        return []
    if fit.problem.weighting is not final.fit.problem.weighting:
        fit = reweighted(fit, final.fit.problem.weighting)
    again = known.of(fit) if known else None
    screening = again or Screening(fit)
    left = screening.free(final.fit.residual)
    screening.residual = screening.free(fit.residual) - left
    explained = float(screening.residual @ screening.residual)
    limit = TOLD_APART * inflation
    if explained < ABOVE_NOISE * limit:
        return []
    best: dict[tuple[str, str], float] = {}
    # what takes so little of the whole residual cannot take what the cause took of it: triangle inequality
    least = np.sqrt(explained - limit) - np.linalg.norm(left)
    hopeless = known.too_small(float(least)) if known and again else set()
    for candidate in screening.candidates(without.model.system(), hopeless):
        if len(candidate.parameters) > len(cause.keys) or explained - candidate.reduction > limit:
            continue
        if _within_recorded(candidate, without):
            name = candidate.kind, candidate.at
            best[name] = max(best.get(name, 0.0), candidate.reduction)
    best.pop((cause.kind, cause.at), None)
    return sorted(best, key=lambda name: -best[name])


def _within_recorded(candidate: ScreenedCandidate, without: Hypothesis) -> bool:
    """Whether what a candidate would have to be lies within what the recording has shown."""
    recorded = without.model.recorded
    if recorded is None or EFFECTS[candidate.kind].replaces_quantity:
        return True
    for key, value in candidate.parameters.items():
        low, high = EFFECTS[candidate.kind].bounds_in_recording(key, candidate.at, recorded)
        if not low <= value <= high:
            return False
    return bool(np.isfinite(list(candidate.parameters.values())).all())
