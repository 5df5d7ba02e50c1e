"""The achievable error over two quantities, and where a match is held up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from matching.report.style import LIMIT, RIG, figure, styled
from matching.report.words import number, unit

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

    from matching.frequency.map import Map
    from matching.frequency.map_axis import Axis

_READABLE = 12  # values an axis up to which every error is written out


def map_figure(found: Map) -> Figure:
    """Fields coloured by the response error, hatched where a target or limit is not met, crossed where unstable."""
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Patch
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, NullLocator, StrMethodFormatter

    errors = found.errors()
    known = errors[np.isfinite(errors)]
    with styled():
        drawn = figure(8.0, 6.0)
        axes = drawn.subplots()
        columns, rows = _edges(found.x), _edges(found.y)
        span = known if known.size else np.array([0.1, 1.0])
        norm = LogNorm(span.min() / 1.02, span.max() * 1.02)
        if known.size:
            fields = axes.pcolormesh(columns, rows, np.ma.masked_invalid(errors), cmap="viridis_r", norm=norm, zorder=1)
            bar = drawn.colorbar(fields, ax=axes)
            band = f"{number(found.band[0])}–{number(found.band[1])} Hz"
            bar.locator = LogLocator(subs=(1, 2, 5))
            bar.minorlocator = LogLocator(subs=range(1, 10))
            bar.formatter = StrMethodFormatter("{x:g}")
            if span.max() < 3 * span.min():
                bar.locator, bar.minorlocator = MaxNLocator(5), NullLocator()
            bar.update_ticks()
            bar.minorformatter = NullFormatter()
            bar.set_label(f"Response error over {band} that a match reaches")
        hatched = {True: ("//", "target or limit not met"), False: ("xx", "no stable loop found")}
        shown = set()
        for row, points in enumerate(found.points):
            for column, point in enumerate(points):
                if point.status != "matched":
                    hatch, _ = hatched[point.stable]
                    shown.add(point.stable)
                    dark = point.error is not None and norm(point.error) > 0.45
                    colour = "white" if dark else LIMIT
                    _hatch(axes, columns[column : column + 2], rows[row : row + 2], hatch, colour)
                if point.error is not None and max(errors.shape) <= _READABLE:
                    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.5}
                    at = (point.x, point.y)
                    axes.annotate(number(point.error, 2), at, ha="center", va="center", fontsize=8, bbox=box, zorder=4)
        _label(axes, found)
        axes.grid(False)
        handles: list[Artist] = [
            Patch(facecolor="white", edgecolor="#333333", hatch=hatched[key][0], label=hatched[key][1]) for key in shown
        ]
        if columns[0] <= found.x.here <= columns[-1] and rows[0] <= found.y.here <= rows[-1]:
            (mark,) = axes.plot(
                found.x.here, found.y.here, "o", markersize=26, markerfacecolor="none", markeredgecolor=RIG,
                markeredgewidth=2, label="as the case has it", linestyle="none", zorder=5,
            )  # fmt: skip
            mark.set_clip_on(False)
            handles.append(mark)
        if handles:
            drawn.legend(handles=handles, loc="outside lower center", ncols=3, markerscale=0.4)
        if found.title:
            axes.set_title(found.title, fontsize=10)
    return drawn


def _edges(axis: Axis) -> np.ndarray:
    """Borders (n + 1,) of the fields round the values."""
    values = np.log(axis.values) if axis.by_ratio else np.asarray(axis.values)
    middles = (values[1:] + values[:-1]) / 2
    ends = [values[0] - (middles[0] - values[0]), *middles, values[-1] + (values[-1] - middles[-1])]
    return np.exp(ends) if axis.by_ratio else np.array(ends)


def _hatch(axes: Any, across: np.ndarray, up: np.ndarray, hatch: str, colour: str) -> None:
    from matplotlib.patches import Rectangle

    corner, width, height = (across[0], up[0]), across[1] - across[0], up[1] - up[0]
    axes.add_patch(
        Rectangle(corner, width, height, hatch=hatch, linewidth=0, zorder=3, facecolor="none", edgecolor=colour)
    )


def _label(axes: Any, found: Map) -> None:
    from matplotlib.ticker import FixedLocator, NullLocator

    for own, axis, scale in ((axes.xaxis, found.x, axes.set_xscale), (axes.yaxis, found.y, axes.set_yscale)):
        if axis.by_ratio:
            scale("log")
        in_ms = axis.unit == "s"
        every = max(1, len(axis.values) // 8)
        ticks = axis.values[::every]
        own.set_major_locator(FixedLocator(list(ticks)))
        own.set_minor_locator(NullLocator())
        own.set_ticklabels([number(1e3 * value if in_ms else value, 3) for value in ticks])
        shown = "ms" if in_ms else unit(axis.unit)
        own.set_label_text(f"{axis.name} in {shown}" if shown else axis.name)
