"""How sure a named cause is, and what is said in the end."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from matching.diagnosis.compare import Named
from matching.diagnosis.statistics import effective_share

TEMPER = 1.0  # divides differences of the logarithm of evidence; learned from campaigns, see the documentation
UNEXPLAINED_AT_MOST = 0.49  # confidence of a cause when most of the misfit stays


def weights(rivals: Sequence[Named], held_out: Callable[[Named], float]) -> list[tuple[str, str, float]]:
    """Kinds and places with their share of the evidence, most first.

    Evidence is that of the fit (Schwarz) and of the held-out data together, χ² divided by what the best rival's residual
    is larger than noise, and by how few of its samples are independent.
    """
    scores = np.array([one.cost + held_out(one) for one in rivals])
    best = rivals[int(np.argmin(scores))]
    factor = spread(best)
    total: dict[tuple[str, str], float] = {}
    for one, score in zip(rivals, scores, strict=True):
        cause = one.causes[-1]
        share = float(np.exp(-0.5 * (score - scores.min()) / factor / TEMPER))
        total[cause.kind, cause.at] = max(total.get((cause.kind, cause.at), 0.0), share)
    whole = sum(total.values())
    return sorted(((kind, at, share / whole) for (kind, at), share in total.items()), key=lambda one: -one[2])


def spread(named: Named) -> float:
    """Mean square of a residual over the share of independent samples in it, at least 1."""
    fit = named.fit
    square = fit.cost / max(float(fit.problem.data.samples.sum()), 1.0)
    if square < 1.05:
        return max(square, 1.0)
    shares = [effective_share(own[:, j]) for own in fit.by_sensor() for j in range(own.shape[1]) if own[:, j].any()]
    return square / min(shares, default=1.0)


def confidence(share: float, explained: bool, taken: float) -> float:
    """Confidence in a cause from its share of the evidence and, where not all is explained, of the misfit it takes away.

    What takes little of a misfit that stays may stand for something that the vocabulary lacks.
    """
    if explained:
        return share
    return share * (UNEXPLAINED_AT_MOST + (0.85 - UNEXPLAINED_AT_MOST) * float(np.clip((taken - 0.95) / 0.05, 0.0, 1.0)))
