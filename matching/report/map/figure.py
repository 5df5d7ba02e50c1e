"""The achievable error over two quantities, and where a match is held up."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator

from matching.frequency.studies.map import Map
from matching.frequency.studies.map_axis import Axis
from matching.report.common.style import RIG, figure, styled
from matching.report.common.wording import number, unit
from matching.report.map import marks as map_marks

READABLE = 6  # values an axis up to which fields with their errors are clearer than contours
FAR = 8.0  # ratio of errors from which contours stand in steps of 1, 2, 5
SAME = 1e-9  # relative
CLEAR = 0.05  # of an axis: as near to the frame or the ring a contour carries no label
SHADES = (0.04, 0.66)  # of the colour map: light enough for black lines and hatching everywhere


def map_figure(found: Map) -> Figure:
    """Contours of the response error, fields hatched by what is not met, the case's own place marked.

    Where measured and unmeasured torques meet different errors, each has a panel. Small maps show fields with the
    errors written out in place of contours.
    """
    panels = _panels(found)
    with styled():
        drawn = figure(1.2 + 5.4 * len(panels), 5.6)
        met: list[str] = []
        for place, (title, errors) in enumerate(panels):
            axes = drawn.add_subplot(1, len(panels), place + 1)
            columns, rows = _edges(found.x), _edges(found.y)
            _label(axes, found)
            _errors(drawn, axes, found, errors, columns, rows)
            met = map_marks.hatch(axes, found, columns, rows)
            mark = _mark(axes, found)
            axes.set_title(title, fontsize=10)
            axes.grid(False)
        entries = [*map_marks.handles(met), *mark]
        if entries:
            drawn.legend(handles=entries, loc="outside lower center", ncols=4, handleheight=1.6, handlelength=2.6)
        if found.title:
            drawn.suptitle(found.title, fontsize=11)
    return drawn


def _panels(found: Map) -> list[tuple[str, np.ndarray]]:
    """Titles and errors (y, x): one panel where unmeasured torques meet the same errors as measured ones."""
    measured, other = found.errors(), found.errors("unmeasured")
    known = np.isfinite(measured) & np.isfinite(other)
    if np.allclose(measured[known], other[known], rtol=SAME, atol=0):
        return [("Response error that a match reaches", measured)]
    return [
        ("Response error to measured torques", measured),
        ("Response error to unmeasured torques", other),
    ]


def _errors(drawn: Any, axes: Any, found: Map, errors: np.ndarray, columns: np.ndarray, rows: np.ndarray) -> None:
    """Contours with their errors written on them, or fields; and the scale."""
    known = errors[np.isfinite(errors)]
    if not known.size:
        axes.set(xlim=columns[[0, -1]], ylim=rows[[0, -1]])
        return
    colours = LinearSegmentedColormap.from_list("errors", colormaps["viridis_r"](np.linspace(*SHADES, 64)))
    masked = np.ma.masked_invalid(errors)
    if min(errors.shape) < 4 or max(errors.shape) <= READABLE:
        shown = axes.pcolormesh(
            columns, rows, masked, cmap=colours, norm=LogNorm(known.min() / 1.02, known.max() * 1.02)
        )
        if max(errors.shape) <= READABLE:
            _write(axes, found, errors)
        drawn.colorbar(shown, ax=axes, format="%g", label=_scale(found))
        return
    levels = _levels(float(known.min()), float(known.max()))
    norm = BoundaryNorm([known.min() / 2, *levels, known.max() * 2], colours.N)
    x, y = np.array(found.x.values), np.array(found.y.values)
    shown = axes.contourf(x, y, masked, levels=levels, extend="both", cmap=colours, norm=norm)
    axes.set(xlim=x[[0, -1]], ylim=y[[0, -1]])
    lines = axes.contour(x, y, masked, levels=levels, colors=map_marks.INK, linewidths=0.9, zorder=3.5)
    box: Any = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.2}
    for text in axes.clabel(lines, fmt="%g", fontsize=9, inline=False, colors="black", zorder=4):
        text.set(rotation=0, bbox=box)
        if _in_the_way(axes, found, text):
            text.remove()
    axes.plot(*(own.ravel() for own in np.meshgrid(x, y)), ".", color=map_marks.INK, markersize=2.5, zorder=3.2)
    drawn.colorbar(shown, ax=axes, format="%g", label=_scale(found), spacing="uniform")


def _in_the_way(axes: Any, found: Map, text: Any) -> bool:
    """Whether a contour's label is cut by the frame or lies under the ring; its line can be read off the scale."""
    place, here = (
        axes.transAxes.inverted().transform(axes.transData.transform(at))
        for at in (text.get_position(), (found.x.here, found.y.here))
    )
    cut = np.any((place < CLEAR) | (place > 1 - CLEAR))
    return bool(cut or np.all(np.abs(place - here) < CLEAR))


def _levels(low: float, high: float) -> list[float]:
    """Round errors between the least and the largest: 1, 2, 5 times powers of ten, or evenly where they are near."""
    if high >= FAR * low:
        powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
        inner = [round(step * 10.0**power, 12) for power in powers for step in (1, 2, 5)]
    else:
        inner = [round(float(own), 12) for own in MaxNLocator(12, steps=[1, 2, 5, 10]).tick_values(low, high)]
    inner = [own for own in inner if low < own < high]
    return inner if len(inner) > 1 else [low, high] if low < high else [low * 0.99, low * 1.01]


def _write(axes: Any, found: Map, errors: np.ndarray) -> None:
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.5}
    for y, row in zip(found.y.values, errors, strict=True):
        for x, error in zip(found.x.values, row, strict=True):
            if np.isfinite(error):
                at: Any = {"ha": "center", "va": "center", "fontsize": 8, "bbox": box, "zorder": 4}
                axes.annotate(number(float(error), 2), (x, y), **at)


def _mark(axes: Any, found: Map) -> list[Any]:
    """A ring where the case itself stands, if that is on the map."""
    for axis in (found.x, found.y):
        if not axis.values[0] <= axis.here <= axis.values[-1]:
            return []
    at: Any = {"markerfacecolor": "none", "linestyle": "none", "clip_on": False}
    axes.plot(
        found.x.here, found.y.here, "o", markersize=15, markeredgecolor="white", markeredgewidth=5, zorder=5, **at
    )
    return list(
        axes.plot(
            found.x.here, found.y.here, "o", markersize=15, markeredgecolor=RIG, markeredgewidth=2.4, zorder=6,
            label="the case as it stands", **at,
        )
    )  # fmt: skip


def _scale(found: Map) -> str:
    return f"rms of |log(H_rig/H_vehicle)|, {number(found.band[0])}–{number(found.band[1])} Hz"


def _edges(axis: Axis) -> np.ndarray:
    """Borders (n + 1,) of the fields round the values."""
    values = np.log(axis.values) if axis.by_ratio else np.asarray(axis.values)
    if len(values) == 1:
        return np.array([0.9, 1.1]) * axis.values[0] if axis.values[0] else np.array([-1.0, 1.0])
    middles = (values[1:] + values[:-1]) / 2
    ends = [values[0] - (middles[0] - values[0]), *middles, values[-1] + (values[-1] - middles[-1])]
    return np.exp(ends) if axis.by_ratio else np.array(ends)


def _label(axes: Any, found: Map) -> None:
    for own, axis, scale in ((axes.xaxis, found.x, axes.set_xscale), (axes.yaxis, found.y, axes.set_yscale)):
        if axis.by_ratio:
            scale("log")
        in_ms = axis.unit == "s"
        every = -(-len(axis.values) // 10)
        ticks = axis.values[::every]
        own.set_major_locator(FixedLocator(list(ticks)))
        own.set_minor_locator(NullLocator())
        own.set_ticklabels([number(1e3 * value if in_ms else value, 3) for value in ticks])
        shown = "ms" if in_ms else unit(axis.unit)
        own.set_label_text(f"{axis.name} in {shown}" if shown else axis.name)
