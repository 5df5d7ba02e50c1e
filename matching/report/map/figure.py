"""Figure of a map: the response error that a match reaches over two quantities, and what limits it where."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator

from matching.frequency.studies.map import Map
from matching.frequency.studies.map_axis import Axis
from matching.report.common.style import INK, RIG, figure, styled
from matching.report.common.wording import number, unit
from matching.report.map import marks as map_marks
from matching.report.map.stable_beds import beside_ring, draw_stable_beds, stable_shares
from modelling.common import escape

MOST_FIELDS = 6  # values per axis up to which coloured fields with their errors are clearer than contours
LEAST_VALUES = 4  # per axis that contours need
LOGARITHMIC_RATIO = 8.0  # largest over least error from which contour levels rise by 1, 2, 5, 10
EQUAL_RELATIVE = 1e-9  # errors that differ by no more count as equal
LABEL_CLEARANCE = 0.05  # share of an axis that a contour's label keeps from the frame and from the case's mark
SHADES = (0.04, 0.66)  # part of the colour map: light enough for black lines and hatching everywhere
MOST_TICKS = 10  # labels per axis


def map_figure(result: Map) -> Figure:
    """Contours of the response error, fields hatched by what limits the match, the case's point marked.

    Where measured and unmeasured torques have different errors, each has a panel; where drawn beds judge the matches,
    the share of those that are stable has one as well. Small maps show fields with the errors in numbers instead of
    contours.
    """
    drawn, with_beds = panels(result), stable_shares(result) is not None
    count, columns, rows = len(drawn) + with_beds, edges(result.x), edges(result.y)
    with styled():
        fig = figure(1.2 + 5.4 * count, 5.6)
        limiting: list[str] = []
        for place, (title, errors) in enumerate(drawn):
            axes = fig.add_subplot(1, count, place + 1)
            _label(axes, result)
            _errors(fig, axes, result, errors, columns, rows)
            limiting = map_marks.hatch(axes, result, columns, rows)
            mark = _mark(axes, result)
            axes.set_title(title, fontsize=10)
            axes.grid(False)
        if with_beds:
            axes = fig.add_subplot(1, count, count)
            _label(axes, result)
            draw_stable_beds(axes, result, columns, rows)
            _mark(axes, result)
            axes.grid(False)
        entries = [*map_marks.handles(limiting), *mark]
        if entries:
            fig.legend(handles=entries, loc="outside lower center", ncols=4, handleheight=1.6, handlelength=2.6)
        if result.title:
            fig.suptitle(escape.figure(result.title), fontsize=11)
    return fig


def panels(result: Map) -> list[tuple[str, np.ndarray]]:
    """Titles and errors (y, x): one panel where measured and unmeasured torques have the same errors."""
    measured, unmeasured = result.errors(), result.errors("unmeasured")
    known = np.isfinite(measured) & np.isfinite(unmeasured)
    if np.allclose(measured[known], unmeasured[known], rtol=EQUAL_RELATIVE, atol=0):
        return [("Response error that a match reaches", measured)]
    return [
        ("Response error to measured torques", measured),
        ("Response error to unmeasured torques", unmeasured),
    ]


def _errors(fig: Any, axes: Any, result: Map, errors: np.ndarray, columns: np.ndarray, rows: np.ndarray) -> None:
    """Contours labelled with their errors, or coloured fields; and the scale."""
    known = errors[np.isfinite(errors)]
    if not known.size:
        axes.set(xlim=columns[[0, -1]], ylim=rows[[0, -1]])
        return
    colours = LinearSegmentedColormap.from_list("errors", colormaps["viridis_r"](np.linspace(*SHADES, 64)))
    masked = np.ma.masked_invalid(errors)
    if min(errors.shape) < LEAST_VALUES or max(errors.shape) <= MOST_FIELDS:
        fields = axes.pcolormesh(
            columns, rows, masked, cmap=colours, norm=LogNorm(known.min() / 1.02, known.max() * 1.02)
        )
        if max(errors.shape) <= MOST_FIELDS:
            _write(axes, result, errors)
        fig.colorbar(fields, ax=axes, format="%g", label=scale_words(result))
        return
    levels = _levels(float(known.min()), float(known.max()))
    norm = BoundaryNorm([known.min() / 2, *levels, known.max() * 2], colours.N)
    x, y = np.array(result.x.values), np.array(result.y.values)
    filled = axes.contourf(x, y, masked, levels=levels, extend="both", cmap=colours, norm=norm)
    axes.set(xlim=x[[0, -1]], ylim=y[[0, -1]])
    lines = axes.contour(x, y, masked, levels=levels, colors=INK, linewidths=0.9, zorder=3.5)
    box: Any = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.2}
    for text in axes.clabel(lines, fmt="%g", fontsize=9, inline=False, colors="black", zorder=4):
        text.set(rotation=0, bbox=box)
        if _hidden(axes, result, text):
            text.remove()
    axes.plot(*(values.ravel() for values in np.meshgrid(x, y)), ".", color=INK, markersize=2.5, zorder=3.2)
    fig.colorbar(filled, ax=axes, format="%g", label=scale_words(result), spacing="uniform")


def _hidden(axes: Any, result: Map, text: Any) -> bool:
    """Whether a contour's label is cut by the frame or covered by the case's mark."""
    place, here = (
        axes.transAxes.inverted().transform(axes.transData.transform(at))
        for at in (text.get_position(), (result.x.here, result.y.here))
    )
    cut = np.any((place < LABEL_CLEARANCE) | (place > 1 - LABEL_CLEARANCE))
    return bool(cut or np.all(np.abs(place - here) < LABEL_CLEARANCE))


def _levels(low: float, high: float) -> list[float]:
    """Round levels between the least and the largest error: 1, 2, 5 times powers of ten, or even steps."""
    if high >= LOGARITHMIC_RATIO * low:
        powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
        inner = [round(step * 10.0**power, 12) for power in powers for step in (1, 2, 5)]
    else:
        inner = [round(float(level), 12) for level in MaxNLocator(12, steps=[1, 2, 5, 10]).tick_values(low, high)]
    inner = [level for level in inner if low < level < high]
    return inner if len(inner) > 1 else [low, high] if low < high else [low * 0.99, low * 1.01]


def _write(axes: Any, result: Map, errors: np.ndarray) -> None:
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.5}
    for y, row in zip(result.y.values, errors, strict=True):
        for x, error in zip(result.x.values, row, strict=True):
            if np.isfinite(error):
                look: Any = {"ha": "center", "va": "center", "fontsize": 8, "bbox": box, "zorder": 4}
                axes.annotate(number(float(error), 2), (x, y), **beside_ring(result, x, y), **look)


def _mark(axes: Any, result: Map) -> list[Any]:
    """A ring at the case's own values, if they lie on the map."""
    if not case_lies_on(result):
        return []
    ring: Any = {"markerfacecolor": "none", "linestyle": "none", "clip_on": False}
    axes.plot(
        result.x.here, result.y.here, "o", markersize=15, markeredgecolor="white", markeredgewidth=5, zorder=5, **ring
    )
    return list(
        axes.plot(
            result.x.here, result.y.here, "o", markersize=15, markeredgecolor=RIG, markeredgewidth=2.4, zorder=6,
            label="the case as it is", **ring,
        )
    )  # fmt: skip


def case_lies_on(result: Map) -> bool:
    """Whether the case's values of both quantities lie within the map."""
    return all(axis.values[0] <= axis.here <= axis.values[-1] for axis in (result.x, result.y))


def scale_words(result: Map) -> str:
    """What the colours of a map mean: quantity and band."""
    return f"rms of |log(H_rig/H_vehicle)|, {number(result.band[0])}–{number(result.band[1])} Hz"


def edges(axis: Axis) -> np.ndarray:
    """Borders (n + 1,) of the fields around the n values of an axis."""
    values = np.log(axis.values) if axis.by_ratio else np.asarray(axis.values)
    if len(values) == 1:
        return np.array([0.9, 1.1]) * axis.values[0] if axis.values[0] else np.array([-1.0, 1.0])
    middles = (values[1:] + values[:-1]) / 2
    ends = [values[0] - (middles[0] - values[0]), *middles, values[-1] + (values[-1] - middles[-1])]
    return np.exp(ends) if axis.by_ratio else np.array(ends)


def _label(axes: Any, result: Map) -> None:
    for drawn_axis, axis, scale in ((axes.xaxis, result.x, axes.set_xscale), (axes.yaxis, result.y, axes.set_yscale)):
        if axis.by_ratio:
            scale("log")
        in_ms = axis.unit == "s"
        every = -(-len(axis.values) // MOST_TICKS)
        ticks = axis.values[::every]
        drawn_axis.set_major_locator(FixedLocator(list(ticks)))
        drawn_axis.set_minor_locator(NullLocator())
        drawn_axis.set_ticklabels([number(1e3 * value if in_ms else value, 3) for value in ticks])
        shown_unit = "ms" if in_ms else unit(axis.unit)
        drawn_axis.set_label_text(f"{axis.name} in {shown_unit}" if shown_unit else axis.name)
