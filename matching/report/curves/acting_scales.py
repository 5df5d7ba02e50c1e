"""Scales and labels of Matplotlib axes for the browser's library, which lacks the scale that is linear near zero."""

from __future__ import annotations

from typing import Any

import numpy as np

from matching.report.common.log_ticks import LABELLED_RATIO

SCALES = {"linear": "linear", "log": "log", "symlog": "linear"}  # others have no counterpart: such axes stay pictures


# The library puts evenly spaced ticks on a short logarithmic axis, where they crowd at its end.
SHORT_LOG_TICKS = """
const low = Math.min(cb_data.start, cb_data.end), high = Math.max(cb_data.start, cb_data.end), ticks = []
if (!(low > 0)) return ticks
if (high > 4 * low) {
  for (let k = Math.floor(Math.log10(low)); k <= Math.log10(high); k++)
    for (const m of high < LABELLED * low ? [1, 2, 5] : [1])
      if (m * 10**k >= low && m * 10**k <= high) ticks.push(m * 10**k)
  return ticks
}
const least = (high - low) / 6, decade = 10**Math.floor(Math.log10(least))
const step = decade * [1, 2, 5, 10].find((m) => m * decade >= least)
for (let k = Math.ceil(low / step); k * step <= high; k++) ticks.push(k * step)
return ticks
""".replace("LABELLED", str(LABELLED_RATIO))


def label_short_logarithms(fig: Any, axes: Any) -> None:
    """At the logarithmic axes that are short: ticks at 1, 2 and 5 of a decade, with plain numbers."""
    from bokeh.models import CustomJSTicker, CustomJSTickFormatter

    for drawn, axis in ((fig.xaxis, axes.xaxis), (fig.yaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        if axis.get_scale() == "log" and high < LABELLED_RATIO * low:
            drawn.ticker = CustomJSTicker(major_code=SHORT_LOG_TICKS, minor_code="return []")
            drawn.formatter = CustomJSTickFormatter(code="return String(Number(tick.toPrecision(4)))")


def placed(axis: Any, values: Any) -> np.ndarray:
    """Where values (t,) stand on a figure that acts, also (t,): themselves, but on an axis that is linear near zero."""
    values = np.asarray(values, float)
    return np.asarray(axis.get_transform().transform(values)) if axis.get_scale() == "symlog" else values


def label_placed_ticks(fig: Any, axis: Any) -> None:
    """At an upright axis that is linear near zero: the ticks of the picture, and values themselves where pointed at."""
    if axis.get_scale() != "symlog":
        return
    ticks = axis.get_majorticklocs()
    places = placed(axis, ticks).tolist()
    fig.yaxis.ticker = places
    fig.yaxis.major_label_overrides = dict(zip(places, axis.get_major_formatter().format_ticks(ticks), strict=True))
    for hover in fig.hover:
        hover.tooltips = [(name, "@value{0.00000}" if name == "y" else shown) for name, shown in hover.tooltips]


def shared_label(axes: Any, which: str) -> str:
    """The label of an axis, or where axes share it, that of the axes that carry it (``which``: ``x`` or ``y``)."""
    label = str(getattr(axes, f"get_{which}label")())
    if label:
        return label
    shared = getattr(axes, f"get_shared_{which}_axes")().get_siblings(axes)
    here = axes.get_subplotspec()
    if here is None:
        return ""
    for other in shared:
        place = other.get_subplotspec()
        aligned = place is not None and (
            place.colspan == here.colspan if which == "x" else place.rowspan == here.rowspan
        )
        if aligned and getattr(other, f"get_{which}label")():
            return str(getattr(other, f"get_{which}label")())
    return ""
