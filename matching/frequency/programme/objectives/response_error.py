"""The response error: mean square of |log(H_rig/H_vehicle)| over the band and the compared functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from matching.frequency.case.case import Case, Move
from matching.frequency.programme.closed_loop import General
from matching.frequency.programme.constraints import CommonParts, summed
from matching.frequency.programme.evaluators import jacobian, value, weighted_gradient, weighted_hessian
from matching.frequency.programme.objective import Objective, ObjectiveBlock, Terms
from matching.frequency.programme.terms import logarithm
from matching.frequency.response.responses import ComparedBed

FREQUENCIES = 48  # log-spaced over the band
SMALLEST_RATIO_SQUARED = 1e-12  # added to |H/H_vehicle|², so that its logarithm stays finite


@dataclass(frozen=True)
class ResponseErrorObjective(Objective):
    """Vehicle responses (f, h) at frequencies (f,), Hz, that the feedback loop is to reproduce."""

    name = "response_error"
    tracks_modes = True
    frequencies: np.ndarray
    vehicle: np.ndarray

    @classmethod
    def of(cls, case: Case) -> ResponseErrorObjective:
        """See :meth:`Objective.of`."""
        frequencies = np.geomspace(*case.band, FREQUENCIES)
        return cls(frequencies, ComparedBed(case).of_vehicle(frequencies))

    @staticmethod
    def terms(loop: General, free: ca.SX, p: ca.SX, fixed: ca.SX) -> tuple[Terms, Terms]:
        """H over that of the vehicle, and its logarithm."""
        ratio, log = logarithm(loop, loop.response.numel_out(0), free, p, fixed)
        first: Terms = {"ratio": (value, ratio), "log_gradient": (weighted_gradient, log)}
        return first, {"log_jacobian": (jacobian, log), "log_hessian": (weighted_hessian, log)}

    def block(self, common: CommonParts, moves: Sequence[Move], compiled: bool) -> ObjectiveBlock:
        """See :meth:`Objective.block`."""
        return _ResponseErrorBlock(common, self.frequencies, self.vehicle)


@dataclass(frozen=True)
class _ResponseErrorBlock(ObjectiveBlock):
    """Mean square of |log(H/reference)| over frequencies (f,) in Hz and functions, phase unwrapped."""

    common: CommonParts
    frequencies: np.ndarray
    reference: np.ndarray

    def value(self) -> ca.MX:
        """Scalar."""
        return ca.sumsqr(self._residual()) / self.reference.size

    def gradient(self) -> tuple[ca.MX, ca.MX]:
        """Value and gradient (v, 1)."""
        residual = self._residual()
        gradient = ca.sum2(self.common.over("log_gradient", self._at(), residual)[0])
        rest = ca.MX(self.common.v.numel() - self.common.size, 1)
        return ca.sumsqr(residual) / self.reference.size, ca.vertcat(2 / self.reference.size * gradient, rest)

    def hessian(self) -> ca.MX:
        """Hessian (v, v)."""
        residual, (_, each) = self._residual(), self.common.over("log_jacobian", self._at())
        a = residual.shape[0]
        J = self.common.widened(ca.vertcat(*(each[i::a, :].T for i in range(a))))
        second = summed(self.common, self.common.over("log_hessian", self._at(), residual)[0])
        return 2 / self.reference.size * (J.T @ J + second)

    def _at(self) -> ca.MX:
        omega = 2 * np.pi * self.frequencies[None]
        return ca.MX(ca.DM(np.vstack([0 * omega, omega, self.reference.T.real, self.reference.T.imag])))

    def _residual(self) -> ca.MX:
        """Logarithm of magnitude and unwrapped phase (2·h, f)."""
        ratio, h = self.common.over("ratio", self._at())[0], self.reference.shape[1]
        x, y = ratio[:h, :], ratio[h:, :]
        steps = ca.atan2(y[:, 1:] * x[:, :-1] - x[:, 1:] * y[:, :-1], x[:, 1:] * x[:, :-1] + y[:, 1:] * y[:, :-1])
        phase = ca.cumsum(ca.horzcat(ca.atan2(y[:, 0], x[:, 0]), steps), 1)
        return ca.vertcat(ca.log(x**2 + y**2 + SMALLEST_RATIO_SQUARED) / 2, phase)
