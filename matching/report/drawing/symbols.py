"""The symbols of a drivetrain drawing, each drawn on axes at a place; lengths in units of the drawing."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch, Polygon, Rectangle

from matching.report.common.style import INK

LINE: dict[str, Any] = {"color": INK, "linewidth": 1.1, "solid_capstyle": "round"}
DISC_WIDTH = 0.26
ELEMENT = 0.75  # length of spring and damper
APART = 0.15  # of spring and damper from the shaft's axis
GEAR_RADIUS = 0.13


def line(axes: Axes, *points: tuple[float, float]) -> None:
    """A shaft without twist."""
    x, y = zip(*points, strict=True)
    axes.plot(x, y, **LINE)


def disc(axes: Axes, x: float, y: float, half: float, colour: str, *, emulated: bool) -> None:
    """An inertia seen from the side; hatched where software stands in for it."""
    axes.add_patch(
        Rectangle(
            (x - DISC_WIDTH / 2, y - half), DISC_WIDTH, 2 * half, facecolor=colour, edgecolor=INK, linewidth=1.1,
            hatch="////" if emulated else None, zorder=3,
        )
    )  # fmt: skip


def spring_and_damper(axes: Axes, x: float, y: float, *, damped: bool) -> None:
    """A torsion spring, in parallel with a damper where there is one, centred at x."""
    left, right = x - ELEMENT / 2, x + ELEMENT / 2
    up = y + APART if damped else y
    t = np.linspace(0, 1, 10)
    across = np.array([0, 0, 1, -1, 1, -1, 1, -1, 0, 0]) * 0.09
    axes.plot(left + ELEMENT * t, up + across, **LINE)
    if not damped:
        return
    down, cup = y - APART, x + 0.1
    for end in (left, right):
        line(axes, (end, up), (end, down))
    line(axes, (left, down), (x - 0.02, down))
    line(axes, (x - 0.02, down - 0.07), (x - 0.02, down + 0.07))  # piston
    line(axes, (x - 0.14, down + 0.1), (cup, down + 0.1), (cup, down - 0.1), (x - 0.14, down - 0.1))
    line(axes, (cup, down), (right, down))


def gear_pair(axes: Axes, x: float, y: float) -> None:
    """Two wheels in mesh."""
    for side in (1, -1):
        place = (x, y + side * GEAR_RADIUS)
        axes.add_patch(Circle(place, GEAR_RADIUS, facecolor="white", edgecolor=INK, linewidth=1.1, zorder=3))
        axes.add_patch(Circle(place, 0.02, color=INK, zorder=4))


def differential(axes: Axes, x: float, y: float) -> None:
    """The cage of an open differential."""
    corners = [(x - 0.22, y), (x, y + 0.22), (x + 0.22, y), (x, y - 0.22)]
    axes.add_patch(Polygon(corners, closed=True, facecolor="white", edgecolor=INK, linewidth=1.1, zorder=3))
    for corner, other in (((-1, -1), (1, 1)), ((-1, 1), (1, -1))):
        axes.plot(
            [x + 0.09 * corner[0], x + 0.09 * other[0]], [y + 0.09 * corner[1], y + 0.09 * other[1]], zorder=4, **LINE
        )


def machine(axes: Axes, x: float, y: float, half: float, colour: str) -> None:
    """The housing of a dynamometer round its rotor."""
    wide, high = DISC_WIDTH / 2 + 0.2, half + 0.12
    axes.add_patch(
        FancyBboxPatch(
            (x - wide, y - high), 2 * wide, 2 * high, boxstyle="round,pad=0.02,rounding_size=0.1",
            facecolor="white", edgecolor=colour, linewidth=1.6, zorder=1,
        )
    )  # fmt: skip


def cut(axes: Axes, x: float, y: float, colour: str) -> None:
    """The cut through a shaft."""
    axes.plot([x, x], [y - 0.36, y + 0.36], color=colour, linewidth=1.8, linestyle=(0, (4, 2)), zorder=5)
