"""Implicit steps without a compiler: the method of :mod:`rosenbrock` in NumPy around CasADi's virtual machine."""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca
import numpy as np
from scipy.linalg import lapack

from modelling.simulation.integrator.functions import Functions
from modelling.simulation.integrator.rosenbrock import ALPHA, GAMMA, GAMMA_SUM, STAGES, A, C

InputsAt = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class _Evaluator:
    """A CasADi function called through its buffers, ten times faster than with conversions; results are dense."""

    def __init__(self, function: ca.Function, *arguments: np.ndarray):
        self._buffer, self._trigger = function.buffer()
        for i, argument in enumerate(arguments):
            self._buffer.set_arg(i, memoryview(argument))  # type: ignore[call-arg, arg-type]
        self.results = []
        for i in range(function.n_out()):
            self.results.append(np.zeros(function.size_out(i)[::-1]))  # CasADi's columns are NumPy's rows
            self._buffer.set_res(i, memoryview(self.results[-1]))  # type: ignore[call-arg, arg-type]

    def __call__(self) -> list[np.ndarray]:
        self._trigger()
        return self.results


def nodes(
    made: Functions, constants: np.ndarray, start: np.ndarray, time: np.ndarray, inputs_at: InputsAt
) -> tuple[np.ndarray, np.ndarray]:
    """States (x, k) at the ends of all steps, and the embedded errors (x, k-1) of the steps.

    Parameters
    ----------
    constants, start : ndarray (c,), (x,)
    time : ndarray (k,)
        s, of the nodes.
    inputs_at : callable
        Times → inputs and their time derivatives (·, u).
    """
    assert made.jacobian is not None
    x, u = start.copy(), np.zeros(made.field.size1_in(1))
    constants = np.ascontiguousarray(constants, float)
    rate = _Evaluator(made.field, x, u, constants)
    A_, B_ = (ca.densify(part) for part in made.jacobian(*(made.field.sx_in())))
    jacobian = _Evaluator(ca.Function("dense", made.field.sx_in(), [A_, B_]), x, u, constants)
    h = np.diff(time)
    inputs = np.stack([inputs_at(time[:-1] + alpha * h)[0] for alpha in ALPHA[:-1]] + [inputs_at(time[1:])[0]])
    drive = inputs_at(time[:-1] + h / 2)[1]
    out = np.full((len(start), len(time)), np.nan)
    errors = np.full((len(start), len(h)), np.nan)
    out[:, 0] = start
    eye = np.eye(len(start))
    known, known_h, factors, pivots = np.full(eye.shape, np.nan), math.nan, eye, np.zeros(len(start), np.int32)
    for k in range(len(h)):
        x[:], u[:] = out[:, k], inputs[0, k]
        J, by_input = jacobian()
        if not (abs(h[k] - known_h) <= 1e-9 * h[k] and np.array_equal(J, known)):
            known, known_h = J.copy(), h[k]
            factors, pivots, _ = lapack.dgetrf(eye / (GAMMA * h[k]) - J.T)
        forced = h[k] * drive[k] @ by_input
        U = np.zeros((STAGES, len(start)))
        for i in range(STAGES):
            x[:], u[:] = out[:, k] + A[i, :i] @ U[:i], inputs[i, k]
            right = rate()[0][0] + C[i, :i] @ U[:i] / h[k] + GAMMA_SUM[i] * forced
            U[i] = lapack.dgetrs(factors, pivots, right)[0]
        out[:, k + 1], errors[:, k] = x + U[-1], U[-1]
        if not np.isfinite(out[:, k + 1]).all():
            break
    return out, errors
