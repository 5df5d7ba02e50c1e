"""Figure of a bed's verification: measured responses with their uncertainty over vehicle and prediction."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.bed_test.result import COVERAGE_FACTOR, BedVerification, FunctionCurves
from matching.report.common.log_ticks import plain_ticks
from matching.report.common.style import MATCHED, NOISE, VEHICLE, figure, styled
from matching.report.common.wording import spaced, unit

MOST_COLUMNS = 3
LARGEST_BAND = 3.0  # of a modulus: a wider uncertainty is not drawn, it would hide the rest


def responses(verification: BedVerification) -> Figure:
    """One panel a compared function: modulus over frequency of vehicle, prediction and bed."""
    curves = verification.curves
    columns = min(MOST_COLUMNS, len(curves))
    rows = -(-len(curves) // columns)
    fig = figure(3.4 * columns + 0.4, 2.5 * rows + 0.5)
    with styled():
        axes = fig.subplots(rows, columns, squeeze=False, sharex=True).ravel()
        for ax, curve in zip(axes, curves, strict=False):
            _panel(ax, curve)
        for ax in axes[len(curves) :]:
            ax.set_visible(False)
        for ax in axes[max(len(curves) - columns, 0) : len(curves)]:
            ax.set_xlabel("frequency in Hz")
        handles, labels = axes[0].get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return fig


def _panel(ax: Any, curve: FunctionCurves) -> None:
    f, measured = curve.frequencies, np.abs(curve.measured)
    known = np.isfinite(measured) & np.isfinite(curve.uncertainty)
    spread = np.where(known, COVERAGE_FACTOR * curve.uncertainty, np.nan)
    low, high = (
        np.maximum(measured - spread, measured / LARGEST_BAND),
        np.minimum(measured + spread, measured * LARGEST_BAND),
    )
    ax.loglog(f, np.abs(curve.vehicle), color=VEHICLE, label="vehicle")
    ax.loglog(f, np.abs(curve.predicted), color=MATCHED, linestyle="--", label="predicted for the bed")
    ax.fill_between(f, low, high, where=known, color=NOISE, alpha=0.3, linewidth=0, label="about 95 %")
    ax.loglog(
        f[known],
        measured[known],
        "o",
        markersize=4,
        color=NOISE,
        alpha=0.5,
        markeredgewidth=0,
        zorder=1.5,
        label="measured on the bed",
    )
    ax.set_xlim(f[0], f[-1])
    plain_ticks(ax.xaxis)
    ax.set_title(f"{spaced(curve.input)} → {spaced(curve.sensor)}", fontsize=8)
    ax.set_ylabel(f"{unit(curve.unit)} per N·m")
