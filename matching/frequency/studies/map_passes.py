"""Points of a map improved from their neighbours, so that it is smooth where the truth is.

Single matches end in local optima now and then. In every pass each point is solved again from the solutions of those of
its four neighbours that changed in the pass before (in the first one: of all), and the better end is kept, until a
pass changes nothing. A pass depends on the results of the one before alone, so the order in which points end does not
matter, and each task states all that its result depends on, so a map that was stopped goes on. It ends: a point changes
only for the better, by more than half a percent of its objective.

What it does not do: where the margin is missed between the frequencies of the optimiser's grid, each end is repaired by
itself and may come out a few percent apart from its neighbours, which no start from them then mends.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from matching.frequency.studies.map_point import Point

PointTask = dict[str, Any]
Place = tuple[int, int]


def improved(points: Sequence[Sequence[Point]], solve: Callable[[list[PointTask]], list[Any]]) -> list[list[Point]]:
    """The points (y, x) after as many passes as it takes.

    Parameters
    ----------
    points : sequence
        Row by row, from starts of their own.
    solve : callable
        From tasks of one pass, plain values with ``x``, ``y``, ``below`` (objective to beat or None) and ``near``
        (tuned values by name and eigenpairs of each), to their results: a :class:`Point` or None where nothing better
        was found.
    """
    rows = [list(row) for row in points]
    changed = {(i, j) for i, row in enumerate(rows) for j in range(len(row))}
    while changed:
        asked = {place: near for place in _places(rows) if (near := _near(rows, place, changed))}
        tasks = [_task(rows[i][j], near) for (i, j), near in asked.items()]
        solved = solve(tasks) if tasks else []
        better = {
            place: new
            for place, new in zip(asked, solved, strict=True)
            if new is not None and new.beats(rows[place[0]][place[1]])
        }
        for (i, j), new in better.items():
            rows[i][j] = new.improving(rows[i][j])
        changed = set(better)
    return rows


def _places(rows: Sequence[Sequence[Point]]) -> list[Place]:
    """Of points that a match could be tried at."""
    return [(i, j) for i, row in enumerate(rows) for j, point in enumerate(row) if point.status != "impossible"]


def _near(rows: Sequence[Sequence[Point]], place: Place, changed: set[Place]) -> list[Point]:
    """The neighbours that changed and are solutions."""
    i, j = place
    changed_near = [rows[a][b] for a, b in ((i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)) if (a, b) in changed]
    return [neighbour for neighbour in changed_near if neighbour.objective is not None]


def _task(point: Point, near: list[Point]) -> PointTask:
    solutions = [[dict(neighbour.values), list(neighbour.pairs)] for neighbour in near]
    return {"x": point.x, "y": point.y, "below": point.objective, "near": solutions}
