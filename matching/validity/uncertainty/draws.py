"""Joint draws of all inputs for the Monte Carlo method (JCGM 101, 6.4), chunk by chunk."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from matching.validity.uncertainty.budget import Budget
from matching.validity.uncertainty.distributions import Distribution
from modelling.errors import InputError

Draw = Callable[[np.random.Generator, int], dict[int, np.ndarray]]


def sampler(budget: Budget) -> Callable[[np.random.Generator, int], list]:
    """A function (generator, count) → one array ``(count,)`` an input, or its number where it is exactly known.

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
    from scipy.sparse.csgraph import connected_components

    uncertain = np.flatnonzero(budget.standard_uncertainties > 0)
    if not uncertain.size:
        return []
    count, labels = connected_components(budget.correlation[np.ix_(uncertain, uncertain)] != 0, directed=False)
    return [[int(i) for i in uncertain[labels == label]] for label in range(count)]


def _block(budget: Budget, members: list[int]) -> Draw:
    u = budget.standard_uncertainties[members]
    if len(members) == 1:
        shape, scale, only = budget.inputs[members[0]].distribution, u[0], members[0]

        def independent(generator, count):
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


def _multivariate_t(members, u, correlation, freedom: float) -> Draw:
    root = u[:, None] * _root(correlation)

    def draw(generator, count):
        deviations = root @ generator.standard_normal((len(members), count))
        if math.isfinite(freedom):
            deviations /= np.sqrt(generator.chisquare(freedom, count) / freedom)
        return dict(zip(members, deviations, strict=True))

    return draw


def _copula(members, u, shapes: list[Distribution], correlation) -> Draw:
    from scipy.special import ndtr

    root, laws = _root(correlation), [shape.law() for shape in shapes]

    def draw(generator, count):
        normal = root @ generator.standard_normal((len(members), count))
        return {i: scale * (row if shape.name == "normal" else law.ppf(ndtr(row)))
                for i, scale, row, shape, law in zip(members, u, normal, shapes, laws, strict=True)}

    return draw


def _copula_correlation(correlation, shapes: list[Distribution], where: str) -> np.ndarray:
    """Coefficients of the normals behind the copula, by Gauss–Hermite quadrature and a root search for each pair."""
    from scipy.optimize import brentq
    from scipy.special import ndtr

    nodes, weights = np.polynomial.hermite_e.hermegauss(80)
    weights = weights / weights.sum()
    scores = []
    for shape in shapes:
        law = shape.law()
        scores.append(lambda z, law=law: law.ppf(ndtr(z)) / law.std())
    result = np.eye(len(shapes))
    for i in range(len(shapes)):
        for j in range(i):
            first = scores[i](nodes)

            def reached(r, j=j, first=first):
                second = scores[j](r * nodes[:, None] + math.sqrt(1 - r * r) * nodes[None, :])
                return float(weights @ (first[:, None] * second) @ weights)

            wanted = correlation[i, j]
            if wanted == 0:
                continue
            if not reached(-1.0) - 1e-3 <= wanted <= reached(1.0) + 1e-3:
                raise InputError(where, f"r = {wanted:g} cannot be reached between a {shapes[i].name} and a "
                                 f"{shapes[j].name} input", f"it lies in {reached(-1.0):.3f} ... {reached(1.0):.3f}")
            inside = reached(-1.0) < wanted < reached(1.0)
            result[i, j] = result[j, i] = brentq(lambda r: reached(r) - wanted, -1, 1) if inside else np.sign(wanted)
    if np.linalg.eigvalsh(result).min() < -1e-6:
        raise InputError(where, "these shapes cannot have these correlations together", "lower the coefficients")
    return result
