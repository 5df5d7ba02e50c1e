"""The inverse: for a wanted expanded uncertainty, which input must improve, and to what."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
import sympy

from matching.validity.budget.budget import Budget, Measurand
from matching.validity.uncertainty.draws import sampler
from matching.validity.uncertainty.propagate import coverage_factor, propagate
from modelling.common.errors import InputError
from modelling.units import unit_of

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

    Raises
    ------
    InputError
        If ``wanted`` is not above 0.
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
    """A wanted expanded uncertainty as typed, in SI: a number in the measurand's unit, or with a unit of its own.

    Raises
    ------
    InputError
        If it is no quantity, or of another dimension.
    """
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
        raise InputError(where, f"'{text}' is no quantity", f"write like 0.5 {measurand.unit.text}") from error
    return unit.difference_to_si(number)
