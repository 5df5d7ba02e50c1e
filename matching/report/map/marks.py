"""Hatching of a map's points by what limits the match there: readable in grey and by colour-blind readers."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.patches import Patch, Rectangle

from matching.frequency.studies.map import Map
from matching.frequency.studies.map_point import Point
from matching.report.common.style import INK

HATCHES = {
    "impossible": ("**", "no match possible"),
    "stability": ("xx", "no stable loop found"),
    "targets": ("\\\\", "target mode not met"),
    "twist": ("//", "shaft twist above its limit"),
    "torque": ("||", "shaft torque above its limit"),
    "dynamometer_torque": ("--", "dynamometer torque above its limit"),
    "dynamometer_speed": ("++", "dynamometer speed above its limit"),
    "dynamometer_power": ("oo", "dynamometer power above its limit"),
    "modulus_margin": ("..", "modulus margin below its limit"),
    "response_error": ("/-", "response error above its tolerance"),
    "beds": ("\\|", "drawn beds not stable or damped too little"),
    "damping_ratio": ("OO", "damping ratio below its limit"),
}


def kinds(point: Point) -> tuple[str, ...]:
    """Keys of :data:`HATCHES` for what limits the match at a point."""
    if point.status == "impossible":
        return ("impossible",)
    return tuple(dict.fromkeys(name.rpartition(".")[2] for name in point.limited_by))


def hatch(axes: Any, result: Map, columns: np.ndarray, rows: np.ndarray) -> list[str]:
    """Hatch the field of every limited point and draw the border to the others.

    Parameters
    ----------
    axes : Axes
    result : Map
    columns, rows : ndarray (x + 1,), (y + 1,)
        Borders of the fields in x and in y.

    Returns
    -------
    list of str
        The keys of :data:`HATCHES` that occur.
    """
    limited = np.array([[bool(kinds(point)) for point in row] for row in result.points])
    occurring: set[str] = set()
    for i, row in enumerate(result.points):
        for j, point in enumerate(row):
            for kind in kinds(point):
                occurring.add(kind)
                size = columns[j + 1] - columns[j], rows[i + 1] - rows[i]
                look: Any = {"hatch": HATCHES[kind][0], "linewidth": 0, "facecolor": "none", "edgecolor": INK}
                axes.add_patch(Rectangle((columns[j], rows[i]), *size, zorder=2, **look))
    vertical = [((columns[j + 1], rows[i]), (columns[j + 1], rows[i + 1])) for i, j in _changes(limited)]
    horizontal = [((columns[j], rows[i + 1]), (columns[j + 1], rows[i + 1])) for j, i in _changes(limited.T)]
    axes.add_collection(LineCollection(vertical + horizontal, colors=INK, linewidths=1.6, zorder=3), autolim=False)
    return [kind for kind in HATCHES if kind in occurring]


def handles(occurring: list[str]) -> list[Patch]:
    """Entries of a legend."""
    patterns = [HATCHES[kind] for kind in occurring]
    return [Patch(facecolor="white", edgecolor=INK, hatch=pattern, label=words) for pattern, words in patterns]


def _changes(limited: np.ndarray) -> list[tuple[int, int]]:
    """Places at which a field differs from the next of its row."""
    return list(zip(*np.nonzero(limited[:, 1:] != limited[:, :-1]), strict=True))
