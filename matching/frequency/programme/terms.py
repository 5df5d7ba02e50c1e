"""The terms of the programme as expressions at one frequency or one eigenpair."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from matching.frequency.programme.closed_loop import General

MEET = 1e-3  # of least²: how near both singular values have to be before they count as one


@dataclass(frozen=True)
class Term:
    """An expression with its symbols: what differs from place to place (n,), what moves (m,) and what is fixed (c,)."""

    at: ca.SX
    free: ca.SX
    fixed: ca.SX
    value: ca.SX

    @cached_property
    def plain(self) -> ca.Function:
        """(at, free, fixed) → value, as it stands."""
        return ca.Function("plain", [self.at, self.free, self.fixed], [self.value])

    @cached_property
    def text(self) -> str:
        """The same as text, equal for equal expressions."""
        return str(self.plain.serialize())


def response(loop: General, free: ca.SX, p: ca.SX, fixed: ca.SX) -> Term:
    """H (2·h,), real parts first, at s (2,)."""
    s = ca.SX.sym("s", 2)
    return Term(s, free, fixed, ca.vertcat(*_at(loop.response, s, p, fixed)))


def logarithm(loop: General, count: int, free: ca.SX, p: ca.SX, fixed: ca.SX) -> tuple[Term, Term]:
    """H/wanted (2·h,), real parts first, and its logarithm (2·h,) for ``count`` responses; at s and wanted (2 + 2·h,).

    ``p`` holds the values of what moves as expressions of ``free``, and of the bounds in ``fixed`` after the loop's.
    """
    s, wanted = ca.SX.sym("s", 2), [ca.SX.sym(f"wanted_{part}", count) for part in ("re", "im")]
    re, im = _at(loop.response, s, p, fixed)
    size = wanted[0] ** 2 + wanted[1] ** 2
    ratio_re, ratio_im = (re * wanted[0] + im * wanted[1]) / size, (im * wanted[0] - re * wanted[1]) / size
    log = ca.vertcat(ca.log(ratio_re**2 + ratio_im**2 + 1e-12) / 2, ca.atan2(ratio_im, ratio_re))
    at = ca.vertcat(s, *wanted)
    return Term(at, free, fixed, ca.vertcat(ratio_re, ratio_im)), Term(at, free, fixed, log)


def margin(loop: General, free: ca.SX, p: ca.SX, fixed: ca.SX) -> Term:
    """How far the smallest singular value of D = I + L is above ``least``, (σ² − least²)/(1 + σ²); at s and least (3,).

    Smooth where both singular values meet: there it is less than it is by the order of :data:`MEET`, never more.

    Raises
    ------
    NotImplementedError
        For more than two dynamometers.
    """
    at = ca.SX.sym("s", 3)
    re, im = _at(loop.difference, at, p, fixed)
    k, least = round(re.numel() ** 0.5), at[2]
    if k > 2:
        raise NotImplementedError("more than two dynamometers")
    D = [[(re[row * k + i], im[row * k + i]) for i in range(k)] for row in range(k)]
    gram = [sum(D[row][i][0] ** 2 + D[row][i][1] ** 2 for row in range(k)) for i in range(k)]
    smallest = gram[0]
    if k == 2:
        a = sum(D[row][0][0] * D[row][1][0] + D[row][0][1] * D[row][1][1] for row in range(2))
        b = sum(D[row][0][0] * D[row][1][1] - D[row][0][1] * D[row][1][0] for row in range(2))
        apart = ca.sqrt(((gram[0] - gram[1]) / 2) ** 2 + a**2 + b**2 + (MEET * least**2) ** 2)
        smallest = (gram[0] * gram[1] - a**2 - b**2) / ((gram[0] + gram[1]) / 2 + apart)
    return Term(at, free, fixed, (smallest - least**2) / (1 + smallest))


def eigenpair(loop: General, free: ca.SX, p: ca.SX, fixed: ca.SX) -> Term:
    """Rows (2·u + 2,) that are zero at an eigenpair of the loop, and last its squared distance from the goal.

    At :attr:`Goal.numbers`; what moves is ``free`` and after it the pair (2 + 2·u,): σ and ω over the goal's |s|, and
    the vector's real and imaginary parts, normalised by patternᵀx = 1.
    """
    k = round(loop.difference.numel_out(0) ** 0.5)
    own, goal = ca.SX.sym("pair", 2 + 2 * k), ca.SX.sym("goal", 2 + k)
    x_re, x_im, pattern = own[2 : 2 + k], own[2 + k :], goal[2:]
    re, im = _at(loop.difference, own[:2] * goal[0], p, fixed)
    D_re, D_im = ca.reshape(re, k, k).T, ca.reshape(im, k, k).T
    scale = 1 / (1 + ca.sqrt(ca.sumsqr(re) + ca.sumsqr(im)))
    natural = ca.sqrt(own[0] ** 2 + own[1] ** 2)
    rows: Any = ca.vertcat(
        (D_re @ x_re - D_im @ x_im) * scale,
        (D_re @ x_im + D_im @ x_re) * scale,
        pattern.T @ x_re - 1,
        pattern.T @ x_im,
        (natural - 1) ** 2 + (-own[0] / natural - goal[1]) ** 2,
    )
    return Term(goal, ca.vertcat(free, own), fixed, rows)


def _at(function: ca.Function, s: ca.SX, p: ca.SX, fixed: ca.SX) -> Any:
    """A function of the loop with its own of the fixed numbers, which come first."""
    return function(s[0], s[1], p, fixed[: function.numel_in(3)])
