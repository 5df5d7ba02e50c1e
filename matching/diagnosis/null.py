"""How much the best of all candidates takes of χ² when there is nothing but noise: a parametric bootstrap of the
screening."""

from __future__ import annotations

import numpy as np

from matching.diagnosis.screening import Screen

DRAWS = 40
SELDOM = 1e-3  # probability with which the threshold is passed by noise


def threshold(screen: Screen, seed: int = 0) -> float:
    """Decrease of χ² that pure noise reaches with the probability ``SELDOM``.

    White noise is put in the place of the residual, freed of what the base parameters take, and offered to every
    guess of the screening; the largest decreases of many draws follow Gumbel's law, whose tail gives the threshold.
    """
    spans = screen.spans
    if not spans:
        return 0.0
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((len(screen.residual), DRAWS)).astype(np.float32)
    noise[~screen.mask.ravel()] = 0.0
    noise = screen.free(noise).astype(np.float32)
    most = np.max([np.sum((span.T @ noise) ** 2, axis=0) for span in spans], axis=0)
    scale = float(most.std(ddof=1)) * np.sqrt(6) / np.pi
    middle = float(most.mean()) - 0.5772156649 * scale
    return middle - scale * float(np.log(-np.log1p(-SELDOM)))
