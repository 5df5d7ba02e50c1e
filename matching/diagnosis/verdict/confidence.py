"""The confidence in a cause: its share of the evidence among its rivals, and of the misfit that it explains.

Evidence of a hypothesis is −½ of χ² + (variables)·ln(readings) on the fitted data (Schwarz 1978) and of the score of
its prediction of held-out data (:mod:`matching.diagnosis.fitting.prediction`). χ² is first divided by how much larger
than noise the best residual is and by the share of independent samples in it: a model that is not perfect must not
count its error as if it were noise, thousands of times over.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from matching.diagnosis.fitting.holdout import Holdout
from matching.diagnosis.fitting.prediction import Prediction, prediction
from matching.diagnosis.fitting.residual_statistics import effective_share
from matching.diagnosis.fitting.reweighting import discrepancy, reweighted
from matching.diagnosis.search.hypothesis import Hypothesis, at_noise
from matching.diagnosis.search.state import SearchState
from matching.diagnosis.verdict.final_fit import final_fit

MOST_RIVALS = 4  # that are fitted as finely as the best
OUT_OF_QUESTION = 60.0  # difference of χ², over its inflation: a share of the evidence below 1e-13
NOT_SIMULATED = 1e30  # χ² of what does not simulate
UNEXPLAINED_SHARE, EXPLAINED_SHARE = 0.49, 0.85  # confidence per share where a misfit remains; see ``confidence``
EXPLAINS_ALL, EXPLAINS_ALMOST = 1.0, 0.95  # shares of the misfit between which these are interpolated
NOISE_MEAN_SQUARE = 1.05  # of a residual that needs no test for correlation


@dataclass(frozen=True)
class RatedCause:
    """A cause, or a rival in its place, with its share of the evidence."""

    kind: str
    at: str
    share: float
    hypothesis: Hypothesis


def confidence(share: float, explained: bool, part_explained: float) -> float:
    """Confidence in a cause from its share of the evidence.

    Where the verdict is not ``explained``, what explains little of the misfit may stand for something that the
    vocabulary lacks: its share counts 0.49, rising to 0.85 for a cause that explains more than 95 % of the misfit.

    Parameters
    ----------
    part_explained : float
        Share of the misfit beyond noise that the cause explains.
    """
    if explained:
        return share
    rise = np.clip((part_explained - EXPLAINS_ALMOST) / (EXPLAINS_ALL - EXPLAINS_ALMOST), 0.0, 1.0)
    return share * float(UNEXPLAINED_SHARE + (EXPLAINED_SHARE - UNEXPLAINED_SHARE) * rise)


def rate_rivals(state: SearchState, index: int, holdout: Holdout) -> list[RatedCause]:
    """A cause of the best hypothesis and its rivals with their shares of the evidence, largest first.

    Rivals near a best fit at the noise are refitted as finely as it. A rival with more evidence replaces a cause.
    """
    best, cause = state.best, state.best.causes[index]
    others = [_weighted_as(best, rival) for rival in _rivals(state, index)]
    inflation = chi_square_inflation(best)
    scores = fitted_scores([best, *others], inflation)
    near = [rival for rival, s in zip(others, scores[1:], strict=True) if s - scores[0] < OUT_OF_QUESTION][:MOST_RIVALS]
    hypotheses = [best, *([final_fit(rival) for rival in near] if at_noise(best) else near)]
    names = [(cause.kind, cause.at)] + [
        (hypothesis.causes[-1].kind, hypothesis.causes[-1].at) for hypothesis in hypotheses[1:]
    ]
    shares = evidence_shares(_scores(hypotheses, holdout, inflation)) if near else np.ones(1)
    rated = [
        RatedCause(*name, float(p), hypothesis) for name, p, hypothesis in zip(names, shares, hypotheses, strict=True)
    ]
    rated += [
        RatedCause(rival.causes[-1].kind, rival.causes[-1].at, 0.0, rival) for rival in others if rival not in near
    ]
    rated.sort(key=lambda rating: -rating.share)
    leading = next(rating.hypothesis for rating in rated if rating.hypothesis is best or _meant(rating.hypothesis))
    if leading is not best:
        state.best = _in_place(leading, index)
    return rated


def _meant(rival: Hypothesis) -> bool:
    """Whether a rival may replace a cause: its values are possible and within the recorded range."""
    return not rival.model.not_taken(rival.fit)


def _rivals(state: SearchState, index: int) -> list[Hypothesis]:
    """Hypotheses with another cause in the place of one of the best's, beside the others of it."""
    best, cause = state.best, state.best.causes[index]
    beside = best.places - {(cause.kind, cause.at)}
    rivals = state.rivals[index] if index < len(state.rivals) else []
    return [
        rival
        for rival in rivals
        if rival.places != best.places and beside < rival.places and len(rival.causes) == len(best.causes)
    ]


def _scores(hypotheses: list[Hypothesis], holdout: Holdout, inflation: float) -> np.ndarray:
    """(h,) −2 ln of the evidence of several hypotheses, but for a constant."""
    predictions = [_predicted(hypothesis, holdout, inflation) for hypothesis in hypotheses]
    variance = min((residual_inflation(prediction.updated) for prediction in predictions if prediction), default=1.0)
    unseen = [prediction.score(variance) if prediction else NOT_SIMULATED for prediction in predictions]
    return fitted_scores(hypotheses, inflation) + np.array(unseen)


def fitted_scores(hypotheses: Sequence[Hypothesis], inflation: float) -> np.ndarray:
    """(h,) −2 ln of the evidence of fitted data, but for a constant, the first hypothesis being the best.

    Where sensors are weighted by what the model leaves of them, memory and scale are estimated: n·ln of the
    squared innovation of each, n the number of independent samples in what the best leaves.
    """
    best = hypotheses[0]
    if best.fit.problem.weighting is None:
        return np.array([hypothesis.cost / inflation for hypothesis in hypotheses])
    segments, residuals = best.fit.problem.data.segments, best.fit.by_sensor()
    count = np.array([
        sum(
            effective_share(r[s.measured[:, j], j]) * s.measured[:, j].sum()
            for s, r in zip(segments, residuals, strict=True) if s.measured[:, j].any()
        )
        for j in range(len(best.fit.problem.data.noise))
    ])  # fmt: skip
    logarithms = [np.log(discrepancy(hypothesis.fit).scale ** 2) for hypothesis in hypotheses]
    price = [len(hypothesis.fit.v) * np.log(max(count.sum(), 2.0)) for hypothesis in hypotheses]
    return np.array(
        [float(count @ part) + parameters_price for part, parameters_price in zip(logarithms, price, strict=True)]
    )


def _weighted_as(best: Hypothesis, other: Hypothesis) -> Hypothesis:
    """A hypothesis with its sensors weighted as those of the best."""
    weighting = best.fit.problem.weighting
    return other if weighting is None else replace(other, fit=reweighted(other.fit, weighting))


def evidence_shares(scores: np.ndarray) -> np.ndarray:
    """Shares (h,) of the evidence, which add to 1, from −2 ln of each (h,)."""
    evidence = np.exp(-0.5 * (scores - scores.min()))
    return evidence / evidence.sum()


def _in_place(hypothesis: Hypothesis, index: int) -> Hypothesis:
    """The same with its last cause at a place among the others."""
    *rest, last = hypothesis.causes
    causes = (*rest[:index], last, *rest[index:])
    return replace(hypothesis, model=replace(hypothesis.model, causes=causes))


def _predicted(hypothesis: Hypothesis, holdout: Holdout, factor: float) -> Prediction | None:
    """What a hypothesis predicts of held-out data; None where it does not simulate."""
    try:
        return prediction(hypothesis.fit, holdout.simulate(hypothesis.fit), factor)
    except (FloatingPointError, np.linalg.LinAlgError):
        return None


def chi_square_inflation(hypothesis: Hypothesis) -> float:
    """By how much the χ² of a hypothesis overstates what it knows, see :func:`residual_inflation`."""
    segments, residuals = hypothesis.fit.problem.data.segments, hypothesis.fit.by_sensor()
    return residual_inflation([np.where(s.measured, r, np.nan) for s, r in zip(segments, residuals, strict=True)])


def residual_inflation(parts: list[np.ndarray]) -> float:
    """Mean square of a residual, (t, y) in times the noise, over the share of independent samples in it; at least 1."""
    count = sum(int(np.isfinite(part).sum()) for part in parts)
    mean_square = float(sum(np.nansum(part**2) for part in parts)) / count if count else NOT_SIMULATED
    if mean_square < NOISE_MEAN_SQUARE:
        return max(mean_square, 1.0)
    shares = [effective_share(part[:, j]) for part in parts for j in range(part.shape[1]) if np.nansum(part[:, j] ** 2)]
    return mean_square / min(shares, default=1.0)
