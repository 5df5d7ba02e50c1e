"""One input of a budget file: from data sheet entries, certificates, raw readings or a fitted line."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from matching.validity.budget.budget import InputQuantity
from matching.validity.budget.distributions import NAMES, Distribution
from modelling.common.errors import InputError
from modelling.common.tables import check_keys, number, numbers, one_of, text
from modelling.units import Unit, unit_of

LARGEST_FACTOR = 1e6  # k; 99.99 % with one degree of freedom has 6366
KNOWN = (
    "value",
    "unit",
    "distribution",
    "half_width",
    "half_width_tolerance",
    "uncertainty",
    "expanded_uncertainty",
    "coverage_factor",
    "degrees_of_freedom",
    "beta",
    "readings",
    "simultaneous",
    "cause",
    "description",
)
LINE = ("abscissa", "ordinate", "abscissa_unit", "ordinate_unit", "origin", "cause", "description")


def read_input(name: str, table: Any, where: str) -> tuple[InputQuantity, np.ndarray]:
    """The input and its readings (n,) in SI (empty where it has none).

    Raises
    ------
    InputError
        One line that names file and key.
    """
    check_keys(table, KNOWN, where)
    unit = unit_of(table.get("unit", "1"), f"{where}.unit")
    labels: dict[str, Any] = {
        "cause": text(table, "cause", where, "Other"),
        "description": text(table, "description", where, ""),
    }
    if "readings" in table:
        return _from_readings(name, table, unit, labels, where)
    if "simultaneous" in table:
        raise InputError(f"{where}.simultaneous", "is for readings", "give readings = [...]")
    value = unit.value_to_si(number(table, "value", where))
    if not any(key in table for key in ("half_width", "uncertainty", "expanded_uncertainty")):
        for key in ("distribution", "degrees_of_freedom", "beta", "coverage_factor", "half_width_tolerance"):
            if key in table:
                raise InputError(where, f"{key} without an uncertainty", "give half_width, uncertainty or drop it")
        return InputQuantity(name, value, 0.0, unit, **labels), np.empty(0)
    tolerance = _width_tolerance(table, where)
    freedom = 0.5 / tolerance**2 if tolerance else math.inf  # GUM G.4.2
    freedom = number(table, "degrees_of_freedom", where, positive=True) if "degrees_of_freedom" in table else freedom
    distribution = replace(_distribution(table, freedom, where), width_tolerance=tolerance)
    u = unit.difference_to_si(_standard_uncertainty(table, distribution, where))
    return InputQuantity(name, value, abs(u), unit, distribution, freedom, **labels), np.empty(0)


def _width_tolerance(table: Any, where: str) -> float:
    """Half-width of the half-width, relative: limits that are not exactly known (JCGM 101, 6.4.3); 0 if exact."""
    if "half_width_tolerance" not in table:
        return 0.0
    if "half_width" not in table or text(table, "distribution", where, "rectangular") != "rectangular":
        wrong = "belongs to the half_width of a rectangular distribution"
        raise InputError(f"{where}.half_width_tolerance", wrong, "drop it")
    half_width = number(table, "half_width", where, positive=True)
    tolerance = number(table, "half_width_tolerance", where, least=0.0)
    if tolerance > half_width:
        raise InputError(f"{where}.half_width_tolerance", f"{tolerance:g} is beyond half_width", "give less")
    return tolerance / half_width


def _distribution(table: Any, freedom: float, where: str) -> Distribution:
    default = "rectangular" if "half_width" in table and "coverage_factor" not in table else "normal"
    name = one_of(text(table, "distribution", where, default), NAMES, f"{where}.distribution")
    if ("beta" in table) != (name == "trapezoidal"):
        raise InputError(
            f"{where}.beta",
            "beta belongs to the trapezoidal distribution and to no other",
            'give distribution = "trapezoidal" and beta = top width over base width',
        )
    beta = number(table, "beta", where) if "beta" in table else 0.0
    if not 0 <= beta <= 1:
        raise InputError(f"{where}.beta", f"{beta:g} is out of range", "give a number in 0 ... 1")
    if name == "t" and math.isinf(freedom):
        raise InputError(where, "Student's t needs degrees_of_freedom", "give them")
    if name == "normal" and math.isfinite(freedom):  # JCGM 101, 6.4.9: an estimated spread makes the normal a t
        name = "t"
    return Distribution(name, beta, freedom if name == "t" else math.inf)


def read_coverage_factor(table: Any, where: str) -> float:
    """The coverage factor k in a table; one far from any level of confidence would only overflow.

    Raises
    ------
    InputError
        It is missing, no number, not positive or of another magnitude than any k.
    """
    return number(table, "coverage_factor", where, positive=True, least=1 / LARGEST_FACTOR, most=LARGEST_FACTOR)


def _standard_uncertainty(table: Any, distribution: Distribution, where: str) -> float:
    statements = [key for key in ("half_width", "uncertainty", "expanded_uncertainty") if key in table]
    if len(statements) != 1:
        raise InputError(where, f"{' and '.join(statements)} are given together", "give one of them")
    amount = number(table, statements[0], where, least=0.0)
    if statements[0] == "uncertainty":
        if "coverage_factor" in table:
            raise InputError(
                where,
                "uncertainty is the standard uncertainty and has no coverage_factor",
                "write expanded_uncertainty",
            )
        return amount
    if distribution.name in ("normal", "t") or statements[0] == "expanded_uncertainty":
        if "coverage_factor" not in table:
            raise InputError(
                where,
                f"{statements[0]} of a {distribution.name} distribution needs coverage_factor",
                "give coverage_factor = 2 or whatever the certificate says",
            )
        return amount / read_coverage_factor(table, where)
    if "coverage_factor" in table:
        raise InputError(f"{where}.coverage_factor", f"a {distribution.name} half-width has none", "drop it")
    return amount * math.sqrt(distribution.weight())


def _from_readings(
    name: str, table: Any, unit: Unit, labels: dict[str, Any], where: str
) -> tuple[InputQuantity, np.ndarray]:
    for key in (
        "value",
        "half_width",
        "half_width_tolerance",
        "uncertainty",
        "expanded_uncertainty",
        "distribution",
        "degrees_of_freedom",
        "coverage_factor",
        "beta",
    ):
        if key in table:
            raise InputError(where, f"{key} beside readings", "the readings say it already; drop it")
    values = unit.value_to_si(np.array(numbers(table["readings"], f"{where}.readings")))
    freedom = len(values) - 1
    group = text(table, "simultaneous", where, "") or None
    mean = InputQuantity(
        name,
        float(values.mean()),
        float(values.std(ddof=1) / math.sqrt(len(values))),
        unit,
        Distribution("t", degrees_of_freedom=freedom),
        freedom,
        group,
        **labels,
    )
    return mean, values


def read_line(name: str, table: Any, where: str) -> tuple[InputQuantity, InputQuantity, float]:
    """Intercept and slope of a straight line fitted to readings by least squares (GUM H.3), and their correlation.

    The line is ``ordinate = NAME_intercept + NAME_slope * (abscissa - origin)``.

    Raises
    ------
    InputError
        One line that names file and key.
    """
    check_keys(table, LINE, where)
    units = [unit_of(table.get(f"{axis}_unit", "1"), f"{where}.{axis}_unit") for axis in ("abscissa", "ordinate")]
    x, y = (np.array(numbers(table.get(axis), f"{where}.{axis}", least=3)) for axis in ("abscissa", "ordinate"))
    if len(x) != len(y):
        raise InputError(where, f"{len(x)} abscissas but {len(y)} ordinates", "give as many of both")
    x = units[0].difference_to_si(x - (number(table, "origin", where) if "origin" in table else 0.0))
    y = units[1].value_to_si(y)
    if np.ptp(x) == 0:  # also where the origin is so far away that no digit of them is left
        raise InputError(f"{where}.abscissa", "all readings are equal", "a line needs different abscissas")
    with np.errstate(over="ignore", invalid="ignore"):
        fit = scipy.stats.linregress(x, y)
    if not np.isfinite([fit.slope, fit.stderr, fit.intercept, fit.intercept_stderr]).all():
        raise InputError(where, "no line can be fitted: the readings are too large", "give readings in another unit")
    freedom = len(x) - 2
    labels = {"cause": text(table, "cause", where, "Calibration"), "description": text(table, "description", where, "")}
    spread = Distribution("t", degrees_of_freedom=freedom)
    slope_unit = Unit(
        "/".join(
            f"({axis_unit.text.replace('degC', 'delta_degC') if axis_unit.offset else axis_unit.text})"
            for axis_unit in units[::-1]
        ),
        units[1].scale / units[0].scale,
        0.0,
        units[1].dimension / units[0].dimension,
    )
    intercept = InputQuantity(
        f"{name}_intercept",
        float(fit.intercept),
        float(fit.intercept_stderr),
        units[1],
        spread,
        freedom,
        name,
        **labels,
    )
    slope = InputQuantity(
        f"{name}_slope", float(fit.slope), float(fit.stderr), slope_unit, spread, freedom, name, **labels
    )
    r = -float(x.mean() * fit.stderr / fit.intercept_stderr) if fit.intercept_stderr > 0 else 0.0
    return intercept, slope, max(-1.0, min(1.0, r))
