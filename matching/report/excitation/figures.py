"""Figures of a planned excitation: torques over time, and what is known before and after."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from matching.excitation.result import ExcitationPlan
from matching.report.common.style import BAND, MATCHED, RIG, curve, figure, styled
from matching.report.common.wording import spaced

SHOWN = 12  # quantities, those that matter most
SMALLEST_SHARE = 1e-6


def excitation(plan: ExcitationPlan) -> Figure:
    """Demanded torques over time, one panel an input; below, the part of each quantity in the response error."""
    count = len(plan.inputs)
    expected = plan.expected[:SHOWN]
    fig = figure(7.4, 1.3 * count + 0.22 * len(expected) + 1.2)
    with styled():
        grid = fig.add_gridspec(count + 1, 1, height_ratios=[1.0] * count + [0.2 * len(expected) + 0.5])
        first = None
        for j, name in enumerate(plan.inputs):
            ax = fig.add_subplot(grid[j], sharex=first)
            first = first or ax
            for part in plan.parts[::2]:
                ax.axvspan(part.begin, part.end, color=BAND, linewidth=0)
            look = curve(j) | {"linestyle": "-"}  # alone in its panel
            ax.plot(plan.time, plan.torques[:, j], linewidth=0.6, rasterized=True, **look)
            ax.set_ylabel(f"{spaced(name)}\nin N·m")
            if j == 0:
                for part in plan.parts:
                    ax.text(
                        (part.begin + part.end) / 2, 1.02, part.kind, transform=ax.get_xaxis_transform(), ha="center"
                    )
            if j == count - 1:
                ax.set_xlabel("time in s")
            else:
                ax.tick_params(labelbottom=False)
        ax = fig.add_subplot(grid[count])
        rows = np.arange(len(expected))
        looks = (("share_before", RIG, "o", "now"), ("share_after", MATCHED, "D", "expected after"))
        for share, colour, mark, label in looks:
            values = np.maximum([getattr(quantity, share) for quantity in expected], SMALLEST_SHARE)
            ax.plot(values, rows, mark, color=colour, label=label, fillstyle="full" if mark == "o" else "none")
        ax.set_xscale("log")
        ax.set_yticks(rows, [spaced(quantity.name) for quantity in expected])
        ax.invert_yaxis()
        ax.set_xlabel("part of the response error")
        fig.legend(loc="outside lower center", ncols=2)
    return fig
