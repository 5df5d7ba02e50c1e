"""Figures of an uncertainty budget: contributions as bars, causes as Ishikawa diagram (like Figs. 4 and 5)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from matching.report.common import style
from matching.validity.uncertainty.result import MeasurandResult, Row
from modelling.units import printed

LARGEST = 20  # inputs in the bar chart; more would not be readable
TWIG = 1.75  # inches, length of an input's line in the Ishikawa diagram


def contributions(result: MeasurandResult) -> Figure:
    """Bars of |c|·u(x) of each input, largest on top, with the combined standard uncertainty as line."""
    rows = [row for row in result.rows if row.contribution > 0][:LARGEST]
    unit = result.measurand.unit
    sizes = [unit.difference_from_si(row.contribution) for row in rows]
    with style.styled():
        fig = style.figure(6.4, 1.2 + 0.3 * max(len(rows), 2))
        axes = fig.add_subplot()
        axes.grid(visible=False, axis="y")
        bars = axes.barh([row.name for row in rows], sizes, color=style.VEHICLE)
        axes.bar_label(bars, [f"{100 * row.share:.3g} %" for row in rows], padding=3, fontsize=8)
        combined = unit.difference_from_si(result.propagation.first_order)
        axes.axvline(combined, color=style.LIMIT, linestyle="--", label=f"combined, {combined:.3g}{_unit(result)}")
        axes.invert_yaxis()
        axes.margins(x=0.12)
        axes.set_xlabel(f"contribution |c|·u(x) to u({result.measurand.name}){_axis_unit(result)}; labels: share of u²")
        fig.legend(loc="outside lower right")
        axes.set_title(result.statement, fontsize=9)
    return fig


def ishikawa(result: MeasurandResult) -> Figure:
    """The causes as branches of an arrow that ends in the measurand; line widths and numbers follow the share of u²."""
    branches = _branches(result.rows)
    columns = math.ceil(len(branches) / 2)
    expanded = result.measurand.unit.difference_from_si(result.expanded)
    longest = max(len(rows) for _, rows in branches)
    width, reach = 3.1, 0.42 * (longest + 1)  # of a branch, inches
    with style.styled():
        below = -reach - 0.7 if len(branches) > 1 else -0.4  # no empty half where one cause stands alone
        fig = style.figure(2.2 + width * columns, max(3.2, 2 * reach + 1.2) if len(branches) > 1 else reach + 1.2)
        axes = fig.add_subplot()
        axes.set_axis_off()
        end = width * columns + 0.8
        axes.annotate("", (end, 0), (-0.2, 0), arrowprops={"arrowstyle": "-|>", "lw": 2.2, "color": "black"})
        axes.text(
            end + 0.08,
            0,
            f"{result.measurand.name}\nU = {expanded:.3g}{_unit(result)}",
            va="center",
            ha="left",
            fontweight="bold",
        )
        for place, (cause, rows) in enumerate(branches):
            _branch(axes, width * (place // 2 + 1), 1 if place % 2 == 0 else -1, cause, rows, reach)
        axes.set_xlim(-0.9, end + 1.6)
        axes.set_ylim(below, reach + 0.7)
    return fig


def _branch(axes: Any, foot: float, side: int, cause: str, rows: list[Row], reach: float) -> None:
    slant = 0.35 * reach
    share = sum(row.share for row in rows)
    axes.plot([foot - slant, foot], [side * reach, 0], color=style.VEHICLE, lw=1 + 3 * max(0.0, min(1.0, share)))
    axes.text(
        foot - slant,
        side * (reach + 0.12),
        f"{cause}\n{100 * share:.3g} %" if side > 0 else f"{100 * share:.3g} %\n{cause}",
        ha="center",
        va="bottom" if side > 0 else "top",
        fontweight="bold",
    )
    for number, row in enumerate(rows):
        height = reach * (1 - (number + 0.6) / (len(rows) + 0.4))
        end = foot - slant * height / reach
        axes.plot([end - TWIG, end], [side * height] * 2, color=style.LIMIT, lw=0.9)
        axes.text(end - TWIG, side * height + 0.04, f"{row.name}  {100 * row.share:.3g} %", fontsize=8, va="bottom")


def _branches(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    """Uncertain inputs by cause, the cause with the largest share first."""
    causes: dict[str, list[Row]] = {}
    for row in rows:
        if row.standard_uncertainty > 0:
            causes.setdefault(row.cause, []).append(row)
    if not causes:
        return [("no uncertain input", [])]
    return sorted(causes.items(), key=lambda item: -sum(row.share for row in item[1]))


def _unit(result: MeasurandResult) -> str:
    text = result.measurand.unit.text
    return "" if text == "1" else f" {printed(text)}"


def _axis_unit(result: MeasurandResult) -> str:
    text = result.measurand.unit.text
    return "" if text == "1" else f" in {printed(text)}"
