"""The terms of the programme as expressions at one frequency or one eigenpair."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from matching.frequency.programme.closed_loop import General
from modelling.equations.complex_sx import Complex, solve

MEET = 1e-3  # of least²: how near both singular values have to be before they count as one
SQUARINGS = 4  # 2⁴ is the order of the norm that stands for the largest singular value of three and more


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
    """How much the smallest singular value of D = I + L exceeds ``least``, (σ² − least²)/(1 + σ²); at s, least (3,).

    Smooth where singular values meet: there it is less than it is, never more (see :func:`_two`, :func:`_several`).
    """
    at = ca.SX.sym("s", 3)
    re, im = _at(loop.difference, at, p, fixed)
    k, least = round(re.numel() ** 0.5), at[2]
    D = [[Complex(re[row * k + i], im[row * k + i]) for i in range(k)] for row in range(k)]
    smallest = re[0] ** 2 + im[0] ** 2 if k == 1 else _two(D, least) if k == 2 else _several(D)
    return Term(at, free, fixed, (smallest - least**2) / (1 + smallest))


def _two(D: list[list[Complex]], least: ca.SX) -> Any:
    """Smaller eigenvalue of DᴴD (2, 2), less by at most the order of :data:`MEET` where both meet."""
    gram = [sum(D[row][i].re ** 2 + D[row][i].im ** 2 for row in range(2)) for i in range(2)]
    a = sum(D[row][0].re * D[row][1].re + D[row][0].im * D[row][1].im for row in range(2))
    b = sum(D[row][0].re * D[row][1].im - D[row][0].im * D[row][1].re for row in range(2))
    apart = ca.sqrt(((gram[0] - gram[1]) / 2) ** 2 + a**2 + b**2 + (MEET * least**2) ** 2)
    return (gram[0] * gram[1] - a**2 - b**2) / ((gram[0] + gram[1]) / 2 + apart)


def _several(D: list[list[Complex]]) -> Any:
    """Smallest eigenvalue of DᴴD (k, k) as 1/‖(DᴴD)⁻¹‖ in the Schatten norm of order 16, any k.

    Less than it is by a factor k^(−1/16) where all are equal (8 % for k = 4, so 4 % of the margin), by nothing where
    one is by itself.
    """
    k = len(D)
    unit = [Complex(ca.densify(ca.SX.eye(k)[row, :])) for row in range(k)]
    inverse = solve([dict(enumerate(row)) for row in D], unit)
    re, im = ca.vertcat(*(row.re for row in inverse)), ca.vertcat(*(row.im for row in inverse))
    real = ca.vertcat(ca.horzcat(re, -im), ca.horzcat(im, re))  # every singular value twice
    M = real @ real.T
    size = ca.trace(M) / 2
    M = M / size
    for _ in range(SQUARINGS):
        M = M @ M
    return 1 / (size * (ca.trace(M) / 2) ** (0.5**SQUARINGS))


def eigenpair(loop: General, free: ca.SX, p: ca.SX, fixed: ca.SX) -> Term:
    """Rows (2·u + 2,) that are zero at an eigenpair of the loop, and last its squared distance from the goal.

    At :attr:`Goal.numbers`; what moves is ``free`` and after it the pair (2 + 2·u,): σ and ω over the goal's |s|, and
    the vector's real and imaginary parts, normalised by patternᵀx = 1.
    """
    k = round(loop.difference.numel_out(0) ** 0.5)
    pair, goal = ca.SX.sym("pair", 2 + 2 * k), ca.SX.sym("goal", 2 + k)
    x_re, x_im, pattern = pair[2 : 2 + k], pair[2 + k :], goal[2:]
    re, im = _at(loop.difference, pair[:2] * goal[0], p, fixed)
    D_re, D_im = ca.reshape(re, k, k).T, ca.reshape(im, k, k).T
    scale = 1 / (1 + ca.sqrt(ca.sumsqr(re) + ca.sumsqr(im)))
    natural = ca.sqrt(pair[0] ** 2 + pair[1] ** 2)
    rows: Any = ca.vertcat(
        (D_re @ x_re - D_im @ x_im) * scale,
        (D_re @ x_im + D_im @ x_re) * scale,
        pattern.T @ x_re - 1,
        pattern.T @ x_im,
        (natural - 1) ** 2 + (-pair[0] / natural - goal[1]) ** 2,
    )
    return Term(goal, ca.vertcat(free, pair), fixed, rows)


def _at(function: ca.Function, s: ca.SX, p: ca.SX, fixed: ca.SX) -> Any:
    """A function of the loop with its own of the fixed numbers, which come first."""
    return function(s[0], s[1], p, fixed[: function.numel_in(3)])
