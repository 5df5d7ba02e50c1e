"""What holds a map's points up, marked by hatching, so that grey prints and colour-blind readers tell it apart."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.patches import Patch, Rectangle

from matching.frequency.studies.map import Map
from matching.frequency.studies.map_point import Point

INK = "#222222"
HATCHES = {
    "impossible": ("**", "no match possible"),
    "stability": ("xx", "no stable loop found"),
    "targets": ("\\\\", "target mode not met"),
    "twist": ("//", "shaft twist beyond its limit"),
    "torque": ("||", "shaft torque beyond its limit"),
    "dynamometer_torque": ("--", "dynamometer torque beyond its limit"),
    "dynamometer_speed": ("++", "dynamometer speed beyond its limit"),
    "dynamometer_power": ("oo", "dynamometer power beyond its limit"),
    "modulus_margin": ("..", "modulus margin not kept"),
    "damping_ratio": ("OO", "least damping not kept"),
}


def kinds(point: Point) -> tuple[str, ...]:
    """Keys of :data:`HATCHES` for what stands in a point's way."""
    if point.status == "impossible":
        return ("impossible",)
    return tuple(dict.fromkeys(name.rpartition(".")[2] for name in point.limited_by))


def hatch(axes: Any, found: Map, columns: np.ndarray, rows: np.ndarray) -> list[str]:
    """Hatch the field of every point that is held up and draw the border to the others; the kinds that were met."""
    held = np.array([[bool(kinds(point)) for point in row] for row in found.points])
    met: set[str] = set()
    for i, row in enumerate(found.points):
        for j, point in enumerate(row):
            for kind in kinds(point):
                met.add(kind)
                size = columns[j + 1] - columns[j], rows[i + 1] - rows[i]
                look: Any = {"hatch": HATCHES[kind][0], "linewidth": 0, "facecolor": "none", "edgecolor": INK}
                axes.add_patch(Rectangle((columns[j], rows[i]), *size, zorder=2, **look))
    upright = [((columns[j + 1], rows[i]), (columns[j + 1], rows[i + 1])) for i, j in zip(*_changes(held), strict=True)]
    across = [
        ((columns[j], rows[i + 1]), (columns[j + 1], rows[i + 1])) for j, i in zip(*_changes(held.T), strict=True)
    ]
    axes.add_collection(LineCollection(upright + across, colors=INK, linewidths=1.6, zorder=3), autolim=False)
    return [kind for kind in HATCHES if kind in met]


def handles(met: list[str]) -> list[Patch]:
    """Entries of a legend for kinds."""
    return [Patch(facecolor="white", edgecolor=INK, hatch=HATCHES[kind][0], label=HATCHES[kind][1]) for kind in met]


def _changes(held: np.ndarray) -> tuple[np.ndarray, ...]:
    """Where a field differs from the next of its row."""
    return np.nonzero(held[:, 1:] != held[:, :-1])
