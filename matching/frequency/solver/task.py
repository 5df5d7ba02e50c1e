"""The programme of a match as a task for the search, and what the search gives back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from matching.frequency.case.case import Case, Move
from matching.frequency.case.demands import Demands
from matching.frequency.case.targets import Goal
from matching.frequency.programme.build import build
from matching.frequency.programme.objective import Objective
from matching.frequency.programme.problem import Problem

AGREEMENT = 5e-3  # relative: starts that end so close count as one optimum


@dataclass(frozen=True)
class Solution:
    """Tuned values by name (SI), the objective there and that of every start (None: infeasible or unstable).

    ``holds`` is whether the modulus margin is kept between the frequencies of the grid, too, and ``added`` are those
    (Hz) at which it was asked for beside the grid. ``pairs`` are the goals' eigenpairs as the decision vector has them.
    ``blind`` is how many settings were drawn over the bounds where no start led to a stable loop, and how many of them
    are stable. ``as_good_to`` is the largest objective that counts as good as the best one.
    """

    values: dict[str, float]
    objective: float
    starts: tuple[float | None, ...]
    feasible: bool
    holds: bool = True
    added: tuple[float, ...] = ()
    pairs: tuple[float, ...] = ()
    blind: tuple[int, int] | None = None
    as_good_to: float = float("nan")


@dataclass(frozen=True)
class Near:
    """Solutions of like cases to start from, in place of starts of its own.

    Each is its tuned values by name (SI) and its eigenpairs as :class:`Solution` has them. ``below`` is the objective
    that has to be beaten, None where there is none yet.
    """

    solutions: tuple[tuple[Mapping[str, float], Sequence[float]], ...]
    below: float | None = None

    def beaten_by(self, objective: float) -> bool:
        """Whether an objective is lower by more than ends of one optimum differ."""
        return self.below is None or objective < self.below - AGREEMENT * abs(self.below)


class NoBetter(Exception):
    """Nothing below the objective that had to be beaten."""


@dataclass(frozen=True)
class TuningTask:
    """The programme to solve, as :func:`matching.frequency.programme.build.build` takes it; ``weights`` (moves,).

    With ``error_limit`` the change is minimised subject to it, else the error.
    """

    case: Case
    moves: tuple[Move, ...]
    weights: np.ndarray
    goals: tuple[Goal, ...]
    objective: Objective
    demands: Demands
    error_limit: float | None = None

    def build(self, tight: bool = False, exact: bool = False, slots: int = 0, compiled: bool = True) -> Problem:
        """The programme."""
        return build(
            self.case, self.moves, self.weights, self.goals, self.objective, self.demands,
            tight=tight, exact=exact, slots=slots, compiled=compiled,
            error_limit=self.error_limit,
        )  # fmt: skip
