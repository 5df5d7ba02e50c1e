"""Views of a map: the response error that a match reaches over two quantities."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.frequency.studies.map import Map
from matching.report.common.table import aligned, table
from matching.report.map.figure import map_figure
from modelling.common import display


@display.plot.register
def plot(result: Map) -> Figure:
    """Response error over both quantities."""
    return map_figure(result)


@display.text.register
def as_text(result: Map) -> str:
    """Response errors, one row for each value of y."""
    return aligned(_rows(result), result.title)


@display.html.register
def as_html(result: Map) -> str:
    """The text of the result as HTML for a notebook."""
    return table(_rows(result), result.title)


def _rows(result: Map) -> list[dict[str, str]]:
    rows = []
    for y, errors in zip(result.y.values, result.errors(), strict=True):
        cells = zip(result.x.values, errors, strict=True)
        rows.append({f"{result.y.name} \\ {result.x.name}": f"{y:.4g} {result.y.unit}"})
        rows[-1] |= {f"{x:.4g} {result.x.unit}": f"{error:.3g}" for x, error in cells}
    return rows
