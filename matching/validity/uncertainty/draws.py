"""Joint draws of all inputs for the Monte Carlo method (JCGM 101, 6.4), chunk by chunk."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import scipy
from scipy.sparse.csgraph import connected_components
from scipy.special import ndtr

from matching.validity.budget.budget import Budget
from matching.validity.budget.distributions import Distribution
from modelling.common.errors import InputError

Draw = Callable[[np.random.Generator, int], dict[int, np.ndarray]]


def sampler(budget: Budget) -> Callable[[np.random.Generator, int], list]:
    """A function (generator, count) → for every input an array (count,) of draws, or its number where it is exact.

    Independent inputs are drawn from their own shapes; simultaneous readings from the multivariate t whose marginals
    are those of JCGM 101, 6.4.9; correlated normal inputs from the multivariate normal; other correlated shapes from
    a normal copula whose coefficients are chosen so that the inputs have the correlation asked for.

    Raises
    ------
    InputError
        If these shapes cannot have these correlations.
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
