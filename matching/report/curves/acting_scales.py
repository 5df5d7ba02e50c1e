"""Scales and labels of Matplotlib axes for the browser's library, which lacks the scale that is linear near zero."""

from __future__ import annotations

from typing import Any

import numpy as np

SCALES = {"linear": "linear", "log": "log", "symlog": "linear"}  # others have no counterpart: such axes stay pictures


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
