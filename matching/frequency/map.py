"""The achievable error over two quantities: the delay budget and the adapter's size at a glance."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from matching import __version__
from matching.frequency.case import Case, movable
from matching.frequency.case_file import case_files
from matching.frequency.tuned import apply
from matching.studies import executor_of, run
from modelling.errors import InputError
from modelling.loop import HARDWARE, KNOBS
from modelling.shown import Shown, labelled
from modelling.system import unknown
from modelling.units import to_si

STEPS = 5
MOST = 100  # values an axis
WIDE = 4.0  # from this ratio on values are spread by ratio, not by difference
RANGES = {"loop.dead_time": (5e-4, 8e-3), "loop.inverter_lag": (5e-4, 8e-3), "loop.sample_time": (2.5e-4, 4e-3)}


@dataclass(frozen=True)
class Axis:
    """A quantity and its values (n,), SI; ``here`` is what the case has."""

    name: str
    unit: str
    values: tuple[float, ...]
    here: float

    @property
    def by_ratio(self) -> bool:
        """Whether the values are better drawn on a logarithmic axis."""
        return self.values[0] > 0 and self.values[-1] >= WIDE * self.values[0]


@dataclass(frozen=True)
class Point:
    """A match with both quantities held.

    ``status`` is ``matched`` or ``limited``; ``impossible`` where no match could be tried, with the reason in
    ``limits`` and no errors.
    """

    x: float
    y: float
    status: str
    error: float | None
    unannounced: float | None
    bound: float | None
    stable: bool
    modulus_margin: float | None
    limits: tuple[str, ...]


@dataclass(frozen=True)
class Map(Shown):
    """Points (y, x) row by row over two axes."""

    title: str
    band: tuple[float, float]
    x: Axis
    y: Axis
    points: tuple[tuple[Point, ...], ...]

    _view = "matching.report.views.map"

    def errors(self) -> np.ndarray:
        """Response errors (y, x), NaN where there is none."""
        return np.array([[np.nan if own.error is None else own.error for own in row] for row in self.points])

    def to_dict(self) -> dict[str, Any]:
        """The content of ``map.json``."""
        axes = {key: {**vars(axis), "values": list(axis.values)} for key, axis in (("x", self.x), ("y", self.y))}
        points = [vars(own) for row in self.points for own in row]
        return {"title": self.title, "band": list(self.band), **axes, "points": points}

    def to_xarray(self) -> Any:
        """Error and modulus margin over both quantities (xarray Dataset).

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        margin = [[np.nan if own.modulus_margin is None else own.modulus_margin for own in row] for row in self.points]
        names = [self.y.name, self.x.name]
        return labelled(
            {"error": (names, self.errors(), "1"), "modulus_margin": (names, np.array(margin), "1")},
            {axis.name: (list(axis.values), axis.unit) for axis in (self.y, self.x)},
        )


def quantities(case: Case) -> dict[str, tuple[float, str, tuple[str, ...]]]:
    """Every quantity of a case that can be set: value, SI unit, and it with its mirror image."""
    return movable(case.rig, case.residual_vehicle, case.loop)


def axis(case: Case, text: str, where: str = "") -> Axis:
    """An axis from ``QUANTITY``, ``QUANTITY=LOW:HIGH`` or ``QUANTITY=LOW:HIGH:N``; bounds in SI or with a unit.

    Without bounds those of the case's ``[move]`` are taken, else a third to three times what the case has.

    Raises
    ------
    InputError
        If the quantity is unknown, or the range is empty or impossible.
    """
    name, given, span = text.partition("=")
    known = quantities(case)
    if name not in known:
        raise unknown(name, list(known), where)
    here, unit, _ = known[name]
    low, high = _usual(case, name, here)
    count = STEPS
    if given:
        parts = span.split(":")
        if len(parts) not in (2, 3):
            raise InputError(where, f"{span!r} is no range", f"write {name}=LOW:HIGH or {name}=LOW:HIGH:N")
        low, high = (to_si(_number(part), unit, f"{where} {name}".strip()) for part in parts[:2])
        if len(parts) == 3:
            if not parts[2].strip().isdigit() or not 2 <= int(parts[2]) <= MOST:
                raise InputError(where, f"{parts[2]!r} is no number of values", f"2 … {MOST} are needed")
            count = int(parts[2])
    if not low < high:
        raise InputError(where, f"{low:g} … {high:g} is an empty range of {name}", "LOW < HIGH is needed")
    _check(case, name, low, high, where)
    values = np.geomspace(low, high, count) if low > 0 and high >= WIDE * low else np.linspace(low, high, count)
    return Axis(name, unit, tuple(values.tolist()), here)


def map_case(
    case: Case,
    x: Axis | str,
    y: Axis | str,
    executor: Executor | None = None,
    *,
    seed: int = 0,
    starts: int = 2,
    workers: int | None = None,
    record: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Map:
    """Match a case at every pair of values of two quantities.

    Parameters
    ----------
    x, y : Axis or str
        As :func:`axis` reads them.
    executor : concurrent.futures.Executor, optional
        Where the matches run; processes of this machine if none is given.
    seed, starts : int
        Of every match.
    workers : int, optional
        Processes, where no executor is given.
    record : Path, optional
        File for finished points, from which a map that was stopped goes on.
    progress : callable, optional
        Called with (points done, all points).

    Raises
    ------
    InputError
        If a quantity is unknown, or both are the same.
    """
    x, y = (axis(case, own) if isinstance(own, str) else own for own in (x, y))
    together = quantities(case)[x.name][2]
    if y.name in together:
        raise InputError(y.name, "is on both axes", "name two quantities")
    chunks = [{x.name: a, y.name: b} for b in y.values for a in x.values]
    content = "\n".join(
        [__version__, *(f"{key}: {text}" for key, text in case_files(case).items()), f"{seed} {starts}"]
    )
    with nullcontext(executor) if executor else executor_of(workers) as own:
        rows = run(
            _match_chunk, _prepare, (case, (x.name, y.name), seed, starts), chunks, own,
            content=content, record=record, progress=progress,
        )  # fmt: skip
    points = [Point(**{**row, "limits": tuple(row["limits"])}) for row in rows]
    width = len(x.values)
    return Map(case.title, case.band, x, y, tuple(tuple(points[i : i + width]) for i in range(0, len(points), width)))


Prepared = tuple[Case, tuple[str, str], int, int]


def _prepare(given: Prepared) -> Prepared:
    return given


def _match_chunk(given: Prepared, chunk: dict[str, float]) -> dict[str, Any]:
    case, (x, y), seed, starts = given
    return vars(match_at(case, (x, chunk[x]), (y, chunk[y]), seed, starts))


def held_at(case: Case, name: str, value: float) -> Case:
    """The case with a quantity at a value where it stays, whether it might move before or not.

    Raises
    ------
    InputError
        If the name is unknown, the value impossible, or nothing would be left to move.
    """
    known = quantities(case)
    if name not in known:
        raise unknown(name, list(known), "")
    moved = apply(case, dict.fromkeys(known[name][2], value))
    left = tuple(move for move in case.moves if name not in move.together)
    if not left:
        raise InputError(name, "is all that may move", "let the case move something else as well")
    return replace(moved, moves=left)


def match_at(case: Case, x: tuple[str, float], y: tuple[str, float], seed: int, starts: int) -> Point:
    """One point of a map: both quantities held, the rest matched."""
    from matching.frequency.match import match

    try:
        result = match(held_at(held_at(case, *x), *y), seed=seed, starts=starts)
    except InputError as fault:
        return Point(x[1], y[1], "impossible", None, None, None, False, None, (str(fault),))
    error, seen = result.response_error, result.verification
    return Point(
        x[1],
        y[1],
        result.status,
        _finite(error.after),
        _finite(error.unannounced),
        _finite(error.bound),
        bool(seen.stable),
        _finite(seen.modulus_margin),
        tuple(result.limits),
    )


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)


def _usual(case: Case, name: str, here: float) -> tuple[float, float]:
    for move in case.moves:
        if name in move.together:
            return move.lower, move.upper
    if name in RANGES:
        return RANGES[name]
    return (here / 3, here * 3) if here else (0.0, 1.0)


def _check(case: Case, name: str, low: float, high: float, where: str) -> None:
    lower, upper = 0.0, np.inf
    if name.startswith("loop."):
        knob = (HARDWARE | KNOBS[case.loop.structure])[name.removeprefix("loop.")]
        lower, upper = knob.lower, knob.upper
    if low < lower or high > upper or (low <= 0 and name.rsplit(".", 1)[1] in ("J", "ratio")):
        raise InputError(where, f"{low:g} … {high:g} of {name} is not possible", f"{lower:g} … {upper:g} is")


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
