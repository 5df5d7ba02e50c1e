"""The nonlinear programme of a match: decision vector, solver, bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from matching.frequency.case.case import Case, Move
from matching.frequency.case.targets import Goal
from matching.frequency.programme.closed_loop import ClosedLoopFunctions
from matching.frequency.programme.margin_grid import SURVEY_HZ, UNUSED_HZ
from matching.frequency.programme.scaling import unscaled

MARGIN_MISSED = 1e-5  # of a scaled margin: what is no longer taken for kept
LEAST_OSCILLATION = 0.05  # imaginary part over a target's |s|, at least, where a root may not become real


@dataclass(frozen=True)
class Problem:
    """The programme: decision vector v = [moves scaled to 0 … 1, (σ, ω, Re x, Im x) of every goal scaled].

    Solver and objective take beside it the frequencies (slots,) in Hz at which the margin is to hold beside the grid;
    :data:`.UNUSED_HZ` where there are fewer.

    Attributes
    ----------
    moves : tuple of Move
        Those that are released.
    solver : Function
        IPOPT.
    lower, upper, g_lower, g_upper : ndarray
    """

    case: Case
    loop: ClosedLoopFunctions
    moves: tuple[Move, ...]
    goals: tuple[Goal, ...]
    tight: bool
    solver: ca.Function
    objective: ca.Function
    survey: ca.Function
    lower: np.ndarray
    upper: np.ndarray
    g_lower: np.ndarray
    g_upper: np.ndarray

    @property
    def slots(self) -> int:
        """How many frequencies can be added to the grid."""
        return int(self.objective.numel_in(1))

    def extra(self, frequencies: Sequence[float] | np.ndarray = ()) -> np.ndarray:
        """Frequencies (slots,) as solver and objective take them, the last ones where there are too many."""
        kept = np.asarray(frequencies, float)[-self.slots :] if self.slots else np.zeros(0)
        return np.concatenate([kept, np.full(self.slots - len(kept), UNUSED_HZ)])

    def oscillating(self) -> Problem:
        """The same where no tracked root may become real.

        With a random start a root that may become real rarely leads to a good optimum; a start by continuation from
        another solution needs that freedom.
        """
        lower = self.lower.copy()
        eigenpairs(lower, len(self.moves), self.case)[:, 1] = LEAST_OSCILLATION
        return replace(self, lower=lower)

    def missed(self, v: np.ndarray) -> np.ndarray:
        """Frequencies (Hz, on a dense grid) of the margin's local minima that lie below the wanted margin."""
        least = self.survey(v).full().ravel()
        padded = np.concatenate([[np.inf], least, [np.inf]])
        return SURVEY_HZ[(least < -MARGIN_MISSED) & (least <= padded[:-2]) & (least <= padded[2:])]

    def violation(self, g: np.ndarray) -> float:
        """Largest violation of a scaled constraint by rows g (g,) of the objective; 0 where all are kept."""
        return float(np.maximum(self.g_lower - g, g - self.g_upper).max(initial=0.0))

    def values(self, v: np.ndarray) -> dict[str, float]:
        """Values in SI of the moved quantities and their mirror images."""
        values = {}
        for part, move in zip(v, self.moves, strict=False):
            for name in move.together:
                values[name] = float(unscaled(part, move))
        return values

    def vector(self, values: dict[str, float]) -> np.ndarray:
        """p (p,) of the loop with some values changed."""
        p = self.loop.values.copy()
        for name, value in values.items():
            p[self.loop.parameters.index(name)] = value
        return p


def eigenpairs(v: np.ndarray, size: int, case: Case) -> np.ndarray:
    """The goals' σ, ω, Re x and Im x, scaled (goals, 2 + 2·u), in a decision vector (v,) of ``size`` moves: a view."""
    return v[size:].reshape(-1, 2 + 2 * len(case.loop.dynamometers))
