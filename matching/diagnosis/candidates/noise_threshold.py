"""How much the best of all candidates takes of χ² when there is nothing but noise: a parametric bootstrap of the
screening."""

from __future__ import annotations

import numpy as np

from matching.diagnosis.candidates.screening import Screen

DRAWS = 40
SELDOM = 1e-3  # probability with which the threshold is passed by noise


def offer(screen: Screen, seed: int = 0) -> None:
    """Put white noise beside the residual, freed of what the base parameters take: every guess is offered it too."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((len(screen.residual), DRAWS)).astype(np.float32)
    noise[~screen.mask.ravel()] = 0.0
    screen.draws = screen.free(noise).astype(np.float32)


def threshold(screen: Screen) -> float:
    """Decrease of χ² that pure noise reaches with the probability ``SELDOM``, once all guesses were offered it.

    The largest decreases of many draws follow Gumbel's law, whose tail gives the threshold.
    """
    screen.draws = None
    if not screen.taken:
        return 0.0
    most = np.max(screen.taken, axis=0)
    scale = float(most.std(ddof=1)) * np.sqrt(6) / np.pi
    middle = float(most.mean()) - 0.5772156649 * scale
    return middle - scale * float(np.log(-np.log1p(-SELDOM)))
