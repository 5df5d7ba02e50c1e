"""Every candidate that was fitted alone, with its misfit and why it was not taken."""

from __future__ import annotations

import numpy as np

from matching.diagnosis.fitting.holdout import Holdout, holdout_residuals
from matching.diagnosis.fitting.uncertainty import estimates
from matching.diagnosis.search.hypothesis import Hypothesis
from matching.diagnosis.search.state import SearchState, chi_square_per_reading
from matching.diagnosis.verdict.causes import FittedCandidate

FIT_ERRORS = (FloatingPointError, np.linalg.LinAlgError)


def fitted_candidates(state: SearchState, holdout: Holdout) -> list[FittedCandidate]:
    """The candidates that were added to the base model by themselves, best first, and the causes of the best
    hypothesis among them as taken."""
    base_holdout = holdout_misfit(state.base, holdout)
    out = []
    for hypothesis in state.with_one_cause:
        (cause,) = hypothesis.causes
        misfit_holdout = holdout_misfit(hypothesis, holdout)
        taken = (cause.kind, cause.at) in state.best.places
        reason = "" if taken else _reason(state, hypothesis, misfit_holdout, base_holdout)
        out.append(
            FittedCandidate(cause.kind, cause.at, hypothesis.misfit, misfit_holdout, hypothesis.chi_square, reason)
        )
    return out


def holdout_misfit(hypothesis: Hypothesis, holdout: Holdout) -> float:
    """Root mean square of all residuals on held-out data, in times the noise; infinite where it does not simulate."""
    try:
        residuals = holdout_residuals(holdout.simulate(hypothesis.fit))
    except FIT_ERRORS:
        return np.inf
    values = np.concatenate([part.ravel() for part in residuals]) if residuals else np.empty(0)
    values = values[~np.isnan(values)]
    with np.errstate(over="ignore"):
        return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def _reason(state: SearchState, hypothesis: Hypothesis, misfit_holdout: float, base_holdout: float) -> str:
    """Why a candidate was not taken, in the words of ``diagnosis.json``."""
    least = state.noise_threshold * chi_square_per_reading(hypothesis)
    if hypothesis.chi_square > state.base.chi_square - least or hypothesis.model.negligible(hypothesis.fit):
        return "not_better"
    impossible = hypothesis.model.not_taken(hypothesis.fit)
    if impossible:
        return impossible
    if misfit_holdout > base_holdout:
        return "worse_unseen"
    (cause,) = hypothesis.causes
    notes = estimates(hypothesis.fit)
    if any(notes[name].note.startswith("at the bound") for name in cause.names().values()):
        return "at_bound"
    return "rival"
