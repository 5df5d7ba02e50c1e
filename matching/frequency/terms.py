"""The terms of the programme with their derivatives: response error, stability margins, tracked eigenpairs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from matching.frequency.closed_loop import ClosedLoop
from matching.frequency.derivatives import Mapped


@dataclass(frozen=True)
class Goal:
    """A target for the optimiser: eigenvalue wanted, rad/s, and pattern of speeds over the dynamometers (u,)."""

    eigenvalue: complex
    pattern: np.ndarray


@dataclass(frozen=True)
class ResponseError:
    """Mean square of |log(H/reference)| and its derivatives with respect to what moves (m,)."""

    value: ca.MX
    _residual: ca.MX
    _logarithm: Mapped

    def gradient(self) -> ca.MX:
        """First derivative (m, 1)."""
        return 2 / self._residual.numel() * 2 * self._logarithm.gradient(self._residual)

    def hessian(self) -> ca.MX:
        """Second derivative (m, m)."""
        J = self._logarithm.jacobian()
        return 2 / self._residual.numel() * 2 * (J.T @ J + self._logarithm.hessian(self._residual))


def response_error(
    loop: ClosedLoop, free: ca.SX, p: ca.SX, point: ca.MX, frequencies: np.ndarray, reference: np.ndarray
) -> ResponseError:
    """The response error over frequencies (f,) in Hz against the vehicle's responses (f, h), phase unwrapped.

    ``free`` (m, 1) are the symbols in ``p``, ``point`` the programme's expression for them.
    """
    s, wanted = _s(), [ca.SX.sym(f"wanted_{part}", reference.shape[1]) for part in ("re", "im")]
    re, im = loop.response(*s, p)
    size = wanted[0] ** 2 + wanted[1] ** 2
    ratio_re, ratio_im = (re * wanted[0] + im * wanted[1]) / size, (im * wanted[0] - re * wanted[1]) / size
    logarithm = ca.vertcat(ca.log(ratio_re**2 + ratio_im**2 + 1e-12) / 2, ca.atan2(ratio_im, ratio_re))
    omega = 2 * np.pi * frequencies[None]
    given = [0 * omega, omega, reference.T.real, reference.T.imag]
    found = Mapped(logarithm, free, [*s, *wanted], point, given)
    ratio = found.values(ca.vertcat(ratio_re, ratio_im))
    x, y = ratio[: reference.shape[1], :], ratio[reference.shape[1] :, :]
    turns = ca.atan2(y[:, 1:] * x[:, :-1] - x[:, 1:] * y[:, :-1], x[:, 1:] * x[:, :-1] + y[:, 1:] * y[:, :-1])
    phase = ca.cumsum(ca.horzcat(ca.atan2(y[:, 0], x[:, 0]), turns), 1)
    residual = ca.vec(ca.vertcat(ca.log(x**2 + y**2 + 1e-12) / 2, phase).T)
    return ResponseError(ca.sumsqr(residual) / reference.size, residual, found)


def margins(
    loop: ClosedLoop, free: ca.SX, p: ca.SX, point: ca.MX, lines: list[tuple[np.ndarray, float, float]]
) -> Mapped:
    """Leading minors of DᴴD − least²·I, scaled by its diagonal: all positive where σ_min(D) > least (Sylvester).

    Parameters
    ----------
    lines : list of (frequencies (f,) in Hz, damping ratio, least)
        D = I + L is taken at s = ω·(−ζ + j·sqrt(1 − ζ²)).

    Raises
    ------
    NotImplementedError
        For more than two dynamometers.
    """
    s, least = _s(), ca.SX.sym("least")
    re, im = loop.difference(*s, p)
    k = round(re.numel() ** 0.5)
    if k > 2:
        raise NotImplementedError("more than two dynamometers")
    D = [[(re[row * k + i], im[row * k + i]) for i in range(k)] for row in range(k)]
    gram = [sum(D[row][i][0] ** 2 + D[row][i][1] ** 2 for row in range(k)) for i in range(k)]
    diagonal = [own - least**2 for own in gram]
    minors = [diagonal[0] / (1 + gram[0])]
    if k == 2:
        a = sum(D[row][0][0] * D[row][1][0] + D[row][0][1] * D[row][1][1] for row in range(2))
        b = sum(D[row][0][0] * D[row][1][1] - D[row][0][1] * D[row][1][0] for row in range(2))
        minors.append((diagonal[0] * diagonal[1] - a**2 - b**2) / ((1 + gram[0]) * (1 + gram[1])))
    given: list[list[np.ndarray]] = [[], [], []]
    for frequencies, damping, bound in lines:
        omega = 2 * np.pi * frequencies
        for kept, one in zip(given, (-damping * omega, omega * np.sqrt(1 - damping**2), np.full(len(omega), bound))):
            kept.append(one)
    return Mapped(ca.vertcat(*minors), free, [*s, least], point, [np.concatenate(one)[None] for one in given])


def eigenpair(loop: ClosedLoop, goal: Goal, own: ca.SX, p: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Rows (2·k + 2,) that are zero at an eigenpair of the loop, and its squared distance from the goal.

    ``own`` (2 + 2·k,) are σ and ω over the goal's |s|, and the vector's real and imaginary parts, normalised by
    patternᵀx = 1.
    """
    k, size = len(goal.pattern), abs(goal.eigenvalue)
    x_re, x_im = own[2 : 2 + k], own[2 + k : 2 + 2 * k]
    re, im = loop.difference(own[0] * size, own[1] * size, p)
    D_re, D_im = ca.reshape(re, k, k).T, ca.reshape(im, k, k).T
    scale = 1 / (1 + ca.sqrt(ca.sumsqr(re) + ca.sumsqr(im)))
    pattern = ca.DM(goal.pattern / np.linalg.norm(goal.pattern))
    rows: Any = ca.vertcat(
        (D_re @ x_re - D_im @ x_im) * scale,
        (D_re @ x_im + D_im @ x_re) * scale,
        pattern.T @ x_re - 1,
        pattern.T @ x_im,
    )
    natural = ca.sqrt(own[0] ** 2 + own[1] ** 2)
    ratio = -goal.eigenvalue.real / size
    return rows, (natural - 1) ** 2 + (-own[0] / natural - ratio) ** 2


def _s() -> list[ca.SX]:
    return [ca.SX.sym("s_re"), ca.SX.sym("s_im")]
