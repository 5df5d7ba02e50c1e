"""The state of a search: the best hypothesis so far and what else was fitted."""

from __future__ import annotations

from dataclasses import dataclass, field

from matching.diagnosis.candidates.screening import ScreenedCandidate, Screening
from matching.diagnosis.search.hypothesis import Hypothesis


@dataclass
class SearchState:
    """What a search has found.

    Attributes
    ----------
    base : Hypothesis
        Without causes.
    best : Hypothesis
    screening : Screening
        Of the base fit.
    screened : list of ScreenedCandidate
        What it found, the best guess of each candidate; empty where it was made anew after the search.
    noise_threshold : float
        Decrease of χ² that the best of all candidates seldom reaches in pure noise.
    rivals : list of list of Hypothesis
        For each cause of ``best``: hypotheses with another cause in its place, itself included, best first.
    with_one_cause : list of Hypothesis
        All that were fitted, taken or not, best first.
    """

    base: Hypothesis
    best: Hypothesis
    screening: Screening
    screened: list[ScreenedCandidate]
    noise_threshold: float
    rivals: list[list[Hypothesis]] = field(default_factory=list)
    with_one_cause: list[Hypothesis] = field(default_factory=list)


def chi_square_per_reading(hypothesis: Hypothesis) -> float:
    """Mean square of the residual, at least 1: no gain counts that is small beside what remains."""
    return max(1.0, hypothesis.chi_square / max(hypothesis.fit.problem.data.readings_count, 1))


def distinct(hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    """Without those that name the same causes in another order or with fewer or more parameters; the first is kept."""
    out: dict[frozenset, Hypothesis] = {}
    for hypothesis in hypotheses:
        out.setdefault(frozenset(hypothesis.places), hypothesis)
    return list(out.values())
