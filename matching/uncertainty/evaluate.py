"""A budget evaluated: first order, second order, Monte Carlo, the check of one by the other, and the budget table."""

from __future__ import annotations

import math

import numpy as np

from matching.uncertainty.budget import Budget, Measurand
from matching.uncertainty.propagate import (
    MonteCarlo,
    Propagation,
    coverage_factor,
    drawn_correlation,
    drawn_shares,
    monte_carlo,
    numerical_tolerance,
    output_correlation,
    propagate,
    required,
    wanted_uncertainty,
)
from matching.uncertainty.result import MeasurandResult, PropagationValidation, Row, Uncertainty

SHARPER = 5.0  # times the numerical tolerance of the check, that of the draws must be (JCGM 101, 8.2)
ROUNDING = 1e-12  # of value and contributions: what floating-point arithmetic leaves of a difference that is none


def evaluate(
    budget: Budget,
    *,
    seed: int = 1,
    draws: int | None = None,
    digits: int = 2,
    with_monte_carlo: bool = True,
    wanted: str | None = None,
) -> Uncertainty:
    """Every measurand's result; with a ``wanted`` expanded uncertainty, also what has to improve for it.

    See :func:`evaluate_measurand` for the other parameters.
    """
    results = tuple(
        evaluate_measurand(budget, measurand, seed=seed, draws=draws, digits=digits, with_monte_carlo=with_monte_carlo)
        for measurand in budget.measurands
    )
    inverse = (
        ()
        if wanted is None
        else tuple(
            required(
                budget, result.measurand, wanted_uncertainty(wanted, result.measurand, budget.where), result.method
            )
            for result in results
        )
    )
    if len(results) > 1 and any(result.method == "monte_carlo" for result in results):
        correlation, by = drawn_correlation(budget, budget.measurands, seed), "monte_carlo"
    else:
        correlation, by = output_correlation(budget, [result.propagation for result in results]), "first_order"
    return Uncertainty(budget, results, correlation, inverse, by)


def evaluate_measurand(
    budget: Budget,
    measurand: Measurand,
    *,
    seed: int,
    draws: int | None,
    digits: int,
    with_monte_carlo: bool,
) -> MeasurandResult:
    """One measurand's result; see ``monte_carlo`` for the arguments."""
    first = propagate(budget, measurand)
    k = coverage_factor(budget, first.degrees_of_freedom)
    drawn = check = second = None
    if with_monte_carlo:
        parts = float(np.sum(np.abs(first.sensitivities) * budget.standard_uncertainties))
        rounding = ROUNDING * (abs(first.value) + parts)

        def checked(drawn: MonteCarlo, u: float) -> PropagationValidation:
            return compare(first.value, k * u, u, drawn, digits, rounding)

        def undecided(drawn: MonteCarlo) -> bool:
            return checked(drawn, first.first_order).verdict == "open"

        drawn = monte_carlo(budget, measurand, seed=seed, draws=draws, digits=digits, undecided=undecided)
        check = checked(drawn, first.first_order)
        if math.isfinite(first.second_order):
            second = checked(drawn, first.second_order)
    return MeasurandResult(
        measurand,
        first,
        k,
        budget.coverage,
        k * first.first_order,
        _rows(
            budget, first, None if check is None or check.verdict == "good" else drawn_shares(budget, measurand, seed)
        ),
        drawn,
        check,
        second,
        tuple(_warnings(budget, first, drawn, check)),
    )


def compare(
    value: float, expanded: float, uncertainty: float, drawn: MonteCarlo, digits: int, rounding: float = 0.0
) -> PropagationValidation:
    """The check of JCGM 101, 8.1: d_low and d_high against δ of the propagated uncertainty.

    A symmetric interval about the estimate is compared with the shortest interval of the draws. The verdict stands as
    soon as what the draws leave uncertain of the interval cannot change it, or is no more than δ/5 (8.2). Differences
    below ``rounding`` (SI) are those of floating-point numbers: exact results agree.
    """
    tolerance = max(numerical_tolerance(uncertainty or drawn.standard_uncertainty, digits), rounding)
    distances = (abs(value - expanded - drawn.shortest[0]), abs(value + expanded - drawn.shortest[1]))
    doubt = drawn.spread[2:]
    if float(np.max(doubt)) <= tolerance / SHARPER:
        doubt = np.zeros(2)
    if any(distance - spread > tolerance for distance, spread in zip(distances, doubt, strict=True)):
        verdict = "not good"
    elif all(distance + spread <= tolerance for distance, spread in zip(distances, doubt, strict=True)):
        verdict = "good"
    else:
        verdict = "open"
    return PropagationValidation(distances, tolerance, verdict)


def _rows(budget: Budget, first: Propagation, by_draws: np.ndarray | None) -> tuple[Row, ...]:
    """Rows of the budget; ``by_draws`` are the shares (inputs,) where the first order does not hold."""
    parts = first.sensitivities * budget.standard_uncertainties
    shares = parts * (budget.correlation @ parts) + 0.0  # no negative zeros
    total = shares.sum() or 1.0
    if by_draws is not None and np.isfinite(by_draws).all():
        shares, total = by_draws, 1.0
    rows = [
        Row(
            quantity.name,
            quantity.value,
            quantity.standard_uncertainty,
            float(c),
            float(abs(part)),
            float(share / total),
            quantity.degrees_of_freedom,
            quantity.cause,
            quantity.distribution.name if quantity.standard_uncertainty > 0 else "exact",
        )
        for quantity, c, part, share in zip(budget.inputs, first.sensitivities, parts, shares, strict=True)
    ]
    return tuple(sorted(rows, key=lambda row: -abs(row.share)))


def _warnings(
    budget: Budget, first: Propagation, drawn: MonteCarlo | None, check: PropagationValidation | None
) -> list[str]:
    warnings = []
    if first.refusal and budget.coverage_factor is None:
        warnings.append(
            f"effective degrees of freedom refused: {first.refusal}; k takes them as infinite, prefer the "
            "Monte Carlo interval"
        )
    if math.isfinite(first.second_order) and first.second_order > 1.05 * first.first_order:
        warnings.append(
            "the second-order terms raise the standard uncertainty by more than 5 %: first order is too small"
        )
    if not math.isfinite(first.second_order):
        warnings.append("the formula has a kink or no second derivative at the estimates: rely on the Monte Carlo")
    if drawn is not None and not drawn.stable:
        warnings.append(f"the Monte Carlo result is not yet stable after {drawn.draws} draws: ask for more")
    if check is not None and check.verdict == "not good":
        warnings.append("JCGM 101 check: first order is not good enough here, so the Monte Carlo result is stated")
    if check is not None and check.verdict == "open":
        warnings.append(
            "JCGM 101 check: the draws do not decide whether first order is good enough, so the Monte Carlo result is "
            "stated; more --draws may decide it"
        )
    if any(quantity.distribution.name == "t" and quantity.degrees_of_freedom <= 2 for quantity in budget.inputs):
        warnings.append(
            "an input has two degrees of freedom or fewer: its t distribution has no variance, so only the "
            "Monte Carlo interval means something, not its standard uncertainty"
        )
    return warnings
