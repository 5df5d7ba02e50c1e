"""Figure of the torques that no cause explains, over speed, angle, load, twist or time."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from matching.diagnosis.verdict.discrepancy import UNITS, DiscrepancyCurve
from matching.report.common.style import RIG, figure, styled

CURVES_SHOWN = 3
COVERAGE_FACTOR = 2.0  # of the band


def discrepancy_figure(curves: Sequence[DiscrepancyCurve]) -> Figure:
    """The curves that would take most, each with its band."""
    shown = curves[:CURVES_SHOWN]
    with styled():
        fig = figure(11, 3.2)
        for axes, curve in zip(fig.subplots(1, len(shown), squeeze=False)[0], shown, strict=True):
            band = COVERAGE_FACTOR * curve.standard_uncertainty
            axes.fill_between(curve.grid, curve.torque - band, curve.torque + band, color=RIG, alpha=0.25, lw=0)
            axes.plot(curve.grid, curve.torque, color=RIG)
            table, name = curve.at.split(".")
            where = f"{curve.over.capitalize()} of {name}" if curve.over != "time" else "Time"
            side = "on" if table == "inertias" else "in"
            unit = UNITS[curve.over].replace("*", "·")
            axes.set(xlabel=f"{where} in {unit}", ylabel=f"Unexplained {side} {name} in N·m")
            axes.set_title(f"takes {100 * curve.share:.0f} % of the rest")
    return fig
