"""Numbers at logarithmic axes as plain text: Matplotlib's are formulas, which are slow to set."""

from __future__ import annotations

import re

from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation

FORMULA = re.compile(r"\$\\mathdefault\{(.*)\}\$")
POWER = re.compile(r"\^\{(-?\d+)\}")
SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


class PlainPowers(LogFormatterSciNotation):
    """The same numbers without formulas, such as 10⁻³ and 2×10⁻³."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The text at a tick."""
        return plain(super().__call__(x, pos))


def plain(text: str) -> str:
    """A number that Matplotlib wrote as a formula; any other text as it is."""
    formula = FORMULA.fullmatch(text)
    if formula is None:
        return text
    with_times = formula[1].replace(r"\times", "×").replace("-", "−")
    return POWER.sub(lambda power: power[1].translate(SUPERSCRIPTS), with_times.replace("^{−", "^{-"))


def write_powers_plainly(fig: Figure) -> None:
    """No formulas at the axes of a figure."""
    for axes in fig.axes:
        for axis in (axes.xaxis, axes.yaxis):
            for ticker in (axis.major, axis.minor):
                if type(ticker.formatter) is LogFormatterSciNotation:
                    ticker.formatter.__class__ = PlainPowers
