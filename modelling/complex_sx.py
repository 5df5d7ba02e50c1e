"""Complex numbers of CasADi expressions, and sparse linear equations in them."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class Complex:
    """A complex number whose parts are CasADi scalars or floats."""

    re: ca.SX | float
    im: ca.SX | float = 0.0

    def __add__(self, other: Complex | ca.SX | float) -> Complex:
        other = as_complex(other)
        return Complex(self.re + other.re, self.im + other.im)

    __radd__ = __add__

    def __neg__(self) -> Complex:
        return Complex(-self.re, -self.im)

    def __sub__(self, other: Complex | ca.SX | float) -> Complex:
        return self + (-as_complex(other))

    def __rsub__(self, other: Complex | ca.SX | float) -> Complex:
        return as_complex(other) - self

    def __mul__(self, other: Complex | ca.SX | float) -> Complex:
        if not isinstance(other, Complex):
            return Complex(self.re * other, self.im * other)
        return Complex(self.re * other.re - self.im * other.im, self.re * other.im + self.im * other.re)

    __rmul__ = __mul__

    def __truediv__(self, other: Complex | ca.SX | float) -> Complex:
        if not isinstance(other, Complex):
            return Complex(self.re / other, self.im / other)
        return self * other.conjugate() / other.square()

    def __rtruediv__(self, other: ca.SX | float) -> Complex:
        return as_complex(other) / self

    def conjugate(self) -> Complex:
        """The complex conjugate."""
        return Complex(self.re, -self.im)

    def square(self) -> ca.SX | float:
        """The squared magnitude."""
        return self.re * self.re + self.im * self.im


def as_complex(value: Complex | ca.SX | float) -> Complex:
    """The value as a complex number."""
    return value if isinstance(value, Complex) else Complex(value)


def exp(value: Complex) -> Complex:
    """Exponential."""
    size = ca.exp(value.re)
    return Complex(size * ca.cos(value.im), size * ca.sin(value.im))


Row = dict[int, Complex]


def solve(rows: list[Row], right: list[list[Complex]]) -> list[list[Complex]]:
    """Solve sparse linear equations by elimination without fill beyond what the graph asks for.

    Parameters
    ----------
    rows : list of dict
        Row i as {column: coefficient}; its diagonal entry must not vanish at the values it is used for, which holds
        for dynamic stiffnesses of damped chains at frequencies above zero.
    right : list of list
        Right-hand sides, (rows, columns).

    Returns
    -------
    list of list
        Solutions (rows, columns).
    """
    rows, right = [dict(row) for row in rows], [list(row) for row in right]
    left = set(range(len(rows)))
    order: list[int] = []
    while left:
        pivot = min(left, key=lambda i: (sum(j in left for j in rows[i]), i))
        left.remove(pivot)
        order.append(pivot)
        for i in left:
            if pivot not in rows[i]:
                continue
            factor = rows[i].pop(pivot) / rows[pivot][pivot]
            for j, value in rows[pivot].items():
                if j in left:
                    rows[i][j] = rows[i][j] - factor * value if j in rows[i] else -(factor * value)
            right[i] = [a - factor * b for a, b in zip(right[i], right[pivot], strict=True)]
    for pivot in reversed(order):
        done = [(j, value) for j, value in rows[pivot].items() if j != pivot and order.index(j) > order.index(pivot)]
        for column in range(len(right[pivot])):
            total = right[pivot][column]
            for j, value in done:
                total = total - value * right[j][column]
            right[pivot][column] = total / rows[pivot][pivot]
    return right
