"""The law of propagation of uncertainty: first and second order (GUM 5.1, 5.2), degrees of freedom (GUM G.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import scipy
import sympy

from matching.validity.budget.budget import Budget, Measurand
from modelling.common.errors import InputError
from modelling.equations.sympy_to_casadi import to_casadi

LARGEST_VALUE = 1e160  # of larger ones, even the sum of the squares of their rounding errors is no number
CANCELLED = 1e-14  # of the sum of contributions, squared: a smaller variance is rounding, as of x + y at r = -1


@dataclass(frozen=True)
class Propagation:
    """What the law of propagation gives for one measurand, in SI.

    ``sensitivities`` (p,); ``first_order`` and ``second_order`` are combined standard uncertainties; ``bias`` is the
    second-order shift of the expectation, E[Y] − f(x). ``degrees_of_freedom`` is None where refused, with the reason.
    """

    value: float
    sensitivities: np.ndarray
    first_order: float
    second_order: float
    bias: float
    degrees_of_freedom: float | None
    refusal: str


@lru_cache(maxsize=256)
def _derivatives(expression: Any, names: tuple[str, ...], pairs: tuple[tuple[int, int], ...]) -> ca.Function:
    """(x, Σ) → value, gradient ``(p,)``, Hessian ``(p, p)``, t_j = Σ f_jkl Σ_kl ``(p,)`` and f_jjj ``(p,)``.

    The covariance Σ (p, p) has entries at ``pairs`` only. By algorithmic differentiation: the work grows with the
    length of the formula, however deep it is nested. Beside the kink of an abs(); at it, propagate() says that there is
    no second order.
    """
    x = ca.SX.sym("x", len(names))
    known = {sympy.Symbol(name, real=True): x[i] for i, name in enumerate(names)}
    (value,) = to_casadi([expression], known)
    gradient = ca.gradient(value, x)
    hessian = ca.jacobian(gradient, x)
    rows, columns = zip(*pairs, strict=True)
    covariance = ca.SX.sym("covariance", ca.Sparsity.triplet(len(names), len(names), rows, columns))
    weighted = ca.gradient(ca.dot(hessian, covariance), x)
    third = ca.vertcat(*(ca.gradient(hessian[i, i], x)[i] for i in range(len(names))))
    return ca.Function("derivatives", [x, covariance], [value, gradient, hessian, weighted, third])


@dataclass(frozen=True)
class _Derivatives:
    """Value and derivatives at the values of the inputs, see :func:`_derivatives`."""

    value: float
    gradient: np.ndarray
    hessian: np.ndarray
    weighted_third: np.ndarray
    third: np.ndarray


def _evaluate(budget: Budget, measurand: Measurand) -> _Derivatives:
    names = tuple(quantity.name for quantity in budget.inputs)
    pairs = tuple((int(k), int(other)) for k, other in zip(*np.nonzero(budget.correlation), strict=True))
    parts = _derivatives(measurand.expression, names, pairs)(budget.values, budget.covariance)
    value, gradient, hessian, weighted, third = (part.full() for part in parts)
    derivatives = _Derivatives(float(value[0, 0]), gradient.ravel(), hessian, weighted.ravel(), third.ravel())
    if not (math.isfinite(derivatives.value) and np.all(np.isfinite(derivatives.gradient))):
        raise _not_finite(budget, measurand)
    return derivatives


def _not_finite(budget: Budget, measurand: Measurand) -> InputError:
    return InputError(
        f"{budget.where}: measurand {measurand.name}.formula",
        "has no finite real value, slope or uncertainty at the values of the inputs",
        "correct the formula or a value",
    )


def propagate(budget: Budget, measurand: Measurand) -> Propagation:
    """First and second order for one measurand.

    Second order is GUM 5.1.2 note in matrix form, ``½ tr(HΣHΣ) + cᵀΣt`` with ``t_j = Σ f_jkl Σ_kl``, which is exact to
    that order for jointly normal inputs; for an independent input of another shape the kurtosis corrects its own term.
    It is NaN where second or third derivatives do not exist.

    Raises
    ------
    InputError
        If the measurand or a derivative is not finite at the inputs' values.
    """
    with np.errstate(all="ignore"):  # uncertainties near 1e160 have no squares: judged by what comes out
        return _propagated(budget, measurand, _evaluate(budget, measurand))


def too_large(budget: Budget, measurand: Measurand) -> InputError:
    """That a value, or the square of an uncertainty, is beyond what a floating-point number holds."""
    return InputError(
        f"{budget.where}: measurand {measurand.name}",
        "its value or variance is too large for a number",
        "give values and uncertainties in a larger unit",
    )


def _propagated(budget: Budget, measurand: Measurand, derivatives: _Derivatives) -> Propagation:
    c, hessian, covariance = derivatives.gradient, derivatives.hessian, budget.covariance
    first = float(c @ covariance @ c)
    largest = np.sum(np.abs(c) * budget.standard_uncertainties) ** 2
    product = hessian @ covariance
    bias = 0.5 * float(np.trace(product))
    squares = np.isfinite(covariance).all() and np.isfinite(largest)
    curved = np.isfinite(bias) or not np.isfinite(hessian).all()  # a kink has no second derivative
    if not (squares and curved and abs(derivatives.value) <= LARGEST_VALUE):
        raise too_large(budget, measurand)
    if first < CANCELLED * largest:
        first = 0.0
    extra = 0.5 * np.trace(product @ product) + c @ covariance @ derivatives.weighted_third
    for i, quantity in enumerate(budget.inputs):
        if np.count_nonzero(budget.correlation[i]) == 1 and quantity.standard_uncertainty > 0:
            excess = quantity.distribution.kurtosis() - 3
            u4 = np.float64(quantity.standard_uncertainty) ** 4
            extra += excess * u4 * (hessian[i, i] ** 2 / 4 + c[i] * derivatives.third[i] / 3)
    freedom, refusal = effective_degrees_of_freedom(budget, c)
    smooth = math.isfinite(extra) and not _on_a_kink(budget, measurand)
    second = math.sqrt(max(first + extra, 0.0)) if smooth else math.nan
    return Propagation(derivatives.value, c, math.sqrt(max(first, 0.0)), second, bias, freedom, refusal)


def _on_a_kink(budget: Budget, measurand: Measurand) -> bool:
    point = {sympy.Symbol(quantity.name, real=True): quantity.value for quantity in budget.inputs}
    return any(abs(float(part.args[0].subs(point))) == 0 for part in measurand.expression.atoms(sympy.Abs))


def effective_degrees_of_freedom(budget: Budget, sensitivities: np.ndarray) -> tuple[float | None, str]:
    """Welch–Satterthwaite (GUM G.4.1) for sensitivities (i,), each group of simultaneous readings as one component.

    Any linear combination of jointly normal readings is itself a normal reading with n − 1 degrees of freedom, so a
    group enters with the variance it contributes as a whole. Correlated inputs outside a group are refused unless
    their degrees of freedom are infinite.
    """
    parts = sensitivities * budget.standard_uncertainties
    covered = np.outer(parts, parts) * budget.correlation
    total, below = float(covered.sum()), 0.0
    groups: dict[str, list[int]] = {}
    for i, quantity in enumerate(budget.inputs):
        correlated = np.count_nonzero(budget.correlation[i]) > 1
        if quantity.group is not None:
            groups.setdefault(quantity.group, []).append(i)
        elif math.isfinite(quantity.degrees_of_freedom) and parts[i] != 0:
            if correlated:
                return None, (
                    f"Welch-Satterthwaite does not hold: {quantity.name} has finite degrees of freedom and is "
                    "correlated by a given coefficient"
                )
            below += parts[i] ** 4 / quantity.degrees_of_freedom
    for members in groups.values():
        below += float(covered[np.ix_(members, members)].sum()) ** 2 / budget.inputs[members[0]].degrees_of_freedom
    if total <= 0 or below <= 0:
        return math.inf, ""
    return total**2 / below, ""


def coverage_factor(budget: Budget, degrees_of_freedom: float | None) -> float:
    """k: as the budget says, or Student's t for its coverage with ν_eff cut to a whole number (GUM G.6.4)."""
    if budget.coverage_factor is not None:
        return budget.coverage_factor
    level = (1 + budget.coverage) / 2
    if degrees_of_freedom is None or degrees_of_freedom > 1e9:
        return float(scipy.stats.norm.ppf(level))
    whole = math.floor(degrees_of_freedom + 1e-9)
    return float(scipy.stats.t.ppf(level, whole if whole >= 1 else degrees_of_freedom))


def output_correlation(budget: Budget, propagations: list[Propagation]) -> np.ndarray:
    """Correlation of the measurands by the inputs they share (GUM H.2), shape (measurands, measurands)."""
    jacobian = np.array([propagation.sensitivities for propagation in propagations])
    covariance = jacobian @ budget.covariance @ jacobian.T
    u = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(u, u)
    return np.where(np.outer(u, u) > 0, correlation, np.eye(len(u)))
