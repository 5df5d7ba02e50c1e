"""Two causes at once: pairs of candidates that take more of the residual together than the best takes alone.

A search that adds one cause after another goes wrong where two hide each other: what one adds to the readings the other
takes away, so that neither gains much alone. To first order the gain of a pair follows from the signatures that the
screening has anyway; only the few most promising pairs are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from matching.diagnosis.candidates.cause import compilable
from matching.diagnosis.candidates.refit import fit_extended
from matching.diagnosis.candidates.screening import ScreenedCandidate, Screening
from matching.diagnosis.fitting.fit import FitOptions
from matching.diagnosis.search.hypothesis import Hypothesis
from matching.diagnosis.search.refinement import FIT_ERRORS, RefitBudget

PAIRED = 10  # best candidates of which pairs are looked at
MOST_PAIRS = 2  # that are fitted
PAIR_GAIN = 1.2  # reduction of χ² by a pair over that of the best candidate alone, from which it is looked at
DEPENDENT = 1e-6  # of a signature's length: what is left by others that take its place


@dataclass(frozen=True)
class ScreenedPair:
    """Two candidates with their guesses at the amplitudes they have together, and how much of χ² they would take."""

    first: ScreenedCandidate
    second: ScreenedCandidate
    reduction: float


def screened_pairs(screening: Screening, candidates: Sequence[ScreenedCandidate]) -> list[ScreenedPair]:
    """Pairs of the best candidates that promise clearly more than the best alone, the most promising first.

    Parameters
    ----------
    candidates : sequence of ScreenedCandidate
        Of ``screening``, best first.
    """
    best = [candidate for candidate in candidates if candidate.guess is not None][:PAIRED]
    rows = [_signatures(screening, candidate) for candidate in best]
    pairs = []
    for i, j in combinations(range(len(best)), 2):
        if best[i].at == best[j].at and best[i].kind == best[j].kind:
            continue
        pair = _pair(screening, best[i], best[j], (rows[i], rows[j]))
        if pair is not None and pair.reduction > PAIR_GAIN * best[0].reduction:
            pairs.append(pair)
    return sorted(pairs, key=lambda pair: -pair.reduction)


def _signatures(screening: Screening, candidate: ScreenedCandidate) -> np.ndarray:
    """(a, r) of a candidate's guess, without what base parameters and start states can take."""
    assert candidate.guess is not None
    rows = np.array([screening.signature(dict(addition)) for addition in candidate.guess.additions])
    return rows - (rows @ screening.basis) @ screening.basis.T


def _pair(
    screening: Screening, first: ScreenedCandidate, second: ScreenedCandidate, rows: tuple[np.ndarray, np.ndarray]
) -> ScreenedPair | None:
    """Two candidates together; None where they depend on each other or no such effects exist."""
    assert first.guess is not None
    assert second.guess is not None
    both = np.concatenate(rows)
    lengths = np.linalg.norm(both, axis=1)
    if not (np.isfinite(lengths).all() and (lengths > 0).all()):
        return None
    span, triangle = np.linalg.qr((both / lengths[:, None]).T)
    if np.abs(np.diag(triangle)).min() < DEPENDENT:
        return None
    along = span.T @ screening.residual
    amplitudes = np.linalg.solve(triangle, along) / lengths
    parameters = first.guess.parameters(amplitudes[: len(rows[0])])
    others = second.guess.parameters(amplitudes[len(rows[0]) :])
    if parameters is None or others is None:
        return None
    return ScreenedPair(replace(first, parameters=parameters), replace(second, parameters=others), float(along @ along))


def fitted_pairs(
    base: Hypothesis, pairs: Sequence[ScreenedPair], known: Sequence[Hypothesis], budget: RefitBudget
) -> list[Hypothesis]:
    """The most promising pairs, fitted, up to the first that a known hypothesis has: others promise less than that."""
    step = base.fit.problem.data.sampling_interval
    start = replace(base.model, bounds=base.fit.problem.bounds, values=base.fit.values, starts=())
    places = [hypothesis.places for hypothesis in known]
    out: list[Hypothesis] = []
    for pair in pairs:
        model = start
        for candidate in (pair.first, pair.second):
            model = model.with_cause(candidate.kind, candidate.at, candidate.parameters, step)
        if {(cause.kind, cause.at) for cause in model.causes} in places:
            break
        if len(out) == MOST_PAIRS or not compilable([model]) or not budget.take():
            break
        try:
            fit = fit_extended(model, base.fit, FitOptions(exact=False))
        except FIT_ERRORS:
            continue
        out.append(Hypothesis(model, fit, pair.reduction))
    return out
