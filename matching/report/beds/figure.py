"""Response errors over the drawn beds that judged an observer, as a distribution."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from matching.frequency.independent.beds_check import BedsCheck
from matching.report.common.style import LIMIT, MATCHED, VEHICLE, figure, styled


def beds_figure(beds: BedsCheck, tolerance: float) -> Figure:
    """Share of the stable beds whose response error is at most so large; ``tolerance`` is that of the case."""
    with styled():
        fig = figure(7.4, 3.2)
        axes = fig.subplots()
        for name, errors, colour, stroke, width in (
            ("measured torques", beds.measured, VEHICLE, "-", 3.0),  # broad: the other one may lie on it
            ("unmeasured torques", beds.unmeasured, MATCHED, "--", 1.5),
        ):
            share = (np.arange(len(errors)) + 0.5) / max(len(errors), 1)
            opacity = 0.5 if width > 2 else 1.0
            axes.plot(errors, 100 * share, stroke, label=name, color=colour, linewidth=width, alpha=opacity)
            parts = np.array([0.5, 0.95])
            if errors:
                axes.plot(np.quantile(errors, parts), 100 * parts, "o", color=colour)
        axes.axvline(tolerance, color=LIMIT, linestyle=":", label="allowed as planned, unmeasured")
        axes.set(xlabel="Response error", ylabel="Share of stable beds, %", ylim=(0, 100))
        axes.set_xlim(left=0)
        axes.legend(loc="lower right")
    return fig
