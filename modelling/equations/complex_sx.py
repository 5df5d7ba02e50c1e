"""Complex numbers of CasADi expressions, and sparse linear equations in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

Part = ca.SX | float  # 0.0 where it is known to be zero: most parts of a dynamic stiffness, and calls into CasADi cost


@dataclass(frozen=True)
class Complex:
    """A complex number whose parts are CasADi scalars or floats, or a row of them, whose parts are (1, columns)."""

    re: Part
    im: Part = 0.0

    def __add__(self, other: Complex | Part) -> Complex:
        other = as_complex(other)
        return Complex(_sum(self.re, other.re), _sum(self.im, other.im))

    __radd__ = __add__

    def __neg__(self) -> Complex:
        return Complex(-self.re, -self.im)

    def __sub__(self, other: Complex | Part) -> Complex:
        other = as_complex(other)
        return Complex(_difference(self.re, other.re), _difference(self.im, other.im))

    def __rsub__(self, other: Complex | Part) -> Complex:
        return as_complex(other) - self

    def __mul__(self, other: Complex | Part) -> Complex:
        a, b = self, as_complex(other)
        return Complex(
            _difference(_product(a.re, b.re), _product(a.im, b.im)), _sum(_product(a.re, b.im), _product(a.im, b.re))
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Complex | Part) -> Complex:
        return self * as_complex(other).inverse()

    def __rtruediv__(self, other: Part) -> Complex:
        return self.inverse() * other

    def __getitem__(self, column: int) -> Complex:
        """An entry of a row."""
        return Complex(*(part[column] if isinstance(part, ca.SX) else part for part in (self.re, self.im)))

    def inverse(self) -> Complex:
        """1 over it."""
        if _zero(self.im):
            return Complex(1 / self.re)
        size = _sum(_product(self.re, self.re), self.im * self.im)
        return Complex(0.0 if _zero(self.re) else self.re / size, -self.im / size)


def _zero(part: Part) -> bool:
    return part.is_zero() if isinstance(part, ca.SX) else part == 0.0


def _sum(a: Part, b: Part) -> Part:
    return b if _zero(a) else a if _zero(b) else a + b


def _difference(a: Part, b: Part) -> Part:
    return a if _zero(b) else -b if _zero(a) else a - b


def _product(a: Part, b: Part) -> Part:
    return 0.0 if _zero(a) or _zero(b) else a * b


def as_complex(value: Complex | ca.SX | float) -> Complex:
    """The value as a complex number."""
    return value if isinstance(value, Complex) else Complex(value)


def joined(values: Sequence[Complex]) -> Complex:
    """A row of scalars."""
    return Complex(ca.horzcat(*(value.re for value in values)), ca.horzcat(*(value.im for value in values)))


def exp(value: Complex) -> Complex:
    """Exponential."""
    size = ca.exp(value.re)
    return Complex(size * ca.cos(value.im), size * ca.sin(value.im))


Row = dict[int, Complex]


def solve(rows: list[Row], right: list[Complex]) -> list[Complex]:
    """Solve sparse linear equations by elimination without fill beyond what the graph asks for.

    Parameters
    ----------
    rows : list of dict
        Row i as {column: coefficient}; its diagonal entry must not vanish at the values it is used for, which holds
        for dynamic stiffnesses of damped chains at frequencies above zero.
    right : list of Complex
        Right-hand sides, each a row.

    Returns
    -------
    list of Complex
        Solutions, each a row.
    """
    rows, right = [dict(row) for row in rows], list(right)
    left = set(range(len(rows)))
    order: list[int] = []
    inverse: dict[int, Complex] = {}
    while left:
        pivot = min(left, key=lambda i: (sum(j in left for j in rows[i]), i))
        left.remove(pivot)
        order.append(pivot)
        inverse[pivot] = rows[pivot][pivot].inverse()
        for i in left:
            if pivot not in rows[i]:
                continue
            factor = rows[i].pop(pivot) * inverse[pivot]
            for j, value in rows[pivot].items():
                if j in left:
                    rows[i][j] = rows[i][j] - factor * value if j in rows[i] else -(factor * value)
            right[i] = right[i] - factor * right[pivot]
    for pivot in reversed(order):
        for j, value in rows[pivot].items():  # what came before the pivot is no longer in its row
            if j != pivot:
                right[pivot] = right[pivot] - value * right[j]
        right[pivot] = right[pivot] * inverse[pivot]
    return right
