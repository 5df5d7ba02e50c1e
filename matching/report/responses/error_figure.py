"""The response error of every compared function: rig without control, matched rig, and torque not measured."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from matching.frequency.search.result import MatchResult
from matching.report.common.line_styles import LINES
from matching.report.common.style import LIMIT, figure, styled
from matching.report.common.wording import number, spaced

SMALLEST_DRAWN = 1e-4  # smaller errors are drawn as this
KINDS = {"rig": ("before", "o"), "unmeasured": ("unmeasured", "D"), "matched": ("after", "s")}


def error_figure(result: MatchResult) -> Figure:
    """One row a function, on a logarithmic axis, with the errors that the case allows."""
    rows, case = result.response_error.functions, result.case
    with styled():
        fig = figure(8.0, 1.3 + 0.42 * len(rows))
        axes = fig.subplots()
        places, written = np.arange(len(rows))[::-1], set[tuple[str, int]]()
        for who, (key, mark) in KINDS.items():
            values = [getattr(row, key) for row in rows]
            known = [(value, place) for value, place in zip(values, places, strict=True) if value is not None]
            if not known or (who == "unmeasured" and values == [row.after for row in rows]):
                continue
            drawn, at = [max(value, SMALLEST_DRAWN) for value, _ in known], [place for _, place in known]
            axes.plot(drawn, at, mark, color=LINES[who]["color"], label=LINES[who]["label"], markersize=8,
                      markeredgecolor="#222222", fillstyle="none" if who == "unmeasured" else "full")  # fmt: skip
            for value, place in known:
                if (said := (number(value, 2), int(place))) in written:
                    continue
                written.add(said)
                axes.annotate(number(value, 2), (max(value, SMALLEST_DRAWN), place), (0, 6),
                              textcoords="offset points", ha="center", fontsize=7)  # fmt: skip
        for allowed, words in ((case.tolerance, "measured"), (case.unmeasured_tolerance, "unmeasured")):
            if np.isfinite(allowed):
                axes.axvline(allowed, color=LIMIT, linestyle="--", linewidth=1.2)
                axes.annotate(f"allowed, {words}", (allowed, -0.7), (2, 0), textcoords="offset points", fontsize=7,
                              rotation=90, va="bottom", color=LIMIT)  # fmt: skip
        axes.set_xscale("log")
        axes.set_ylim(-0.8, len(rows) - 0.2)
        names = [f"{spaced(pair.input)} → {spaced(pair.sensor)}" for pair in case.compared]
        axes.set_yticks(places, names)
        axes.grid(False, axis="y")
        axes.set_xlabel(f"Response error, {result.response_error.band[0]:g} to {result.response_error.band[1]:g} Hz")
        fig.legend(loc="outside upper center", ncols=3, fontsize=8)
    return fig
