"""Constraints of the programme with their derivatives: margins and tracked eigenpairs.

Each maps the functions of :mod:`matching.frequency.programme.evaluators` over its frequencies or goals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from matching.frequency.case.targets import Goal


@dataclass(frozen=True)
class CommonParts:
    """What constraints and objective share.

    Functions by name, the decision vector v (v, 1), how many of it move, and fixed numbers (c,).
    """

    functions: Mapping[str, ca.Function]
    v: ca.MX
    size: int
    fixed: np.ndarray

    def over(self, name: str, at: ca.MX, *more: ca.MX) -> list[ca.MX]:
        """Outputs of a function, each (a, f), at every column of ``at`` (n, f)."""
        f = at.shape[1]
        free, fixed = ca.repmat(self.v[: self.size], 1, f), ca.repmat(ca.MX(ca.DM(self.fixed)), 1, f)
        function = self.functions[name]
        outputs: Any = function.map(f)(at, free, fixed, *more)  # in CasADi's stubs a call gives one output
        return [outputs] if function.n_out() == 1 else list(outputs)

    def widened(self, part: ca.MX) -> ca.MX:
        """A Jacobian (r, m) of what moves with columns of zeros for the rest of v."""
        return ca.horzcat(part, ca.MX(part.shape[0], self.v.numel() - self.size))

    def embedded(self, part: ca.MX) -> ca.MX:
        """A Hessian (m, m) of what moves with zeros for the rest of v."""
        rest = self.v.numel() - self.size
        return ca.diagcat(part, ca.MX(rest, rest))


@dataclass(frozen=True)
class MarginConstraints:
    """The scaled stability margin at s and least distance (3, f)."""

    common: CommonParts
    at: ca.MX

    def value(self) -> ca.MX:
        """(f, 1)."""
        return self.common.over("margin", self.at)[0].T

    def jacobian(self) -> tuple[ca.MX, ca.MX]:
        """Value and Jacobian (f, v)."""
        value, each = self.common.over("margin_jacobian", self.at)
        return value.T, self.common.widened(each.T)

    def hessian(self, multipliers: ca.MX) -> ca.MX:
        """Hessian (v, v) of multipliersᵀ·value."""
        return summed(self.common, self.common.over("margin_hessian", self.at, multipliers.T)[0])


@dataclass(frozen=True)
class EigenpairConstraints:
    """Tracked eigenpairs of the loop, after what moves in v: rows that are zero, and squared distances from goals."""

    common: CommonParts
    goals: Sequence[Goal]

    def value(self) -> tuple[ca.MX, ca.MX]:
        """Rows ((2·u + 2)·goals, 1) and the sum of distances."""
        pairs = [self._evaluated(number, "pair")[0] for number in range(len(self.goals))]
        rows = ca.vertcat(ca.MX(0, 1), *(pair[:-1] for pair in pairs))
        return rows, sum((pair[-1] for pair in pairs), ca.MX(0.0))

    def jacobian(self) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
        """Rows, their Jacobian (r, v), the sum of distances, its gradient (v, 1)."""
        count = self.common.v.numel()
        rows, total, J, gradient = ca.MX(0, 1), ca.MX(0.0), ca.MX(0, count), ca.MX(count, 1)
        for number in range(len(self.goals)):
            value, flat = self._evaluated(number, "pair_jacobian")
            part = ca.reshape(flat, value.numel(), -1) @ self._selection(number)
            rows, J = ca.vertcat(rows, value[:-1]), ca.vertcat(J, part[:-1, :])
            total, gradient = total + value[-1], gradient + part[-1, :].T
        return rows, J, total, gradient

    def hessian(self, multipliers: ca.MX, factor: ca.MX) -> ca.MX:
        """Hessian (v, v) of multipliersᵀ·rows + factor·(sum of distances)."""
        count = self.common.v.numel()
        total = ca.MX(count, count)
        for number in range(len(self.goals)):
            rows = self._width(number)
            weight = ca.vertcat(multipliers[number * rows : (number + 1) * rows], factor)
            selection = self._selection(number)
            flat = self._evaluated(number, "pair_hessian", weight)[0]
            total += selection.T @ ca.reshape(flat, selection.shape[0], selection.shape[0]) @ selection
        return total

    def _width(self, number: int) -> int:
        return 2 + 2 * len(self.goals[number].pattern)

    def _entries(self, number: int) -> list[int]:
        width = self._width(number)
        first = self.common.size + number * width
        return [*range(self.common.size), *range(first, first + width)]

    def _selection(self, number: int) -> ca.DM:
        """Sparse selection from v of the released quantities and the goal's eigenpair."""
        entries = self._entries(number)
        return ca.DM(ca.Sparsity.triplet(len(entries), self.common.v.numel(), list(range(len(entries))), entries), 1)

    def _evaluated(self, number: int, name: str, *more: ca.MX) -> list[ca.MX]:
        part = self.common.v[self._entries(number)]
        function = self.common.functions[name]
        outputs: Any = function(ca.DM(self.goals[number].numbers), part, ca.DM(self.common.fixed), *more)
        return [outputs] if function.n_out() == 1 else list(outputs)


def summed(common: CommonParts, each: ca.MX) -> ca.MX:
    """Hessian by the released quantities, c of them, as the sum of its parts at every frequency (c·c, f)."""
    return common.embedded(ca.reshape(ca.sum2(each), common.size, common.size))
