"""Figures of the tuned quantities: between their bounds with the weight on a change, and what adapters to order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from matching.frequency.search.result import AdapterTrade, MatchResult, ParameterResult
from matching.report.common.style import BAND, LIMIT, MATCHED, RIG, figure, styled
from matching.report.common.wording import component, number, unit

COLUMNS, PANEL_HEIGHT = 3, 2.9  # inches
LOGARITHMIC_FROM = 8.0  # largest over smallest value tried
DECADES_FROM = 1e4  # upper over lower bound: such a bar is logarithmic, or every value would stand at its lower end


def quantity_figure(result: MatchResult) -> Figure:
    """A bar from bound to bound for every quantity that was allowed to move, with start, tuned value and weight."""
    rows = result.parameters
    with styled():
        fig = figure(12.4, 1.2 + 0.36 * max(len(rows), 1))
        weighted = any(row.weight for row in rows)
        bars, *weights = fig.subplots(
            1, 1 + weighted, sharey=True, squeeze=False, width_ratios=[3.2, 1][: 1 + weighted]
        )[0]
        for place, row in enumerate(rows):
            _bar(bars, place, row)
        for axes in weights:
            _weights(axes, rows)
        bars.set_yticks(range(len(rows)), [_label(row) for row in rows], fontsize=8)
        bars.set_ylim(len(rows) - 0.4, -0.6)
        bars.set_xlim(-0.22, 1.22)
        bars.set_xticks([0, 0.5, 1], ["lower bound", "middle", "upper bound"])
        bars.grid(False, axis="y")
        handles, labels = bars.get_legend_handles_labels()
        unique = dict(zip(labels, handles))
        fig.legend(list(unique.values()), list(unique), loc="outside upper center", ncols=4)
    return fig


def _weights(axes: Any, rows: Sequence[ParameterResult]) -> None:
    for place, row in enumerate(rows):
        axes.barh(place, row.weight, height=0.5, color="#BBBBBB", edgecolor="#333333", linewidth=0.6)
        axes.annotate(
            number(row.weight, 2), (row.weight, place), (3, 0), textcoords="offset points", va="center", fontsize=8
        )
    axes.grid(False, axis="y")
    axes.set_xlabel("Weight on a change")
    axes.tick_params(left=False)
    axes.margins(x=0.2)


def _bar(axes: Any, place: int, row: ParameterResult) -> None:
    decades = row.lower > 0 and row.upper >= DECADES_FROM * row.lower

    def at(value: float) -> float:
        if decades:
            return math.log(max(value, row.lower) / row.lower) / math.log(row.upper / row.lower)
        return (value - row.lower) / (row.upper - row.lower)

    axes.barh(place, 1, height=0.34, color="#ECECEC", edgecolor="#AAAAAA", linewidth=0.6)
    axes.plot([at(row.start), at(row.tuned)], [place, place], color=MATCHED, linewidth=2.2, zorder=3)
    axes.plot(
        at(row.start),
        place,
        "|",
        color="#222222",
        markersize=12,
        markeredgewidth=1.6,
        zorder=4,
        label="start",
        linestyle="none",
    )
    marker = (
        {"label": "at a bound", "markerfacecolor": LIMIT, "marker": "s"}
        if row.at_bound
        else {"label": "tuned", "markerfacecolor": MATCHED, "marker": "D"}
    )
    if row.fixed:
        marker = {"label": "not moved, need not be identified accurately", "markerfacecolor": "white", "marker": "D"}
    axes.plot(at(row.tuned), place, markersize=6.5, markeredgecolor="#222222", zorder=5, linestyle="none", **marker)
    axes.annotate(number(row.lower, 3), (-0.025, place), va="center", ha="right", fontsize=8)
    axes.annotate(number(row.upper, 3), (1.025, place), va="center", ha="left", fontsize=8)


def _label(row: ParameterResult) -> str:
    moved = number(row.tuned) if row.fixed or row.start == row.tuned else f"{number(row.start)} → {number(row.tuned)}"
    return f"{row.name}\n{moved} {unit(row.unit)}"


def trade_figure(trades: Sequence[AdapterTrade]) -> Figure:
    """A panel a quantity: error at the values tried, value planned and ordered, the range within 2 % shaded."""
    rows = -(-len(trades) // COLUMNS)
    with styled():
        fig = figure(12.4, 0.7 + PANEL_HEIGHT * rows)
        panels = fig.subplots(rows, min(COLUMNS, len(trades)), squeeze=False).ravel()
        for axes in panels[len(trades) :]:
            axes.set_visible(False)
        for axes, trade in zip(panels, trades):
            values, errors = np.array(trade.curve).T
            axes.axvspan(*trade.acceptable, color=BAND, label="as good within 2 %")
            axes.plot(
                values,
                errors,
                "o-",
                color=MATCHED,
                markersize=3.5,
                label="response error, the rest tuned for each value",
            )
            axes.axvline(trade.planned, color=RIG, linestyle="--", label="as planned")
            axes.plot(trade.ordered, trade.error_as_ordered, "D", color=MATCHED, markersize=8, label="ordered")
            if trade.error_all_as_planned is not None:
                axes.axhline(
                    trade.error_all_as_planned,
                    color=LIMIT,
                    linestyle=":",
                    label="all adapters as planned, tuned for it",
                )
            if values.min() > 0 and values.max() > LOGARITHMIC_FROM * values.min():
                axes.set_xscale("log")
            axes.set_xlabel(f"{component(trade.name)} [{unit(trade.unit)}]")
            axes.set_title(f"ordered {number(trade.ordered)}, planned {number(trade.planned)}", fontsize=9)
        panels[0].set_ylabel("Response error, unmeasured torques")
        handles, labels = panels[0].get_legend_handles_labels()
        fig.legend(handles, labels, loc="outside upper center", ncols=5)
    return fig
