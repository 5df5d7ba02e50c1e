"""A drawing of a drivetrain as plain shapes, each with the part that it belongs to: for pages on which parts react."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text

from matching.report.drawing.drivetrain import TEXT_POINTS, Drawing, draw

POINTS_PER_UNIT = 0.62 * 72  # one unit of the drawing is 0.62 inches wide
AROUND = 0.15  # about the box of a part, units: what marks it is drawn there


@dataclass(frozen=True)
class Stroke:
    """A line through points (k, 2), units; width in units."""

    points: tuple[tuple[float, float], ...]
    colour: str
    width: float
    dashed: bool


@dataclass(frozen=True)
class Area:
    """A filled polygon with corners (k, 2), units; ``hatched`` where software stands in for the part."""

    corners: tuple[tuple[float, float], ...]
    fill: str
    colour: str
    width: float
    hatched: bool


@dataclass(frozen=True)
class Label:
    """Lines of text centred at x; ``below`` is whether they hang from y or stand on it; height in units."""

    x: float
    y: float
    lines: tuple[str, ...]
    below: bool
    bold: bool
    colour: str
    height: float


@dataclass(frozen=True, eq=False)
class DrawnPart:
    """A part of a drivetrain as drawn: its name (``shafts.link``) and its shapes from back to front."""

    name: str
    shapes: tuple[Stroke | Area | Label, ...]

    @functools.cached_property
    def box(self) -> tuple[float, float, float, float]:
        """Left, lower, right and upper end of its areas and texts, or of its lines where it has neither."""
        solid = [shape for shape in self.shapes if not isinstance(shape, Stroke)]
        places = np.array([place for shape in solid or self.shapes for place in _places(shape)])
        (left, lower), (right, upper) = places.min(axis=0), places.max(axis=0)
        return float(left), float(lower), float(right), float(upper)


@dataclass(frozen=True)
class Picture:
    """A drivetrain as shapes; ``extent`` is left, lower, right and upper end in units, y upwards."""

    drawing: Drawing
    parts: tuple[DrawnPart, ...]
    extent: tuple[float, float, float, float]


def picture(drawn: Drawing) -> Picture:
    """The shapes of a drawing: those that :func:`matching.report.drawing.drivetrain.draw` draws, part by part."""
    axes = Figure().add_axes((0, 0, 1, 1))
    draw(axes, drawn)
    by_part: dict[str, list[Artist]] = {}
    for artist in axes.get_children():
        if isinstance(artist, Line2D | Patch | Text) and "." in str(artist.get_label()):
            by_part.setdefault(str(artist.get_label()), []).append(artist)
    parts = tuple(DrawnPart(name, tuple(_shapes(axes, artists))) for name, artists in by_part.items())
    (left, right), (lower, upper) = axes.get_xlim(), axes.get_ylim()
    boxes = [part.box for part in parts]  # a long name at an end reaches beyond the axes
    return Picture(drawn, parts, (
        min([left, *(box[0] - AROUND for box in boxes)]), min([lower, *(box[1] - AROUND for box in boxes)]),
        max([right, *(box[2] + AROUND for box in boxes)]), max([upper, *(box[3] + AROUND for box in boxes)]),
    ))  # fmt: skip


def _shapes(axes: Axes, artists: Iterable[Artist]) -> Iterable[Stroke | Area | Label]:
    for artist in sorted(artists, key=lambda each: each.get_zorder()):
        if isinstance(artist, Line2D):
            width = artist.get_linewidth() / POINTS_PER_UNIT
            yield Stroke(_points(artist.get_xydata()), to_hex(artist.get_color()), width, artist.is_dashed())
        elif isinstance(artist, Patch):
            outline = (artist.get_transform() - axes.transData).transform_path(artist.get_path())
            for corners in outline.to_polygons(closed_only=True):
                yield Area(
                    _points(corners), to_hex(artist.get_facecolor()), to_hex(artist.get_edgecolor()),
                    artist.get_linewidth() / POINTS_PER_UNIT, bool(artist.get_hatch()),
                )  # fmt: skip
        elif isinstance(artist, Text):
            (x, y), below = artist.get_position(), artist.get_verticalalignment() == "top"
            lines = tuple(line for line in artist.get_text().split("\n") if line)
            bold = artist.get_fontweight() == "bold"
            yield Label(x, y, lines, below, bold, to_hex(artist.get_color()), TEXT_POINTS / POINTS_PER_UNIT)


def _points(array: Any) -> tuple[tuple[float, float], ...]:
    return tuple((round(float(x), 3), round(float(y), 3)) for x, y in array)


def _places(shape: Stroke | Area | Label) -> Iterable[tuple[float, float]]:
    if isinstance(shape, Stroke):
        return shape.points
    if isinstance(shape, Area):
        return shape.corners
    letter = 0.3 if shape.bold else 0.27  # half its width over its height, on average
    half = letter * shape.height * max(map(len, shape.lines), default=0)
    tall = 1.2 * shape.height * len(shape.lines) * (-1 if shape.below else 1)
    return [(shape.x - half, shape.y), (shape.x + half, shape.y + tall)]
