"""Settings drawn evenly over the bounds, where no start led anywhere: which of them are stable, as starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from matching.frequency.case.tuned import apply
from matching.frequency.loop.parts import parts_of
from matching.frequency.loop.poles import ORDERS, closed_matrix, neutral_motions, resting_and_right
from matching.frequency.programme.problem import Problem
from matching.frequency.solver.ends import check
from matching.frequency.solver.starts import start

DRAWS = 512  # where one in a hundred is stable, some of so many are with 99.4 %
ENOUGH = 8  # stable ones, after which no more are drawn


@dataclass(frozen=True)
class BlindDraws:
    """How many settings were drawn, and the stable ones among them as starts (v,), largest modulus margin first."""

    drawn: int
    stable: tuple[np.ndarray, ...]


def blind_draws(problem: Problem, seed: int, draws: int = DRAWS) -> BlindDraws:
    """Draw settings by a Sobol sequence until enough are stable: by poles, then by encirclements on the exact loop."""
    size, stable_starts = len(problem.moves), list[tuple[float, np.ndarray]]()
    eigenpairs = start(problem, None)[size:]
    points = scipy.stats.qmc.Sobol(size, seed=np.random.default_rng([seed, draws])).random_base2(
        (draws - 1).bit_length()
    )
    drawn = 0
    for point in points[:draws]:
        drawn += 1
        v = np.concatenate([point, eigenpairs])
        parts = parts_of(apply(problem.case, problem.values(v)))
        poles = np.linalg.eigvals(closed_matrix(parts, ORDERS[-1]))
        if resting_and_right(poles, neutral_motions(parts))[1]:
            continue
        margin, _, stable = check(problem, v)
        stable_starts += [(margin, v)] if stable else []
        if len(stable_starts) == ENOUGH:
            break
    stable_starts.sort(key=lambda pair: -pair[0])
    return BlindDraws(drawn, tuple(v for _, v in stable_starts))
