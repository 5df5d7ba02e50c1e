"""A map: the achievable error over two quantities."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.frequency.studies.map import Map
from matching.report.common.table import aligned, table
from matching.report.map.figure import map_figure
from modelling.common import display


@display.plot.register
def plot(found: Map) -> Figure:
    """Response error over both quantities."""
    return map_figure(found)


@display.text.register
def said(found: Map) -> str:
    """Response errors, one row a value of the upright axis."""
    return aligned(_rows(found), found.title)


@display.html.register
def html(found: Map) -> str:
    """The same for a notebook."""
    return table(_rows(found), found.title)


def _rows(found: Map) -> list[dict[str, str]]:
    rows = []
    for y, errors in zip(found.y.values, found.errors(), strict=True):
        rows.append({f"{found.y.name} \\ {found.x.name}": f"{y:.4g} {found.y.unit}"})
        rows[-1] |= {f"{x:.4g} {found.x.unit}": f"{own:.3g}" for x, own in zip(found.x.values, errors, strict=True)}
    return rows
