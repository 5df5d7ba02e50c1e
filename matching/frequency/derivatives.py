"""Values over many frequencies with first and second derivatives, from the expression of one frequency.

CasADi's own Jacobian of a mapped function sweeps the whole map once a direction. Here the expression of a single
frequency is differentiated, simplified and then mapped: the same numbers in a tenth of the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np


@dataclass(frozen=True)
class Mapped:
    """Values over frequencies of the moved quantities.

    Attributes
    ----------
    expressions : SX (a, 1)
        At one frequency, of ``free`` and ``at``.
    free : SX (m, 1)
        The moved quantities.
    at : sequence of SX (n, 1)
        What else differs from frequency to frequency.
    point : MX (m, 1)
        The programme's own expression for ``free``.
    given : sequence of ndarray (n, f)
        ``at`` at every frequency.
    """

    expressions: ca.SX
    free: ca.SX
    at: Sequence[ca.SX]
    point: ca.MX
    given: Sequence[np.ndarray]

    def values(self, shown: ca.SX | None = None) -> ca.MX:
        """The expressions, or others of the same symbols, at every frequency, (a, f)."""
        return self._map("values", self.expressions if shown is None else shown)

    def column(self) -> ca.MX:
        """The values one after the other, each over all frequencies, (a·f, 1)."""
        return ca.vec(self.values().T)

    def jacobian(self) -> ca.MX:
        """Derivative of :meth:`column`, (a·f, m)."""
        a, m = self.expressions.numel(), self.free.numel()
        if a < m:
            slopes = ca.vertcat(*(ca.gradient(self.expressions[i], self.free).T for i in range(a)))
        else:
            slopes = ca.jtimes(self.expressions, self.free, ca.SX.eye(m))
        each = self._map("jacobian", ca.vec(slopes))
        return ca.vertcat(*(each[i::a, :].T for i in range(a)))

    def gradient(self, multipliers: ca.MX) -> ca.MX:
        """Derivative (m, 1) of multipliersᵀ·column, multipliers (a·f, 1)."""
        weight, total = self._weighted()
        return ca.sum2(self._map("gradient", ca.gradient(total, self.free), weight, multipliers))

    def hessian(self, multipliers: ca.MX) -> ca.MX:
        """Second derivative (m, m) of multipliersᵀ·column, multipliers (a·f, 1)."""
        weight, total = self._weighted()
        each = self._map("hessian", ca.vec(ca.hessian(total, self.free)[0]), weight, multipliers)
        return ca.reshape(ca.sum2(each), self.free.numel(), self.free.numel())

    def _weighted(self) -> tuple[ca.SX, ca.SX]:
        weight = ca.SX.sym("weight", self.expressions.numel())
        return weight, ca.dot(weight, self.expressions)

    def _map(
        self, name: str, expression: ca.SX, weight: ca.SX | None = None, multipliers: ca.MX | None = None
    ) -> ca.MX:
        """An expression at every frequency, one column each."""
        symbols, f = [*self.at, self.free], self.given[0].shape[1]
        arguments: list[ca.MX] = [*(ca.MX(ca.DM(one)) for one in self.given), ca.repmat(self.point, 1, f)]
        if weight is not None and multipliers is not None:
            symbols.append(weight)
            arguments.append(ca.reshape(multipliers, f, weight.numel()).T)
        each: ca.MX = ca.Function(name, symbols, ca.cse([ca.densify(expression)])).map(f)(*arguments)
        return each
