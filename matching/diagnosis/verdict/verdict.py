"""How sure a named cause is, and what is said in the end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from matching.diagnosis.candidates.candidates import fitted
from matching.diagnosis.fitting.friction_regularisation import sharpened
from matching.diagnosis.fitting.holdout import Ahead, residuals
from matching.diagnosis.fitting.prediction import Prediction, prediction
from matching.diagnosis.fitting.statistics import effective_share
from matching.diagnosis.fitting.stick_speed import FINAL, resolved
from matching.diagnosis.search.compare import Named, at_noise, sharpest
from matching.diagnosis.search.greedy_search import Search

TEMPER = 1.0  # divides differences of the logarithm of evidence; learned from campaigns, see the documentation
CLEAR = 60.0  # difference of χ², over the spread, beyond which a rival is out of the race
HOPELESS = 1e30  # χ² of what does not simulate
UNEXPLAINED_AT_MOST = 0.49  # confidence of a cause when most of the misfit stays


@dataclass(frozen=True)
class Rated:
    """A cause, or one in its place, with its share of the evidence."""

    kind: str
    at: str
    share: float
    named: Named


def polished(named: Named) -> Named:
    """A fit again with finer steps, ending on its own Jacobian, if that is no worse."""
    if not named.causes:
        return replace(named, fit=sharpened(named.fit))
    trial = replace(
        named.trial,
        bounds=named.fit.problem.bounds,
        values=named.trial.values | named.fit.values,
        starts=tuple(named.fit.starts),
    )
    try:
        fine = sharpened(resolved(fitted(trial, named.fit, 12, True, 6.0), FINAL))
    except (FloatingPointError, np.linalg.LinAlgError):
        return named
    fine = sharpest(replace(named, fit=fine)).fit
    return replace(named, fit=fine) if fine.cost < 1.01 * named.fit.cost + 10 else named


def rated(state: Search, index: int, ahead: Callable[[Named], list[Ahead]]) -> list[Rated]:
    """A cause of the best fit and its rivals with their shares of the evidence, most first.

    Evidence is that of the fit (Schwarz) and of the held-out data as it foretells them, χ² divided by what the best
    residual is larger than noise and by how few of its samples are independent. Rivals that come near a best fit at the
    noise are refitted as finely as it. A single cause gives way to a rival with more evidence.
    """
    here = state.best.causes[index]
    same = {(one.kind, one.at) for one in state.best.causes}
    beside = same - {(here.kind, here.at)}
    others = []
    for one in state.rivals[index] if index < len(state.rivals) else []:
        own = {(c.kind, c.at) for c in one.causes}
        if own != same and beside < own and len(one.causes) == len(state.best.causes):
            others.append(one)
    factor = spread(state.best) * TEMPER
    near = [one for one in others if one.cost - state.best.cost < CLEAR * factor][:4]
    finer = [polished(one) for one in near] if at_noise(state.best) else near
    names = [(here.kind, here.at)] + [(one.causes[-1].kind, one.causes[-1].at) for one in finer]
    fits = [state.best, *finer]
    scores = np.zeros(1)
    if finer:
        told = [_foretold(one, ahead, factor) for one in fits]
        coarse = TEMPER * min((_spread(own.moved) for own in told if own), default=1.0)
        unseen = [own.score(coarse) if own else HOPELESS for own in told]
        scores = np.array([one.cost / factor + own for one, own in zip(fits, unseen, strict=True)])
    shares = np.exp(-0.5 * (scores - scores.min()))
    shares /= shares.sum()
    out = [Rated(*name, float(share), one) for name, share, one in zip(names, shares, fits, strict=True)]
    out += [Rated(one.causes[-1].kind, one.causes[-1].at, 0.0, one) for one in others if one not in near]
    out.sort(key=lambda one: -one.share)
    if out[0].named is not state.best:
        state.best = _in_place(out[0].named, index)
    return out


def _in_place(named: Named, index: int) -> Named:
    """The same fit with its last cause told at a place among the others."""
    *rest, last = named.causes
    return replace(named, trial=replace(named.trial, causes=(*rest[:index], last, *rest[index:])))


def held_out(named: Named, ahead: Callable[[Named], list[Ahead]]) -> float:
    """χ² of a fit on unseen data; huge where it does not simulate."""
    try:
        return _square(residuals(ahead(named)))
    except (FloatingPointError, np.linalg.LinAlgError):
        return HOPELESS


def _foretold(named: Named, ahead: Callable[[Named], list[Ahead]], factor: float) -> Prediction | None:
    """What a fit foretells of unseen data; None where it does not simulate."""
    try:
        return prediction(named.fit, ahead(named), factor)
    except (FloatingPointError, np.linalg.LinAlgError):
        return None


def _square(parts: list[np.ndarray]) -> float:
    return float(sum(np.nansum(own**2) for own in parts)) if parts else HOPELESS


def spread(named: Named) -> float:
    """Mean square of a residual over the share of independent samples in it, at least 1."""
    segments = named.fit.problem.data.segments
    return _spread([np.where(s.counts, own, np.nan) for s, own in zip(segments, named.fit.by_sensor(), strict=True)])


def _spread(parts: list[np.ndarray]) -> float:
    count = sum(int(np.isfinite(own).sum()) for own in parts)
    square = _square(parts) / max(count, 1)
    if square < 1.05:
        return max(square, 1.0)
    shares = [effective_share(own[:, j]) for own in parts for j in range(own.shape[1]) if np.nansum(own[:, j] ** 2)]
    return square / min(shares, default=1.0)


def confidence(share: float, explained: bool, taken: float) -> float:
    """Confidence in a cause from its share of the evidence and, if not all is explained, of the misfit it takes.

    What takes little of a misfit that stays may stand for something that the vocabulary lacks.
    """
    if explained:
        return share
    return share * (
        UNEXPLAINED_AT_MOST + (0.85 - UNEXPLAINED_AT_MOST) * float(np.clip((taken - 0.95) / 0.05, 0.0, 1.0))
    )
