"""A linear system at a complex frequency, as expressions."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from modelling.equations.compiled import Model
from modelling.equations.complex_sx import Complex, Row, solve
from modelling.linear.reference_motion import reference_motion


class LinearResponse:
    """A linear system at a complex frequency: responses of its sensors to unit inputs.

    It is linear about the reference motion at the model's own values, which stays where ``p`` moves.
    """

    def __init__(self, model: Model, p: ca.SX, s: Complex):
        self.inputs, self.sensors = model.inputs, model.sensors
        n, extra = model.n, len(model.states) - 2 * model.n
        x, u = ca.SX.sym("x", 2 * n + extra), ca.SX.sym("u", len(model.inputs))
        about = reference_motion(model, model.p0)

        def at_reference(expressions: list[ca.SX]) -> list[ca.SX]:
            return ca.substitute(expressions, [x, u], [ca.DM(about.state), ca.DM(about.inputs)])

        force, mass = model.force(x, u, p), model.mass(p)
        rates, readings = model.rates(x, u, p), model.readings(x, u, p, 0)
        fx, fu, zx, zu, yx, yu = at_reference(
            [
                ca.jacobian(force, x), ca.jacobian(force, u),
                ca.jacobian(rates[2 * n :], x), ca.jacobian(rates[2 * n :], u),
                ca.jacobian(readings, x), ca.jacobian(readings, u),
            ]
        )  # fmt: skip
        rows: list[Row] = [{} for _ in range(n + extra)]
        for i in range(n):
            for j in range(n):
                _put(rows[i], j, [-fx[i, j], -fx[i, n + j], mass[i, j]], s)
            for j in range(extra):
                _put(rows[i], n + j, [-fx[i, 2 * n + j]], s)
        for i in range(extra):
            for j in range(n):
                _put(rows[n + i], j, [-zx[i, j], -zx[i, n + j]], s)
            for j in range(extra):
                _put(rows[n + i], n + j, [-zx[i, 2 * n + j], ca.SX(1.0 if i == j else 0.0)], s)
        self.solution = solve(rows, [Complex(row) for row in ca.vertsplit(ca.vertcat(fu, zu))])
        self._yx, self._yu, self._n, self._s = yx, yu, n, s
        self._known: dict[str, Complex] = {}

    def response(self, sensor: str, source: str) -> Complex:
        """Transfer function from an input to a sensor."""
        return self.responses(sensor)[self.inputs.index(source)]

    def responses(self, sensor: str) -> Complex:
        """Transfer functions from all inputs to a sensor, a row."""
        if sensor not in self._known:
            self._known[sensor] = self._responses(self.sensors.index(sensor))
        return self._known[sensor]

    def _responses(self, i: int) -> Complex:
        n, total = self._n, Complex(self._yu[i, :])
        row = self._yx[i, :]
        for k in range(n):
            if row.sparsity().has_nz(0, k) or row.sparsity().has_nz(0, n + k):
                total = total + (Complex(row[k]) + self._s * row[n + k]) * self.solution[k]
        for k in range(n, len(self.solution)):
            if row.sparsity().has_nz(0, n + k):
                total = total + self.solution[k] * row[n + k]
        return total


def _put(row: Row, column: int, coefficients: Sequence[ca.SX], s: Complex) -> None:
    """Add a polynomial in s, lowest power first, where any coefficient is there."""
    if not any(_present(c) for c in coefficients):
        return
    total = Complex(0.0)
    for c in reversed(coefficients):
        total = total * s + Complex(c)
    row[column] = total


def _present(value: ca.SX) -> bool:
    return value.nnz() > 0 and not value.is_zero()
