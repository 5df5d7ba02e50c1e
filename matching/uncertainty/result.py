"""The result of ``rigmatch uncertainty``: a budget evaluated, with the result and the table of each measurand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from matching.uncertainty.budget import Budget, Measurand
from matching.uncertainty.propagate import MonteCarlo, Propagation, RequiredImprovement, interval_statement, statement
from modelling.display import Displayed
from modelling.units import Unit


@dataclass(frozen=True)
class PropagationValidation:
    """The validation of JCGM 101, 8: whether the interval by propagation agrees with that by Monte Carlo.

    Attributes
    ----------
    distances : tuple of float
        d_low and d_high, SI.
    tolerance : float
        δ, SI.
    verdict : str
        ``"good"``, ``"not good"``, or ``"open"`` where the draws leave more uncertain than the difference to δ.
    """

    distances: tuple[float, float]
    tolerance: float
    verdict: str

    def to_dict(self, unit: Unit) -> dict[str, Any]:
        """As ``uncertainty.json`` holds it, in a unit."""
        return {
            "verdict": self.verdict,
            "distances": [unit.difference_from_si(distance) for distance in self.distances],
            "tolerance": unit.difference_from_si(self.tolerance),
        }


@dataclass(frozen=True)
class Row:
    """A row of the budget table, in SI.

    ``share`` is the input's part of the variance by first order (negative by correlation); of a result by Monte Carlo
    it is what the variance would lose if this input were known exactly.
    """

    name: str
    value: float
    standard_uncertainty: float
    sensitivity: float
    contribution: float
    share: float
    degrees_of_freedom: float
    cause: str
    distribution: str

    def to_dict(self, own_unit: Unit, unit: Unit) -> dict[str, Any]:
        """As ``uncertainty.json`` holds it, in the units of the input and of the measurand."""
        return {
            "name": self.name,
            "value": own_unit.value_from_si(self.value),
            "standard_uncertainty": own_unit.difference_from_si(self.standard_uncertainty),
            "unit": own_unit.text,
            "distribution": self.distribution,
            "cause": self.cause,
            "degrees_of_freedom": finite_or_none(self.degrees_of_freedom),
            "sensitivity": self.sensitivity * own_unit.scale / unit.scale,
            "contribution": unit.difference_from_si(self.contribution),
            "share": self.share,
        }


@dataclass(frozen=True)
class MeasurandResult:
    """One measurand's result; ``expanded`` is k times the first-order uncertainty, SI."""

    measurand: Measurand
    propagation: Propagation
    coverage_factor: float
    coverage: float
    expanded: float
    rows: tuple[Row, ...]
    monte_carlo: MonteCarlo | None
    check: PropagationValidation | None
    check_second_order: PropagationValidation | None
    warnings: tuple[str, ...]

    @property
    def method(self) -> str:
        """``"first_order"`` unless the check of JCGM 101 rejects it or leaves it open: then ``"monte_carlo"``."""
        return "monte_carlo" if self.check is not None and self.check.verdict != "good" else "first_order"

    @property
    def statement(self) -> str:
        """The complete result in the unit of the budget, as GUM 7.2 wants it written, by :attr:`method`."""
        unit = self.measurand.unit
        if self.method == "monte_carlo" and self.monte_carlo is not None:
            drawn = self.monte_carlo
            return interval_statement(
                self.measurand.name,
                unit.value_from_si(drawn.value),
                unit.difference_from_si(drawn.standard_uncertainty),
                (unit.value_from_si(drawn.shortest[0]), unit.value_from_si(drawn.shortest[1])),
                unit.text,
                self.coverage,
            )
        return statement(
            self.measurand.name,
            unit.value_from_si(self.propagation.value),
            unit.difference_from_si(self.expanded),
            unit.text,
            self.coverage_factor,
            self.coverage,
        )

    def to_dict(self, units: dict[str, Unit]) -> dict[str, Any]:
        """As ``uncertainty.json`` holds it; ``units`` are those of the inputs by name."""
        unit, first = self.measurand.unit, self.propagation
        freedom = first.degrees_of_freedom
        content = {
            "name": self.measurand.name,
            "statement": self.statement,
            "method": self.method,
            "unit": unit.text,
            "value": unit.value_from_si(first.value),
            "expanded_uncertainty": unit.difference_from_si(self.expanded),
            "coverage_factor": self.coverage_factor,
            "coverage": self.coverage,
            "standard_uncertainty": unit.difference_from_si(first.first_order),
            "standard_uncertainty_second_order": finite_or_none(unit.difference_from_si(first.second_order)),
            "bias_second_order": finite_or_none(unit.difference_from_si(first.bias)),
            "degrees_of_freedom": None if freedom is None else finite_or_none(freedom),
            "degrees_of_freedom_refused": first.refusal or None,
            "budget": [row.to_dict(units[row.name], unit) for row in self.rows],
            "warnings": list(self.warnings),
        }
        if self.monte_carlo is not None:
            content["monte_carlo"] = self.monte_carlo.to_dict(unit)
            for key, check in (
                ("first_order_check", self.check),
                ("second_order_check", self.check_second_order),
            ):
                content[key] = None if check is None else check.to_dict(unit)
        return content


@dataclass(frozen=True)
class Uncertainty(Displayed):
    """A budget evaluated.

    Attributes
    ----------
    budget : Budget
    measurands : tuple of MeasurandResult
    correlation : ndarray (measurands, measurands)
        Of the measurands, by the inputs they share.
    inverse : tuple of RequiredImprovement
        What has to improve for a wanted uncertainty, if one was asked for.
    correlation_method : str
        ``"monte_carlo"`` where a result is stated by Monte Carlo, else ``"first_order"``.
    """

    budget: Budget
    measurands: tuple[MeasurandResult, ...]
    correlation: np.ndarray
    inverse: tuple[RequiredImprovement, ...] = ()
    correlation_method: str = "first_order"

    @property
    def statements(self) -> tuple[str, ...]:
        """The result of every measurand as the GUM wants it written."""
        return tuple(result.statement for result in self.measurands)

    def to_dict(self) -> dict[str, Any]:
        """The content of ``uncertainty.json``, in the units of the budget file."""
        units = {quantity.name: quantity.unit for quantity in self.budget.inputs}
        content = {
            "title": self.budget.title,
            "measurands": [result.to_dict(units) for result in self.measurands],
            "correlation": self.correlation.tolist(),
            "correlation_method": self.correlation_method,
        }
        if self.inverse:
            content["inverse"] = [answer.to_dict() for answer in self.inverse]
        return content


def finite_or_none(value: float) -> float | None:
    """A finite number, or None for JSON."""
    return float(value) if math.isfinite(value) else None
