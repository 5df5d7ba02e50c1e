"""Which decrease of χ² the best of all candidates reaches in pure noise: a parametric bootstrap of the screening.

White noise stands beside the residual; every guess that is screened may take what it can of both. A candidate counts
where it takes more of the residual than the best candidate takes of noise in all but one of a thousand cases.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import chdtrc, chdtri

DRAWS = 40
PASSED_BY_NOISE = 1e-3  # probability with which noise alone passes the threshold
EULER_GAMMA = 0.5772156649


class NoiseDraws:
    """White noise and what the guesses took of it.

    Parameters
    ----------
    mask : ndarray (r,)
        Which residuals are readings.
    free : callable
        Signals (r, d) → without what base parameters and start states can take of them.
    """

    def __init__(self, mask: np.ndarray, free: Callable[[np.ndarray], np.ndarray], seed: int = 0):
        noise = np.random.default_rng(seed).standard_normal((len(mask), DRAWS)).astype(np.float32)
        noise[~mask] = 0.0
        self.noise = free(noise).astype(np.float32)
        self.decreases: list[np.ndarray] = []

    def offer(self, spans: list[np.ndarray], chosen_from: list[float]) -> None:
        """Let several guesses take what they can.

        Parameters
        ----------
        spans : list of ndarray (r, c)
            Orthonormal signatures of each guess.
        chosen_from : list of float
            How many independent guesses each stands for.
        """
        squares = (np.concatenate([span.T for span in spans], dtype=np.float32) @ self.noise) ** 2
        ends = np.cumsum([span.shape[1] for span in spans])
        for span, count, square in zip(spans, chosen_from, np.split(squares, ends[:-1]), strict=True):
            self.decreases.append(best_of(count, square.sum(axis=0), span.shape[1]))

    def threshold(self) -> float:
        """Decrease of χ² that noise reaches with the probability ``PASSED_BY_NOISE``.

        The largest decreases of many draws follow Gumbel's distribution, fitted by its moments.
        """
        if not self.decreases:
            return 0.0
        largest = np.max(self.decreases, axis=0)
        scale = float(largest.std(ddof=1)) * np.sqrt(6) / np.pi
        location = float(largest.mean()) - EULER_GAMMA * scale
        return location - scale * float(np.log(-np.log1p(-PASSED_BY_NOISE)))


def best_of(count: float, decrease: np.ndarray, c: int) -> np.ndarray:
    """What the best of ``count`` guesses takes of noise, given what one of them takes (d,).

    χ² with c degrees of freedom mapped, at equal probability, to the largest of that many.
    """
    if count <= 1:
        return decrease
    exceeded = np.clip(chdtrc(c, np.asarray(decrease, float)), 0.0, 1 - 1e-12)
    return chdtri(c, -np.expm1(np.log1p(-exceeded) / count))
