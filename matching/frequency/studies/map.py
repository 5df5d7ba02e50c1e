"""The achievable error over two quantities: the delay budget and the adapter's size at a glance."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from matching.executors import executor_of
from matching.frequency.case.case import Case
from matching.frequency.case.case_file import case_files
from matching.frequency.solver.task import Near
from matching.frequency.studies.map_axis import Axis, axis, quantities
from matching.frequency.studies.map_passes import PointTask, improved
from matching.frequency.studies.map_point import Point, improved_at, match_at
from matching.studies import run
from modelling.common.display import Displayed, labelled
from modelling.common.errors import InputError
from modelling.common.version import VERSION


@dataclass(frozen=True)
class Map(Displayed):
    """Points (y, x) row by row over two axes."""

    title: str
    band: tuple[float, float]
    x: Axis
    y: Axis
    points: tuple[tuple[Point, ...], ...]

    def errors(self, which: str = "error") -> np.ndarray:
        """Response errors (y, x), or ``unmeasured`` or ``bound``; NaN where there is none."""
        values = [[getattr(point, which) for point in row] for row in self.points]
        return np.array([[np.nan if value is None else value for value in row] for row in values])

    def to_dict(self) -> dict[str, Any]:
        """The content of ``map.json``."""
        axes = {"x": self.x.to_dict(), "y": self.y.to_dict()}
        points = [point.to_dict() for row in self.points for point in row]
        return {"title": self.title, "band": list(self.band), **axes, "points": points}

    def to_xarray(self) -> Any:
        """Error and modulus margin over both quantities (xarray Dataset).

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        margins = [[point.modulus_margin for point in row] for row in self.points]
        margin = [[np.nan if value is None else value for value in row] for row in margins]
        names = [self.y.name, self.x.name]
        return labelled(
            {"error": (names, self.errors(), "1"), "modulus_margin": (names, np.array(margin), "1")},
            {axis.name: (list(axis.values), axis.unit) for axis in (self.y, self.x)},
        )


# more than six parameters: what is drawn, and how the study runs
def map_case(
    case: Case, x: Axis | str, y: Axis | str, executor: Executor | None = None, *, seed: int = 0, starts: int = 2,
    workers: int | None = None, record: Path | None = None, progress: Callable[[int, int], None] | None = None,
) -> Map:  # fmt: skip
    """Match a case at every pair of values of two quantities, first each point by itself, then from its neighbours.

    See :mod:`matching.frequency.studies.map_passes`. The map depends neither on the executor nor on the order in which
    points end.

    Parameters
    ----------
    x, y : Axis or str
        As :func:`axis` reads them.
    executor : concurrent.futures.Executor, optional
        Where the matches run; processes of this machine if none is given.
    seed, starts : int
        Of every match by itself.
    workers : int, optional
        Processes, where no executor is given.
    record : Path, optional
        File for finished points, from which a map that was stopped goes on.
    progress : callable, optional
        Called with (matches done, all matches so far known of).

    Raises
    ------
    InputError
        If a quantity is unknown, or both are the same.
    """
    x, y = (axis(case, end) if isinstance(end, str) else end for end in (x, y))
    together = quantities(case)[x.name].together
    if y.name in together:
        raise InputError(y.name, "is on both axes", "name two quantities")
    files = (f"{key}: {text}" for key, text in case_files(case).items())
    content = "\n".join([VERSION, *files, f"{x.name} {y.name} {seed} {starts}"])
    before = 0  # matches of the passes before

    def advance(done: int, total: int) -> None:
        if progress:
            progress(before + done, before + total)

    with nullcontext(executor) if executor else executor_of(workers) as pool:

        def solved(chunks: list[PointTask]) -> list[Any]:
            nonlocal before
            rows = run(
                _point_at, _prepare, (case, (x.name, y.name), seed, starts), chunks, pool,
                content=content, record=record, progress=advance,
            )  # fmt: skip
            before += len(chunks)
            return [None if row is None else Point.of(row) for row in rows]

        first = solved([{"x": a, "y": b} for b in y.values for a in x.values])
        width = len(x.values)
        points = improved([first[i : i + width] for i in range(0, len(first), width)], solved)
    return Map(case.title, case.band, x, y, tuple(tuple(row) for row in points))


Prepared = tuple[Case, tuple[str, str], int, int]


def _prepare(prepared: Prepared) -> Prepared:
    return prepared


def _point_at(prepared: Prepared, task: PointTask) -> dict[str, Any] | None:
    """A point as plain values: from starts of its own, or from its neighbours' solutions where there are such."""
    case, names, seed, starts = prepared
    x, y = zip(names, (task["x"], task["y"]), strict=True)
    if "near" not in task:
        return vars(match_at(case, x, y, seed, starts))
    point = improved_at(case, x, y, Near(tuple((values, pairs) for values, pairs in task["near"]), task["below"]))
    return None if point is None else vars(point)
