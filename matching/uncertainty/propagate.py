"""The law of propagation of uncertainty: first and second order (GUM 5.1, 5.2), degrees of freedom (GUM G.4)."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import scipy
import sympy
from scipy.sparse.csgraph import connected_components
from scipy.special import ndtr

from matching.uncertainty.budget import Budget, Distribution, Measurand
from modelling.equations.casadi_code import to_casadi
from modelling.errors import InputError
from modelling.units import Unit, printed, unit_of

# --- Joint draws of all inputs for the Monte Carlo method (JCGM 101, 6.4), chunk by chunk.

Draw = Callable[[np.random.Generator, int], dict[int, np.ndarray]]


def sampler(budget: Budget) -> Callable[[np.random.Generator, int], list]:
    """A function (generator, count) → for every input an array (count,) of draws, or its number where it is exact.

    Independent inputs are drawn from their own shapes; simultaneous readings from the multivariate t whose marginals
    are those of JCGM 101, 6.4.9; correlated normal inputs from the multivariate normal; other correlated shapes from
    a normal copula whose coefficients are chosen so that the inputs have the correlation asked for.
    """
    parts: list[Draw] = [_block(budget, members) for members in _blocks(budget)]
    values = [float(value) for value in budget.values]

    def draw(generator: np.random.Generator, count: int) -> list:
        inputs: list = list(values)
        for part in parts:
            for i, deviation in part(generator, count).items():
                deviation += values[i]
                inputs[i] = deviation
        return inputs

    return draw


def _blocks(budget: Budget) -> list[list[int]]:
    """The uncertain inputs in connected sets of correlated ones."""
    uncertain = np.flatnonzero(budget.standard_uncertainties > 0)
    if not uncertain.size:
        return []
    count, labels = connected_components(budget.correlation[np.ix_(uncertain, uncertain)] != 0, directed=False)
    return [[int(i) for i in uncertain[labels == label]] for label in range(count)]


def _block(budget: Budget, members: list[int]) -> Draw:
    u = budget.standard_uncertainties[members]
    if len(members) == 1:
        shape, scale, only = budget.inputs[members[0]].distribution, u[0], members[0]

        def independent(generator: np.random.Generator, count: int) -> dict[int, np.ndarray]:
            deviation = shape.draw(generator, count)
            deviation *= scale
            return {only: deviation}

        return independent
    correlation = budget.correlation[np.ix_(members, members)]
    shapes = [budget.inputs[i].distribution for i in members]
    if budget.inputs[members[0]].group is not None:
        return _multivariate_t(members, u, correlation, budget.inputs[members[0]].degrees_of_freedom)
    if all(shape.name == "normal" for shape in shapes):
        return _multivariate_t(members, u, correlation, math.inf)
    return _copula(members, u, shapes, _copula_correlation(correlation, shapes, f"{budget.where}: correlations"))


def _root(correlation: np.ndarray) -> np.ndarray:
    """A matrix square root that also exists at correlations of ±1, where Cholesky's does not."""
    values, vectors = np.linalg.eigh(correlation)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _multivariate_t(members: list[int], u: np.ndarray, correlation: np.ndarray, freedom: float) -> Draw:
    root = u[:, None] * _root(correlation)

    def draw(generator: np.random.Generator, count: int) -> dict[int, np.ndarray]:
        deviations = root @ generator.standard_normal((len(members), count))
        if math.isfinite(freedom):
            deviations /= np.sqrt(generator.chisquare(freedom, count) / freedom)
        return dict(zip(members, deviations, strict=True))

    return draw


def _copula(members: list[int], u: np.ndarray, shapes: list[Distribution], correlation: np.ndarray) -> Draw:
    if any(shape.width_tolerance for shape in shapes):
        right = "drop the tolerance or the correlation"
        raise InputError("correlations", "an input with half_width_tolerance cannot be correlated", right)
    root, laws = _root(correlation), [shape.law() for shape in shapes]

    def draw(generator: np.random.Generator, count: int) -> dict[int, np.ndarray]:
        normal = root @ generator.standard_normal((len(members), count))
        return {
            i: scale * (row if shape.name == "normal" else law.ppf(np.clip(ndtr(row), 1e-16, 1 - 1e-16)))
            for i, scale, row, shape, law in zip(members, u, normal, shapes, laws, strict=True)
        }

    return draw


def _copula_correlation(correlation: np.ndarray, shapes: list[Distribution], where: str) -> np.ndarray:
    """Coefficients of the normals behind the copula, pair by pair."""
    result = np.eye(len(shapes))
    for i, first in enumerate(shapes):
        for j, second in enumerate(shapes[:i]):
            if correlation[i, j] != 0:
                result[i, j] = result[j, i] = _behind(float(correlation[i, j]), first, second, where)
    if np.linalg.eigvalsh(result).min() < -1e-6:
        raise InputError(where, "these shapes cannot have these correlations together", "lower the coefficients")
    return result


def _behind(wanted: float, first: Distribution, second: Distribution, where: str) -> float:
    """The correlation of two normals that gives two shapes theirs, by Gauss–Hermite quadrature and a root search."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(80)
    weights = weights / weights.sum()
    along = _score(first, nodes)

    def reached(r: float) -> float:
        across = _score(second, r * nodes[:, None] + math.sqrt(1 - r * r) * nodes[None, :])
        return float(weights @ (along[:, None] * across) @ weights)

    low, high = reached(-1.0), reached(1.0)
    if not low - 1e-3 <= wanted <= high + 1e-3:
        wrong = f"r = {wanted:g} cannot be reached between a {first.name} and a {second.name} input"
        raise InputError(where, wrong, f"it lies in {low:.3f} ... {high:.3f}")
    if not low < wanted < high:
        return math.copysign(1.0, wanted)
    return float(scipy.optimize.brentq(lambda r: reached(r) - wanted, -1, 1))


def _score(shape: Distribution, normal: np.ndarray) -> np.ndarray:
    """Quantiles of a shape, over its standard deviation, where the normals stand."""
    law = shape.law()  # far out, where the weights vanish, the clip keeps quantiles finite
    return law.ppf(np.clip(ndtr(normal), 1e-15, 1 - 1e-15)) / law.std()


# --- Propagate

LARGEST_VALUE = 1e100  # no result of a program is larger
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
    # a series that leaves no variance where the first order has one does not hold for these uncertainties
    holds = smooth and (first + extra > 0 or first == extra == 0)
    second = math.sqrt(first + extra) if holds else math.nan
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


# --- The inverse: for a wanted expanded uncertainty, which input must improve, and to what.

SMALLEST_FACTOR = 1e-6  # on an input's uncertainty: as good as exact, but it keeps its degrees of freedom
SMALLEST_LEVEL = 1e-9  # of the largest contribution
INVERSE_DRAWS = 100_000  # they leave about 0.5 % of an expanded uncertainty open
INVERSE_SEED = 1  # the same draws for every trial, so that only the factors change the result


@dataclass(frozen=True)
class Improvement:
    """Standard uncertainties (SI) by input name that together reach the wanted expanded uncertainty."""

    needed: dict[str, float]
    reached: float


@dataclass(frozen=True)
class RequiredImprovement:
    """What must improve in a budget for a wanted expanded uncertainty of a measurand.

    Attributes
    ----------
    budget : Budget
    measurand : Measurand
    wanted, present : float
        Expanded uncertainties, SI.
    alone : tuple of Improvement
        Each input whose improvement alone suffices, the one that needs least first.
    together : Improvement, optional
        The largest contributions brought down to one level; None where nothing has to improve.
    """

    budget: Budget
    measurand: Measurand
    wanted: float
    present: float
    alone: tuple[Improvement, ...] = ()
    together: Improvement | None = None

    def to_dict(self) -> dict[str, Any]:
        """As ``uncertainty.json`` holds it, in the units of the budget file."""
        unit = self.measurand.unit
        return {
            "name": self.measurand.name,
            "unit": unit.text,
            "wanted": unit.difference_from_si(self.wanted),
            "present": unit.difference_from_si(self.present),
            "alone": [self._improvement_to_dict(improvement) for improvement in self.alone],
            "together": {} if self.together is None else self._improvement_to_dict(self.together),
        }

    def _improvement_to_dict(self, improvement: Improvement) -> dict[str, Any]:
        inputs = {quantity.name: quantity for quantity in self.budget.inputs}
        return {
            name: {
                "needed": inputs[name].unit.difference_from_si(u),
                "unit": inputs[name].unit.text,
                "ratio": u / inputs[name].standard_uncertainty,
            }
            for name, u in improvement.needed.items()
        }


def required(budget: Budget, measurand: Measurand, wanted: float, method: str = "first_order") -> RequiredImprovement:
    """What must improve for an expanded uncertainty of ``wanted`` (SI); degrees of freedom stay.

    Every answer is evaluated with the whole budget. By first order, k changes with the effective degrees of freedom; by
    ``"monte_carlo"``, the expanded uncertainty is half of the shortest interval of the draws.
    """
    if not wanted > 0 or not math.isfinite(wanted):
        raise InputError(f"{budget.where}: wanted uncertainty", f"{wanted:g} is not possible", "give a number above 0")

    expanded = (_expanded_by_draws if method == "monte_carlo" else _expanded_by_first_order)(budget, measurand)

    def improvement(factors: dict[str, float]) -> Improvement:
        u = {quantity.name: quantity.standard_uncertainty for quantity in budget.inputs}
        return Improvement(
            {name: u[name] * factor for name, factor in factors.items() if factor < 1}, expanded(factors)
        )

    present = expanded({})
    if present <= wanted:
        return RequiredImprovement(budget, measurand, wanted, present)
    uncertain = [quantity.name for quantity in budget.inputs if quantity.standard_uncertainty > 0]
    if method == "monte_carlo":  # each input's alone, for sensitivities may vanish (JCGM 101, annex B)
        alone_in = {name: expanded({other: 0.0 for other in uncertain if other != name}) for name in uncertain}
    else:
        parts = np.abs(propagate(budget, measurand).sensitivities) * budget.standard_uncertainties
        alone_in = {quantity.name: float(part) for quantity, part in zip(budget.inputs, parts, strict=True)}
    contributions = {name: contribution for name, contribution in alone_in.items() if contribution > 0}
    alone: list[tuple[float, Improvement]] = []
    for name in contributions:
        if expanded({name: SMALLEST_FACTOR}) <= wanted:
            factor = scipy.optimize.brentq(
                lambda x, name=name: expanded({name: x}) - wanted, SMALLEST_FACTOR, 1.0, xtol=1e-12
            )
            alone.append((factor, improvement({name: factor})))

    def levelled(level: float) -> dict[str, float]:
        return {name: min(1.0, level / contribution) for name, contribution in contributions.items()}

    largest = max(contributions.values())
    if expanded(levelled(SMALLEST_LEVEL * largest)) > wanted:  # cannot happen without correlation of exact inputs
        return RequiredImprovement(budget, measurand, wanted, present)
    level = scipy.optimize.brentq(
        lambda x: expanded(levelled(x)) - wanted, SMALLEST_LEVEL * largest, largest, xtol=1e-12 * largest
    )
    ordered = tuple(improved for _, improved in sorted(alone, key=lambda pair: -pair[0]))
    return RequiredImprovement(budget, measurand, wanted, present, ordered, improvement(levelled(level)))


def _expanded_by_first_order(budget: Budget, measurand: Measurand) -> Callable[[dict[str, float]], float]:
    """U (SI) by first order as a function of factors on the inputs' standard uncertainties."""

    def expanded(factors: dict[str, float]) -> float:
        changed = budget.scaled(factors)
        result = propagate(changed, measurand)
        return coverage_factor(changed, result.degrees_of_freedom) * result.first_order

    return expanded


def _expanded_by_draws(budget: Budget, measurand: Measurand) -> Callable[[dict[str, float]], float]:
    """Half of the shortest interval (SI) of the same draws, as a function of factors on the inputs' uncertainties."""
    names = [quantity.name for quantity in budget.inputs]
    function = sympy.lambdify([sympy.Symbol(name, real=True) for name in names], measurand.expression, "numpy")
    inputs = sampler(budget)(np.random.default_rng(INVERSE_SEED), INVERSE_DRAWS)
    deviations = [drawn - value for drawn, value in zip(inputs, budget.values, strict=True)]

    def expanded(factors: dict[str, float]) -> float:
        scaled = [
            value + factors.get(name, 1.0) * deviation
            for name, value, deviation in zip(names, budget.values, deviations, strict=True)
        ]
        ordered = np.sort(np.broadcast_to(np.asarray(function(*scaled), dtype=float), INVERSE_DRAWS))
        inside = round(budget.coverage * INVERSE_DRAWS)
        return float(np.min(ordered[inside:] - ordered[: INVERSE_DRAWS - inside])) / 2

    return expanded


def wanted_uncertainty(text: str, measurand: Measurand, where: str = "budget") -> float:
    """A wanted expanded uncertainty as typed, in SI: a number in the measurand's unit, or with a unit of its own."""
    where = f"{where}: wanted uncertainty"
    parts = text.strip().split(" ", 1)
    unit = measurand.unit if len(parts) == 1 else unit_of(parts[1], where)
    if unit.dimension != measurand.unit.dimension:
        raise InputError(
            where, f"'{text}' has another dimension than {measurand.name}", f"give it in {measurand.unit.text}"
        )
    try:
        number = float(parts[0])
    except ValueError as error:
        wrong = "has a decimal comma" if "," in parts[0] else "is no quantity"
        raise InputError(where, f"'{text}' {wrong}", f"write like 0.5 {measurand.unit.text}") from error
    return unit.difference_to_si(number)


# --- Writing a result as the GUM wants it (7.2.2 to 7.2.6), and the numerical tolerance of JCGM 101 (7.9.2).

FLOAT_DIGITS = 16  # decimal digits that a floating-point number holds
LONGEST_NUMBER = 25  # places before or behind the point; longer numbers are written with an exponent


def numerical_tolerance(uncertainty: float, digits: int) -> float:
    """δ: half a unit of the last of so many significant digits of the uncertainty."""
    if uncertainty == 0 or not math.isfinite(uncertainty):
        return 0.0
    return 0.5 * 10.0 ** _last_place(uncertainty, digits)


def _last_place(uncertainty: float, digits: int) -> int:
    """Exponent of ten of the last significant digit, after rounding (0.0996 to two digits is 0.10)."""
    rounded = Decimal(f"{uncertainty:.{digits - 1}e}")
    return rounded.adjusted() - digits + 1


def to_place(value: float, place: int) -> str:
    """The value rounded to a power of ten, written without exponent.

    Where that would be more digits than a floating-point number has, or than anyone reads, those that it has.
    """
    leading = max(Decimal(repr(float(value))).adjusted(), place)
    if leading - place > FLOAT_DIGITS or max(leading, -place) > LONGEST_NUMBER:
        return f"{value:.15g}" if leading - place > FLOAT_DIGITS else f"{value:.{leading - place}e}"
    step = Decimal(1).scaleb(place)
    rounded = Decimal(repr(float(value))).quantize(step, rounding=ROUND_HALF_EVEN)
    return f"{rounded:f}" if rounded != 0 else f"{abs(rounded):f}"


def written(value: float, uncertainty: float, digits: int = 2) -> tuple[str, str]:
    """Value and uncertainty, the uncertainty to so many significant digits and the value to the same place.

    A value without uncertainty is written in full.
    """
    if uncertainty == 0:
        return f"{value:.15g}", "0"
    place = _last_place(uncertainty, digits)
    return to_place(value, place), to_place(uncertainty, place)


def statement(name: str, value: float, expanded: float, unit: str, k: float, coverage: float) -> str:
    """The complete result: ``M = (1500.00 ± 0.69) N·m, k = 2.00, coverage about 95 %``."""
    y, u = written(value, expanded)
    shown = "" if unit == "1" else f" {printed(unit)}"
    return f"{name} = ({y} ± {u}){shown}, k = {k:.2f}, coverage about {100 * coverage:.4g} %"


# Six parameters of one sentence, all of them numbers and texts to be written.
def interval_statement(
    name: str, value: float, u: float, interval: tuple[float, float], unit: str, coverage: float
) -> str:
    """A result by Monte Carlo: ``y = 0.25 N·m, u = 0.35 N·m, 95 % in 0.00 ... 0.96 N·m (Monte Carlo)``.

    Value and ends of the interval are rounded to the place of the uncertainty's second digit.
    """
    shown = "" if unit == "1" else f" {printed(unit)}"
    place = _last_place(u, 2)
    y, uncertainty, low, high = (to_place(number, place) for number in (value, u, *interval))
    inside = f"{100 * coverage:.4g} % in {low} ... {high}{shown}"
    return f"{name} = {y}{shown}, u = {uncertainty}{shown}, {inside} (Monte Carlo)"


# --- The Monte Carlo method of JCGM 101: adaptive, seeded, on all cores; of every chunk of draws a summary is kept.

FEWEST_CHUNKS = 10  # from whose scatter it is told what the draws leave uncertain
MOST_DRAWS = 2_000_000  # draws until the result is stable
MOST_TO_DECIDE = 10_000_000  # draws until a question to the result is decided as well, some seconds
WIDEST_DRAWS = 1e150  # of wider ones the sum of squares over all draws is no floating-point number
QUESTION_GROWTH = 1.25  # the question is asked again when there are so many times the draws


@dataclass(frozen=True)
class MonteCarlo:
    """Expectation, standard uncertainty and coverage intervals by Monte Carlo, in SI.

    ``spread`` (4,) is twice the standard deviation, over the chunks, of the averages of (value, uncertainty, low end,
    high end): what the draws leave uncertain (JCGM 101, 7.9.4). ``stable`` says that all four are within the
    numerical tolerance.
    """

    value: float
    standard_uncertainty: float
    shortest: tuple[float, float]
    symmetric: tuple[float, float]
    coverage: float
    draws: int
    seed: int
    stable: bool
    tolerance: float
    spread: np.ndarray

    def to_dict(self, unit: Unit) -> dict[str, Any]:
        """As ``uncertainty.json`` holds it, in a unit."""
        return {
            "value": unit.value_from_si(self.value),
            "standard_uncertainty": unit.difference_from_si(self.standard_uncertainty),
            "shortest_interval": [unit.value_from_si(end) for end in self.shortest],
            "symmetric_interval": [unit.value_from_si(end) for end in self.symmetric],
            "draws": self.draws,
            "seed": self.seed,
            "stable": self.stable,
        }


def monte_carlo(
    budget: Budget,
    measurand: Measurand,
    *,
    seed: int = 1,
    draws: int | None = None,
    digits: int = 2,
    most: int = MOST_DRAWS,
    workers: int | None = None,
    undecided: Callable[[MonteCarlo], bool] | None = None,
) -> MonteCarlo:  # what is drawn, and when there are enough draws
    """The distribution of the measurand by propagating those of the inputs.

    Parameters
    ----------
    draws : int, optional
        So many draws; without it, chunk after chunk until value, uncertainty and both ends of the interval are stable
        to ``digits`` significant digits of the uncertainty (JCGM 101, 7.9), ``most`` at the most.
    undecided : function, optional
        Whether a stable result leaves a question open: then more is drawn, :data:`MOST_TO_DECIDE` at the most.
    seed : int
        The same seed gives the same result, however many ``workers`` (threads) there are.
    """
    chunk = max(math.ceil(100 / (1 - budget.coverage)), 10_000)
    limit = max(2, math.ceil((draws or (MOST_TO_DECIDE if undecided else most)) / chunk))
    values = _drawn_values(budget, measurand, seed, chunk)
    workers = workers or min(os.cpu_count() or 1, 8)
    rows: list[tuple[float, ...]] = []

    def result() -> MonteCarlo:
        return _result(budget.coverage, np.array(rows), chunk, seed, digits)

    next_question = 0.0
    with ThreadPoolExecutor(workers) as pool:
        for first in range(0, limit, 4 * workers):  # waves bound what is in memory at a time
            places = range(first, min(first + 4 * workers, limit))
            for row in pool.map(lambda place: _summary(values(place), budget.coverage), places):
                rows.append(row)
                if draws is not None or len(rows) < max(FEWEST_CHUNKS, next_question):
                    continue
                if (now := result()).stable:
                    if undecided is None or not undecided(now):
                        return now
                    next_question = QUESTION_GROWTH * len(rows)
    return result()


CORRELATION_DRAWS = 1_000_000  # they leave 0.001 of a correlation open, 0.003 for readings with 4 degrees of freedom


def drawn_correlation(budget: Budget, measurands: Sequence[Measurand], seed: int = 1) -> np.ndarray:
    """Correlation of the measurands (measurands, measurands) by joint draws of all inputs (JCGM 102, 7.6)."""
    chunk = 10_000
    values = [_drawn_values(budget, measurand, seed, chunk) for measurand in measurands]
    count, size = CORRELATION_DRAWS // chunk, len(measurands)
    means, products = np.zeros(size), np.zeros((size, size))
    shift = np.array([value(0).mean() for value in values])  # of large values the products would lose all digits
    for place in range(count):
        drawn = np.stack([value(place) for value in values]) - shift[:, None]
        means += drawn.mean(axis=1) / count
        products += drawn @ drawn.T / (chunk * count)
    covariance = products - np.outer(means, means)
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.clip(covariance / np.outer(u, u), -1.0, 1.0)
    return np.where(np.outer(u, u) > 0, correlation, np.eye(size))


NO_SHARE = 1e-4  # of the variance: less is what the draws leave open
SHARE_DRAWS = 200_000  # the same for every input, so that a share is known far better than each variance (0.3 %)


def drawn_shares(budget: Budget, measurand: Measurand, seed: int = 1) -> np.ndarray:
    """By how much (inputs,) the variance of the drawn values would fall, relatively, if one input were known exactly.

    What the first order calls shares of u² means nothing where that order does not hold: its sensitivity may vanish.
    """
    function, draw = _function(budget, measurand), sampler(budget)
    generator = np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=(0,))))
    drawn = [np.asarray(values) for values in draw(generator, SHARE_DRAWS)]

    def variance(exact: int | None) -> float:
        known = [np.full_like(x, q.value) if i == exact else x for i, (x, q) in enumerate(zip(drawn, budget.inputs))]
        with np.errstate(all="ignore"):
            return float(np.var(np.broadcast_to(np.asarray(function(*known), float), (SHARE_DRAWS,))))

    whole = variance(None)
    shares = [
        1 - variance(place) / whole if quantity.standard_uncertainty > 0 and whole > 0 else 0.0
        for place, quantity in enumerate(budget.inputs)
    ]
    return np.where(np.abs(shares) < NO_SHARE, 0.0, shares)


def _summary(y: np.ndarray, coverage: float) -> tuple[float, ...]:
    """Of a chunk of values (count,): mean, standard deviation, ends of the shortest and of the symmetric interval."""
    ordered, tail = np.sort(y), (1 - coverage) / 2
    symmetric = np.quantile(ordered, [tail, 1 - tail])
    return float(y.mean()), float(y.std(ddof=1)), *_shortest(ordered, coverage), *map(float, symmetric)


def _function(budget: Budget, measurand: Measurand) -> Callable[..., Any]:
    """The measurand as a function of arrays of its inputs."""
    symbols = [sympy.Symbol(quantity.name, real=True) for quantity in budget.inputs]
    return sympy.lambdify(symbols, measurand.expression, "numpy", cse=True)  # type: ignore[no-any-return]


def _drawn_values(budget: Budget, measurand: Measurand, seed: int, count: int) -> Callable[[int], np.ndarray]:
    """The measurand's values (count,) of the chunk at a place; each place has random numbers of its own."""
    function, draw = _function(budget, measurand), sampler(budget)

    def values(place: int) -> np.ndarray:
        generator = np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=(place,))))
        with np.errstate(all="ignore"):
            y = np.broadcast_to(np.asarray(function(*draw(generator, count)), dtype=float), (count,))
        if not np.all(np.isfinite(y)):
            raise InputError(
                f"{budget.where}: measurand {measurand.name}.formula",
                f"has no finite real value for {np.count_nonzero(~np.isfinite(y))} of {count} draws",
                "narrow an input or correct it",
            )
        if max(abs(y.max()), abs(y.min())) > LARGEST_VALUE or y.max() - y.min() > WIDEST_DRAWS:
            raise too_large(budget, measurand)
        return y

    return values


def _result(coverage: float, rows: np.ndarray, count: int, seed: int, digits: int) -> MonteCarlo:
    """From the summaries (chunks, 6) of chunks of ``count`` draws.

    Ends of intervals are averages over the chunks, whose scatter is known. Where the shortest interval of all draws
    lies is decided by where its flat minimum happens to be, and scatters more with n^(−1/3).
    """
    chunks, draws = len(rows), len(rows) * count
    means, deviations = rows[:, 0], rows[:, 1]
    squares = (count - 1) * np.sum(deviations**2) + count * np.sum((means - means.mean()) ** 2)
    uncertainty = math.sqrt(squares / (draws - 1))
    low, high, symmetric_low, symmetric_high = rows[:, 2:].mean(axis=0).tolist()
    spread = 2 * rows[:, :4].std(axis=0, ddof=1) / math.sqrt(chunks)
    tolerance = numerical_tolerance(uncertainty, digits)
    return MonteCarlo(
        float(means.mean()), uncertainty, (low, high), (symmetric_low, symmetric_high), coverage, draws, seed,
        uncertainty == 0 or bool(np.all(spread < tolerance)), tolerance, spread,
    )  # fmt: skip


def _shortest(ordered: np.ndarray, coverage: float) -> tuple[float, float]:
    held = round(coverage * len(ordered))
    widths = ordered[held:] - ordered[: len(ordered) - held]
    start = int(np.argmin(widths))
    return float(ordered[start]), float(ordered[start + held])
