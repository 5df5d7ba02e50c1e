"""Inverse use: given a wanted expanded uncertainty, which input must improve, and to what."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from scipy.optimize import brentq

from matching.validity.uncertainty.budget import Budget, Measurand
from matching.validity.uncertainty.propagate import coverage_factor, propagate
from modelling.common.errors import InputError
from modelling.units import unit_of


@dataclass(frozen=True)
class Improvement:
    """Standard uncertainties (SI) by input name that together reach the wanted expanded uncertainty."""

    needed: dict[str, float]
    reached: float


@dataclass(frozen=True)
class Inverse:
    """``alone``: each input whose improvement alone suffices, easiest (largest permitted ratio) first.
    ``together``: the least set of the largest contributions, all brought down to one level; None when none is needed.
    """

    wanted: float
    present: float
    alone: tuple[Improvement, ...]
    together: Improvement | None


def required(budget: Budget, measurand: Measurand, wanted: float) -> Inverse:
    """What must improve for an expanded uncertainty of ``wanted`` (SI), first order; degrees of freedom stay.

    Every answer is re-evaluated with the whole budget: k moves with the effective degrees of freedom.
    """
    if not wanted > 0 or not math.isfinite(wanted):
        raise InputError(f"{budget.where}: wanted uncertainty", f"{wanted:g} is not possible", "give a number above 0")

    def expanded(factors: dict[str, float]) -> float:
        changed = budget.scaled(factors)
        result = propagate(changed, measurand)
        return coverage_factor(changed, result.degrees_of_freedom) * result.first_order

    def improvement(factors: dict[str, float]) -> Improvement:
        u = {one.name: one.standard_uncertainty for one in budget.inputs}
        return Improvement(
            {name: u[name] * factor for name, factor in factors.items() if factor < 1}, expanded(factors)
        )

    present = expanded({})
    if present <= wanted:
        return Inverse(wanted, present, (), None)
    alone: list[tuple[float, Improvement]] = []
    first = propagate(budget, measurand)
    parts = {
        one.name: abs(c) * one.standard_uncertainty for one, c in zip(budget.inputs, first.sensitivities, strict=True)
    }
    for name, part in parts.items():
        # At exactly zero the input would leave the degrees of freedom too; a millionth is as good as perfect.
        if part > 0 and expanded({name: 1e-6}) <= wanted:
            factor = brentq(lambda x, name=name: expanded({name: x}) - wanted, 1e-6, 1.0, xtol=1e-12)
            alone.append((factor, improvement({name: factor})))

    def levelled(level: float) -> dict[str, float]:
        return {name: min(1.0, level / part) for name, part in parts.items() if part > 0}

    most = max(parts.values())
    if expanded(levelled(1e-9 * most)) > wanted:  # cannot happen without correlation of exact inputs
        return Inverse(wanted, present, (), None)
    level = brentq(lambda x: expanded(levelled(x)) - wanted, 1e-9 * most, most, xtol=1e-12 * most)
    ordered = tuple(answer for _, answer in sorted(alone, key=lambda pair: -pair[0]))
    return Inverse(wanted, present, ordered, improvement(levelled(level)))


def inverse_as_json(budget: Budget, measurand: Measurand, wanted: str) -> dict[str, Any]:
    """The answer for a wanted U as typed: a number in the measurand's unit, or a text with a unit of its own."""
    where = f"{budget.where}: wanted uncertainty"
    amount = wanted.strip().split(" ", 1)
    unit = measurand.unit if len(amount) == 1 else unit_of(amount[1], where)
    if unit.dimension != measurand.unit.dimension:
        raise InputError(
            where, f"'{wanted}' has another dimension than {measurand.name}", f"give it in {measurand.unit.text}"
        )
    try:
        number = float(amount[0])
    except ValueError as error:
        raise InputError(where, f"'{wanted}' is no quantity", f"write like 0.5 {measurand.unit.text}") from error
    answer = required(budget, measurand, unit.difference_to_si(number))
    inputs = {one.name: one for one in budget.inputs}

    def step(improvement: Improvement | None) -> dict[str, Any]:
        needed = improvement.needed if improvement else {}
        return {
            name: {
                "needed": inputs[name].unit.difference_from_si(u),
                "unit": inputs[name].unit.text,
                "ratio": u / inputs[name].standard_uncertainty,
            }
            for name, u in needed.items()
        }

    return {
        "name": measurand.name,
        "unit": measurand.unit.text,
        "wanted": measurand.unit.difference_from_si(answer.wanted),
        "present": measurand.unit.difference_from_si(answer.present),
        "alone": [step(one) for one in answer.alone],
        "together": step(answer.together),
    }
