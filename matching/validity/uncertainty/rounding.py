"""Writing a result as the GUM wants it (7.2.2 to 7.2.6), and the numerical tolerance of JCGM 101 (7.9.2)."""

from __future__ import annotations

import math
from decimal import ROUND_HALF_EVEN, Decimal

from modelling.units import printed

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
