"""A budget evaluated: first order, second order, Monte Carlo, the check of one by the other, and the budget table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from matching.validity.uncertainty.budget import Budget, Measurand
from matching.validity.uncertainty.montecarlo import MonteCarlo, monte_carlo
from matching.validity.uncertainty.propagate import Propagation, coverage_factor, output_correlation, propagate
from matching.validity.uncertainty.rounding import numerical_tolerance, statement
from modelling.units import Unit


@dataclass(frozen=True)
class Check:
    """JCGM 101, 8: do the ends of the interval by propagation agree with those by Monte Carlo?

    ``distances`` are d_low and d_high in SI, ``tolerance`` is δ. ``verdict`` is "good", "not good" or "open"; open
    when the draws leave more uncertain than the difference to δ.
    """

    distances: tuple[float, float]
    tolerance: float
    verdict: str


@dataclass(frozen=True)
class Row:
    """A line of the budget table; all in SI but ``share``, its part of the variance (negative parts by correlation)."""

    name: str
    value: float
    standard_uncertainty: float
    sensitivity: float
    contribution: float
    share: float
    degrees_of_freedom: float
    cause: str
    distribution: str


@dataclass(frozen=True)
class Result:
    """One measurand's result. ``expanded`` is k times the first-order uncertainty, in SI."""

    measurand: Measurand
    propagation: Propagation
    coverage_factor: float
    coverage: float
    expanded: float
    rows: tuple[Row, ...]
    monte_carlo: MonteCarlo | None
    check: Check | None
    check_second_order: Check | None
    warnings: tuple[str, ...]

    @property
    def statement(self) -> str:
        """The complete result in the unit of the budget, as GUM 7.2 wants it written."""
        unit = self.measurand.unit
        return statement(
            self.measurand.name,
            unit.value_from_si(self.propagation.value),
            unit.difference_from_si(self.expanded),
            unit.text,
            self.coverage_factor,
            self.coverage,
        )


def evaluate(
    budget: Budget, *, seed: int = 1, draws: int | None = None, digits: int = 2, with_monte_carlo: bool = True
) -> tuple[list[Result], np.ndarray]:
    """Every measurand's result and their correlation matrix."""
    results = [
        evaluate_measurand(budget, measurand, seed=seed, draws=draws, digits=digits, with_monte_carlo=with_monte_carlo)
        for measurand in budget.measurands
    ]
    return results, output_correlation(budget, [one.propagation for one in results])


def evaluate_measurand(
    budget: Budget,
    measurand: Measurand,
    *,
    seed: int = 1,
    draws: int | None = None,
    digits: int = 2,
    with_monte_carlo: bool = True,
) -> Result:
    """One measurand's result; see ``monte_carlo`` for the arguments."""
    first = propagate(budget, measurand)
    k = coverage_factor(budget, first.degrees_of_freedom)
    drawn = check = second = None
    if with_monte_carlo:
        drawn = monte_carlo(budget, measurand, seed=seed, draws=draws, digits=digits)
        check = compare(first.value, k * first.first_order, first.first_order, drawn, digits)
        if math.isfinite(first.second_order):
            second = compare(first.value, k * first.second_order, first.second_order, drawn, digits)
    return Result(
        measurand,
        first,
        k,
        budget.coverage,
        k * first.first_order,
        _rows(budget, first),
        drawn,
        check,
        second,
        tuple(_warnings(budget, first, drawn, check)),
    )


def compare(value: float, expanded: float, uncertainty: float, drawn: MonteCarlo, digits: int) -> Check:
    """The check of JCGM 101, 8.1: d_low and d_high against δ of the propagated uncertainty.

    A symmetric interval about the estimate is compared with the shortest interval of the draws.
    """
    tolerance = numerical_tolerance(uncertainty or drawn.standard_uncertainty, digits)
    distances = (abs(value - expanded - drawn.shortest[0]), abs(value + expanded - drawn.shortest[1]))
    doubt = drawn.spread[2:]
    if any(distance - spread > tolerance for distance, spread in zip(distances, doubt, strict=True)):
        verdict = "not good"
    elif all(distance + spread <= tolerance for distance, spread in zip(distances, doubt, strict=True)):
        verdict = "good"
    else:
        verdict = "open"
    return Check(distances, tolerance, verdict)


def _rows(budget: Budget, first: Propagation) -> tuple[Row, ...]:
    parts = first.sensitivities * budget.standard_uncertainties
    shares = parts * (budget.correlation @ parts) + 0.0  # no negative zeros
    total = shares.sum() or 1.0
    rows = [
        Row(
            one.name,
            one.value,
            one.standard_uncertainty,
            float(c),
            float(abs(part)),
            float(share / total),
            one.degrees_of_freedom,
            one.cause,
            one.distribution.name if one.standard_uncertainty > 0 else "exact",
        )
        for one, c, part, share in zip(budget.inputs, first.sensitivities, parts, shares, strict=True)
    ]
    return tuple(sorted(rows, key=lambda row: -abs(row.share)))


def _warnings(budget: Budget, first: Propagation, drawn: MonteCarlo | None, check: Check | None) -> list[str]:
    found = []
    if first.refusal and budget.coverage_factor is None:
        found.append(
            f"effective degrees of freedom refused: {first.refusal}; k takes them as infinite, prefer the "
            "Monte Carlo interval"
        )
    if math.isfinite(first.second_order) and first.second_order > 1.05 * first.first_order:
        found.append("the second-order terms raise the standard uncertainty by more than 5 %: first order is too small")
    if not math.isfinite(first.second_order):
        found.append("the formula has a kink or no second derivative at the estimates: rely on the Monte Carlo")
    if drawn is not None and not drawn.stable:
        found.append(f"the Monte Carlo result is not yet stable after {drawn.draws} draws: ask for more")
    if check is not None and check.verdict == "not good":
        found.append("JCGM 101 check: first order is not good enough here, use the Monte Carlo interval")
    if any(one.distribution.name == "t" and one.degrees_of_freedom <= 2 for one in budget.inputs):
        found.append(
            "an input has two degrees of freedom or fewer: its t distribution has no variance, so only the "
            "Monte Carlo interval means something, not its standard uncertainty"
        )
    return found


def as_json(budget: Budget, results: list[Result], correlation: np.ndarray) -> dict[str, Any]:
    """The result object of ``uncertainty.json``, in the units of the budget file."""
    return {
        "title": budget.title,
        "measurands": [_one_as_json(budget, one) for one in results],
        "correlation": correlation.tolist(),
    }


def _one_as_json(budget: Budget, result: Result) -> dict[str, Any]:
    unit, first, drawn = result.measurand.unit, result.propagation, result.monte_carlo
    units = {one.name: one.unit for one in budget.inputs}
    freedom = first.degrees_of_freedom
    table = [
        {
            "name": row.name,
            "value": units[row.name].value_from_si(row.value),
            "standard_uncertainty": units[row.name].difference_from_si(row.standard_uncertainty),
            "unit": units[row.name].text,
            "distribution": row.distribution,
            "cause": row.cause,
            "degrees_of_freedom": _finite(row.degrees_of_freedom),
            "sensitivity": row.sensitivity * units[row.name].scale / unit.scale,
            "contribution": unit.difference_from_si(row.contribution),
            "share": row.share,
        }
        for row in result.rows
    ]
    answer = {
        "name": result.measurand.name,
        "statement": result.statement,
        "unit": unit.text,
        "value": unit.value_from_si(first.value),
        "expanded_uncertainty": unit.difference_from_si(result.expanded),
        "coverage_factor": result.coverage_factor,
        "coverage": result.coverage,
        "standard_uncertainty": unit.difference_from_si(first.first_order),
        "standard_uncertainty_second_order": _finite(unit.difference_from_si(first.second_order)),
        "bias_second_order": _finite(unit.difference_from_si(first.bias)),
        "degrees_of_freedom": None if freedom is None else _finite(freedom),
        "degrees_of_freedom_refused": first.refusal or None,
        "budget": table,
        "warnings": list(result.warnings),
    }
    if drawn is not None:
        answer["monte_carlo"] = {
            "value": unit.value_from_si(drawn.value),
            "standard_uncertainty": unit.difference_from_si(drawn.standard_uncertainty),
            "shortest_interval": [unit.value_from_si(end) for end in drawn.shortest],
            "symmetric_interval": [unit.value_from_si(end) for end in drawn.symmetric],
            "draws": drawn.draws,
            "seed": drawn.seed,
            "stable": drawn.stable,
        }
        answer["first_order_check"] = _check_as_json(result.check, unit)
        answer["second_order_check"] = _check_as_json(result.check_second_order, unit)
    return answer


def _check_as_json(check: Check | None, unit: Unit) -> dict[str, Any] | None:
    if check is None:
        return None
    return {
        "verdict": check.verdict,
        "distances": [unit.difference_from_si(one) for one in check.distances],
        "tolerance": unit.difference_from_si(check.tolerance),
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
