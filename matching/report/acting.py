"""A figure that acts on a page: the drawn SVG itself, in which one zooms, and reads values where one points.

The picture is Matplotlib's, so that screen and paper show the same. Here its axes say their scales, and its curves and
bars their names; ``acting.js`` does the rest.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from markupsafe import Markup, escape
from matplotlib.collections import QuadMesh
from matplotlib.container import BarContainer
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch

from matching.report.common import image, without_head

COLOUR_BAR = "<colorbar>"  # what Matplotlib calls the axes of one
CENTRED = 0.51  # of an axis' unit: how far from its tick a named bar may stand


def acting(fig: Figure) -> tuple[bytes, Markup]:
    """A figure as SVG, and as an element of a page with what ``acting.js`` needs to know of its axes."""
    shown = [axes for axes in fig.axes if axes.get_visible() and axes.axison and axes.get_label() != COLOUR_BAR]
    for number, axes in enumerate(shown):
        axes.set_gid(f"acts-{number}")
        for line in axes.lines:
            if np.size(line.get_xdata()) > 1 and line.get_transform() == axes.transData:
                line.set_gid(f"curve: {_label(line)}")
        for steps in axes.patches:  # of a distribution
            if isinstance(steps, StepPatch):
                steps.set_gid(f"curve: {_label(steps)}")
        for bar, words in _bars(axes):
            bar.set_gid(f"bar: {words}")
    svg = image(fig)
    known = escape(json.dumps([_scales(axes) for axes in shown], separators=(",", ":")))
    return svg, Markup(f'<div class="acts" data-axes="{known}">{without_head(svg)}</div>')


def _label(artist: Any) -> str:
    label = str(artist.get_label())
    return "" if label.startswith("_") else label


def _scales(axes: Any) -> dict[str, Any]:
    """Of each axis its limits, scale and label; coloured fields with their borders and values."""
    known: dict[str, Any] = {}
    for which, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        linear_to = getattr(axis.get_transform(), "linthresh", None)
        known[which] = {
            "ends": [float(end) for end in axis.get_view_interval()], "scale": axis.get_scale(), "linear": linear_to,
            "label": _shared_label(axes, which).replace("\n", " "), "names": _names(axis),
        }  # fmt: skip
    for mesh in axes.collections:
        if isinstance(mesh, QuadMesh):
            corners = np.asarray(mesh.get_coordinates(), float)
            values: np.ndarray = np.ma.filled(np.ma.asarray(mesh.get_array(), float), np.nan).reshape(
                np.array(corners.shape[:2]) - 1
            )
            known["fields"] = {
                "x": corners[0, :, 0].tolist(), "y": corners[:, 0, 1].tolist(), "of": str(mesh.get_label()).lstrip("_"),
                "values": [[f"{value:.4g}" if np.isfinite(value) else "" for value in row] for row in values],
            }  # fmt: skip

    return known


def _names(axis: Any) -> list[list[Any]]:
    """Ticks with names; none where they are numbers."""
    places = [float(place) for place in axis.get_majorticklocs()]
    named = [[place, text] for place, text in zip(places, axis.get_major_formatter().format_ticks(places), strict=True)
             if text]  # fmt: skip
    return named if any(re.search(r"[^\W\d_]{2}", text) for _, text in named) else []


def _bars(axes: Any) -> Iterator[tuple[Any, str]]:
    """Bars with their names and lengths in words."""
    for container in axes.containers:
        if not isinstance(container, BarContainer):
            continue
        lies = container.orientation == "horizontal"
        names = _names(axes.yaxis if lies else axes.xaxis)
        for bar in container:
            length, across = (bar.get_width(), bar.get_height()) if lies else (bar.get_height(), bar.get_width())
            centre = (bar.get_y() if lies else bar.get_x()) + across / 2
            near = min(names, key=lambda name: abs(name[0] - centre), default=None)
            name = near[1] if near is not None and abs(near[0] - centre) < CENTRED else ""
            label = str(container.get_label())
            yield bar, ", ".join(filter(None, (name, "" if label.startswith("_") else label, f"{length:.4g}")))


def _shared_label(axes: Any, which: str) -> str:
    """The label of an axis, or where axes share it, that of the axes in the same row or column that carry it."""
    if label := str(getattr(axes, f"get_{which}label")()):
        return label
    here = axes.get_subplotspec()
    for other in getattr(axes, f"get_shared_{which}_axes")().get_siblings(axes):
        place, label = other.get_subplotspec(), str(getattr(other, f"get_{which}label")())
        if (
            here
            and place
            and label
            and (place.colspan == here.colspan if which == "x" else place.rowspan == here.rowspan)
        ):
            return label
    return ""
