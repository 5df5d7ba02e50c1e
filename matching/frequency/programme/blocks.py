"""The blocks of the programme with their derivatives: margins, response error, eigenpairs, put together in MX.

Each maps the functions of :mod:`matching.frequency.programme.evaluators` over its frequencies or goals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from matching.frequency.case.targets import Goal
from matching.frequency.programme.objective import Aim


@dataclass(frozen=True)
class Common:
    """What the blocks share: functions by name, decision vector v (v, 1), how many of it move, fixed numbers (c,)."""

    functions: Mapping[str, ca.Function]
    v: ca.MX
    size: int
    fixed: np.ndarray

    def over(self, name: str, at: ca.MX, *more: ca.MX) -> list[ca.MX]:
        """Outputs of a function, each (a, f), at every column of ``at`` (n, f)."""
        f = at.shape[1]
        free, fixed = ca.repmat(self.v[: self.size], 1, f), ca.repmat(ca.MX(ca.DM(self.fixed)), 1, f)
        function = self.functions[name]
        found: Any = function.map(f)(at, free, fixed, *more)  # in CasADi's stubs a call gives one output
        return [found] if function.n_out() == 1 else list(found)

    def wide(self, part: ca.MX) -> ca.MX:
        """A Jacobian (r, m) of what moves with columns of zeros for the rest of v."""
        return ca.horzcat(part, ca.MX(part.shape[0], self.v.numel() - self.size))

    def square(self, part: ca.MX) -> ca.MX:
        """A Hessian (m, m) of what moves with zeros for the rest of v."""
        rest = self.v.numel() - self.size
        return ca.diagcat(part, ca.MX(rest, rest))


@dataclass(frozen=True)
class Margins:
    """The scaled stability margin at s and least distance (3, f)."""

    common: Common
    at: ca.MX

    def value(self) -> ca.MX:
        """(f, 1)."""
        return self.common.over("margin", self.at)[0].T

    def slope(self) -> tuple[ca.MX, ca.MX]:
        """Value and Jacobian (f, v)."""
        value, each = self.common.over("margin_slope", self.at)
        return value.T, self.common.wide(each.T)

    def bend(self, multipliers: ca.MX) -> ca.MX:
        """Hessian (v, v) of multipliersᵀ·value."""
        return _summed(self.common, self.common.over("margin_bend", self.at, multipliers.T)[0])


@dataclass(frozen=True)
class ResponseError:
    """Mean square of |log(H/reference)| over frequencies (f,) in Hz and functions, phase unwrapped."""

    common: Common
    frequencies: np.ndarray
    reference: np.ndarray

    def value(self) -> ca.MX:
        """Scalar."""
        return ca.sumsqr(self._residual()) / self.reference.size

    def slope(self) -> tuple[ca.MX, ca.MX]:
        """Value and gradient (v, 1)."""
        residual = self._residual()
        pulled = ca.sum2(self.common.over("pull", self._at(), residual)[0])
        rest = ca.MX(self.common.v.numel() - self.common.size, 1)
        return ca.sumsqr(residual) / self.reference.size, ca.vertcat(2 / self.reference.size * pulled, rest)

    def bend(self) -> ca.MX:
        """Hessian (v, v)."""
        residual, (_, each) = self._residual(), self.common.over("log_slope", self._at())
        a = residual.shape[0]
        J = self.common.wide(ca.vertcat(*(each[i::a, :].T for i in range(a))))
        second = _summed(self.common, self.common.over("log_bend", self._at(), residual)[0])
        return 2 / self.reference.size * (J.T @ J + second)

    def _at(self) -> ca.MX:
        omega = 2 * np.pi * self.frequencies[None]
        return ca.MX(ca.DM(np.vstack([0 * omega, omega, self.reference.T.real, self.reference.T.imag])))

    def _residual(self) -> ca.MX:
        """Logarithm of magnitude and unwrapped phase (2·h, f)."""
        ratio, h = self.common.over("ratio", self._at())[0], self.reference.shape[1]
        x, y = ratio[:h, :], ratio[h:, :]
        turns = ca.atan2(y[:, 1:] * x[:, :-1] - x[:, 1:] * y[:, :-1], x[:, 1:] * x[:, :-1] + y[:, 1:] * y[:, :-1])
        phase = ca.cumsum(ca.horzcat(ca.atan2(y[:, 0], x[:, 0]), turns), 1)
        return ca.vertcat(ca.log(x**2 + y**2 + 1e-12) / 2, phase)


@dataclass(frozen=True)
class Fidelity:
    """1 − R² over the manoeuvre in place of the response error."""

    common: Common
    aim: Aim

    def value(self) -> ca.MX:
        """Scalar."""
        return self._loss(self.common.over("response", self._at())[0])

    def slope(self) -> tuple[ca.MX, ca.MX]:
        """Value and gradient (v, 1)."""
        H = self.common.over("response", self._at())[0]
        own = ca.MX.sym("H", *H.shape)
        loss = self._loss(own)
        found: Any = ca.Function("loss", [own], [loss, ca.gradient(loss, own)])(H)
        pulled = ca.sum2(self.common.over("response_pull", self._at(), found[1])[0])
        return found[0], ca.vertcat(pulled, ca.MX(self.common.v.numel() - self.common.size, 1))

    def bend(self) -> ca.MX:
        """Hessian (v, v), CasADi's own."""
        return ca.hessian(self._loss(self.common.over("plain", self._at())[0]), self.common.v)[0]

    def _at(self) -> ca.MX:
        return ca.MX(ca.DM(np.vstack([self.aim.s.real, self.aim.s.imag])))

    def _loss(self, H: ca.MX) -> Any:
        h = H.shape[0] // 2
        return self.aim.loss(H[:h, :], H[h:, :])


@dataclass(frozen=True)
class Pairs:
    """Tracked eigenpairs of the loop, after what moves in v: rows that are zero, and squared distances from goals."""

    common: Common
    goals: Sequence[Goal]

    def value(self) -> tuple[ca.MX, ca.MX]:
        """Rows ((2·u + 2)·goals, 1) and the sum of distances."""
        found = [self._at(number, "pair") for number in range(len(self.goals))]
        rows = ca.vertcat(ca.MX(0, 1), *(one[:-1] for (one,) in found))
        return rows, sum((one[-1] for (one,) in found), ca.MX(0.0))

    def slope(self) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
        """Rows, their Jacobian (r, v), the sum of distances, its gradient (v, 1)."""
        count = self.common.v.numel()
        rows, total, J, gradient = ca.MX(0, 1), ca.MX(0.0), ca.MX(0, count), ca.MX(count, 1)
        for number in range(len(self.goals)):
            value, flat = self._at(number, "pair_slope")
            own = ca.reshape(flat, value.numel(), -1) @ self._selection(number)
            rows, J = ca.vertcat(rows, value[:-1]), ca.vertcat(J, own[:-1, :])
            total, gradient = total + value[-1], gradient + own[-1, :].T
        return rows, J, total, gradient

    def bend(self, multipliers: ca.MX, factor: ca.MX) -> ca.MX:
        """Hessian (v, v) of multipliersᵀ·rows + factor·(sum of distances)."""
        count = self.common.v.numel()
        total = ca.MX(count, count)
        for number in range(len(self.goals)):
            rows = self._width(number)
            weight = ca.vertcat(multipliers[number * rows : (number + 1) * rows], factor)
            selection = self._selection(number)
            flat = self._at(number, "pair_bend", weight)[0]
            total += selection.T @ ca.reshape(flat, selection.shape[0], selection.shape[0]) @ selection
        return total

    def _width(self, number: int) -> int:
        return 2 + 2 * len(self.goals[number].pattern)

    def _entries(self, number: int) -> list[int]:
        width = self._width(number)
        first = self.common.size + number * width
        return [*range(self.common.size), *range(first, first + width)]

    def _selection(self, number: int) -> ca.DM:
        """What moves and the goal's own pair out of v, sparse."""
        entries = self._entries(number)
        return ca.DM(ca.Sparsity.triplet(len(entries), self.common.v.numel(), list(range(len(entries))), entries), 1)

    def _at(self, number: int, name: str, *more: ca.MX) -> list[ca.MX]:
        own = self.common.v[self._entries(number)]
        function = self.common.functions[name]
        found: Any = function(ca.DM(self.goals[number].numbers), own, ca.DM(self.common.fixed), *more)
        return [found] if function.n_out() == 1 else list(found)


def _summed(common: Common, each: ca.MX) -> ca.MX:
    """Hessian of what moves from its parts at every frequency (m·m, f)."""
    return common.square(ca.reshape(ca.sum2(each), common.size, common.size))
