"""The achievable error over one or two quantities: the delay budget and the adapter's size at a glance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from matching.match.beds import quantile
from matching.match.case import Case, apply
from matching.match.case_file import case_files
from matching.match.match import attempt, judged, match
from matching.match.movable import Movable, movable
from matching.match.requirements import OPENED_SHAFTS
from matching.match.result import MatchResult
from matching.match.variables import SearchSettings
from matching.match.verify import Verification
from matching.studies import run
from matching.worker_pool import executor_of
from modelling.display import Displayed, labelled
from modelling.errors import VERSION, InputError, NoDesign, unknown
from modelling.units import to_si

# --- Axes of a map: a quantity of the case and its values.

STEPS = 5
MOST_VALUES = 100  # values an axis
GEOMETRIC_FROM_RATIO = 4.0  # from this ratio on values are spread by ratio, not by difference
RANGES = {"loop.dead_time": (5e-4, 8e-3), "loop.inverter_lag": (5e-4, 8e-3), "loop.sample_time": (2.5e-4, 4e-3)}


@dataclass(frozen=True)
class Axis:
    """A quantity and its values (n,), SI; ``here`` is what the case has."""

    name: str
    unit: str
    values: tuple[float, ...]
    here: float

    def to_dict(self) -> dict[str, Any]:
        """As ``map.json`` holds it."""
        return {"name": self.name, "unit": self.unit, "values": list(self.values), "value_in_case": self.here}

    @property
    def by_ratio(self) -> bool:
        """Whether the values lie more evenly on a logarithmic axis."""
        if self.values[0] <= 0 or len(self.values) < 2:
            return False
        plain, log = np.diff(self.values), np.diff(np.log(self.values))
        return bool(log.std() / log.mean() < plain.std() / plain.mean())


def quantities(case: Case) -> dict[str, Movable]:
    """Every quantity of a case that can be set, by name."""
    return movable(case.rig, case.residual_vehicle, case.loop)


def axis(case: Case, text: str, where: str = "") -> Axis:
    """An axis from ``QUANTITY``, ``QUANTITY=LOW:HIGH[:N]`` or ``QUANTITY=VALUE,VALUE,…``; SI or each with a unit.

    Without values those of the case's ``[move]`` are taken, else a third to three times what the case has.
    """
    name, equals, span = text.partition("=")
    known = quantities(case)
    if name not in known:
        raise unknown(name, list(known), where)
    here, unit, _ = known[name]
    low, high = _usual(case, name, here)
    if not equals:
        values = _spread(low, high, STEPS)
    elif "," in span:
        values = tuple(_si(part, unit, where, name) for part in span.split(","))
    else:
        values = _range(span, unit, where, name)
    if any(a >= b for a, b in pairwise(values)):
        raise InputError(
            where,
            f"{span!r} is no row of rising values of {name}",
            "give every value once, least first, with decimal points",
        )
    if len(values) > MOST_VALUES:
        raise InputError(where, f"{len(values)} values of {name} are too many", f"2 … {MOST_VALUES} are needed")
    _check(case, name, values[0], values[-1], where)
    return Axis(name, unit, values, here)


def _range(span: str, unit: str, where: str, name: str) -> tuple[float, ...]:
    """Values of LOW:HIGH or LOW:HIGH:N."""
    parts = span.split(":")
    if len(parts) not in (2, 3):
        right = f"write {name}=LOW:HIGH, {name}=LOW:HIGH:N or {name}=VALUE,VALUE"
        raise InputError(where, f"{span!r} is no range", right)
    if len(parts) == 3 and (not parts[2].strip().isdigit() or not 2 <= int(parts[2]) <= MOST_VALUES):
        raise InputError(where, f"{parts[2]!r} is no number of values", f"2 … {MOST_VALUES} are needed")
    low, high = (_si(part, unit, where, name) for part in parts[:2])
    if not low < high:
        raise InputError(where, f"{low:g} … {high:g} is an empty range of {name}", "LOW < HIGH is needed")
    return _spread(low, high, int(parts[2]) if len(parts) == 3 else STEPS)


def _spread(low: float, high: float, count: int) -> tuple[float, ...]:
    """So many values: by ratio where they reach far, else by difference."""
    spaced = np.geomspace if low > 0 and high >= GEOMETRIC_FROM_RATIO * low else np.linspace
    return tuple(spaced(low, high, count).tolist())


def _si(text: str, unit: str, where: str, name: str) -> float:
    return to_si(_number(text), unit, f"{where} {name}".strip())


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
        knob = case.loop.quantities[name.removeprefix("loop.")]
        lower, upper = knob.lower, knob.upper
    if low < lower or high > upper or (low <= 0 and name.rsplit(".", 1)[1] in ("J", "ratio", "length", "diameter")):
        raise InputError(where, f"{low:g} … {high:g} of {name} is not possible", f"{lower:g} … {upper:g} is")


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


# --- One point of a map: both quantities held, the rest matched, from starts of its own or from its neighbours' ends.


@dataclass(frozen=True)
class Point:
    """A match with the quantities of the axes held.

    Attributes
    ----------
    x, y : float
        Their values; ``y`` is None in a sweep of one quantity.
    status : str
        ``matched`` or ``limited``; ``impossible`` where no match could be tried, with the reason in ``limits`` and no
        errors.
    error, unmeasured, bound : float or None
        As :class:`matching.match.responses.ResponseError` has them: ``after``, ``unmeasured``, ``bound``.
    limited_by : tuple of str
        What stands in the way, by name: ``stability``, ``targets``, or the limits of the case that are broken.
    objective, first : float or None
        What the optimiser minimised, and what it reached from starts of this point's own, before those of its
        neighbours were tried; None where no setting kept the constraints.
    values : dict of str to float
        Tuned values by name, SI.
    stable_beds : float or None
        Share of the drawn beds that are stable; None where no beds judge the match.
    planned_error, bed_error : float or None
        Root mean square of both errors over their tolerances, as an order is judged by: of the bed as planned, and of
        the medians of drawn beds.
    """

    x: float
    y: float | None
    status: str
    error: float | None
    unmeasured: float | None
    bound: float | None
    stable: bool
    modulus_margin: float | None
    limits: tuple[str, ...]
    limited_by: tuple[str, ...] = ()
    objective: float | None = None
    first: float | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    stable_beds: float | None = None
    planned_error: float | None = None
    bed_error: float | None = None

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Point:
        """From plain values, as a record holds them."""
        return cls(**{**row, **{key: tuple(row[key]) for key in ("limits", "limited_by")}})

    def to_dict(self) -> dict[str, Any]:
        """As ``map.json`` holds it."""
        entries = {key: value for key, value in vars(self).items() if key != "first"}
        return {**entries, "objective_from_own_starts": self.first}

    def beats(self, other: Point) -> bool:
        """Whether it is matched where the other is not, stable where the other is not, or of a smaller objective."""
        return self._rank() < other._rank()

    def improving(self, other: Point) -> Point:
        """This one in the place of the other, whose own first objective it keeps."""
        return replace(self, first=other.first)

    def _rank(self) -> tuple[bool, bool, float]:
        return self.status != "matched", not self.stable, np.inf if self.objective is None else self.objective


def held_at(case: Case, name: str, value: float) -> Case:
    """The case with a quantity at a value where it stays, whether it might move before or not; beds vary about it."""
    known = quantities(case)
    if name not in known:
        raise unknown(name, list(known), "")
    values = dict.fromkeys(known[name].together, value)
    moved = apply(case, values)
    left = tuple(move for move in case.moves if name not in move.together)
    if not left and not case.loop.tunes_observer:
        raise InputError(name, "is all that may move", "let the case move something else as well")
    return replace(moved, moves=left)


# a feedback law's search at a point: its neighbours improve it
OF_A_POINT = SearchSettings(drawn=8, pool=32, joint_rounds=1, restarts=0, scenarios=0, blind=0, fresh=40, emulated=0.0)


Held = tuple[str, float]


def _held(case: Case, x: Held, y: Held | None) -> Case:
    return held_at(case, *x) if y is None else held_at(held_at(case, *x), *y)


def match_at(case: Case, x: Held, y: Held | None, seed: int, starts: int) -> Point:
    """One point, from starts of its own."""
    try:
        settings = replace(SearchSettings(), emulated=0.0) if case.loop.tunes_observer else OF_A_POINT
        result = match(_held(case, x, y), seed=seed, starts=starts, ordering=False, settings=settings)
    except NoDesign as fault:
        return Point(x[1], y and y[1], "impossible", None, None, None, False, None, (str(fault),))
    return _point(x[1], y and y[1], result)


AGREEMENT = 5e-3  # relative: starts that end so close count as one optimum


@dataclass(frozen=True)
class Near:
    """Solutions of neighbours to start from: values by name (SI) of each, and the objective that has to be beaten."""

    solutions: tuple[Mapping[str, float], ...]
    below: float | None = None

    def beaten_by(self, objective: float) -> bool:
        """Whether an objective is lower by more than ends of one optimum differ."""
        return self.below is None or objective < self.below - AGREEMENT * abs(self.below)


def improved_at(case: Case, x: Held, y: Held | None, near: Near) -> Point | None:
    """The same point from its neighbours' solutions; None where that leads to nothing better.

    An observer's search always starts from the same weights, so a neighbour's leads to nothing else.
    """
    if case.loop.tunes_observer:
        return None
    settings = replace(OF_A_POINT, rounds=1, joint_rounds=1)
    try:
        found = attempt(_held(case, x, y), ordering=False, begins=near.solutions, settings=settings)
        if not near.beaten_by(found.solution.cost):
            return None
        return _point(x[1], y and y[1], judged(found, ordering=False))
    except NoDesign:
        return None


def _point(x: float, y: float | None, result: MatchResult) -> Point:
    error, verification, objective = result.response_error, result.verification, _finite(result.objective)
    return Point(
        x=x,
        y=y,
        status=result.status,
        error=_finite(error.after),
        unmeasured=_finite(error.unmeasured),
        bound=_finite(error.bound),
        stable=bool(verification.stable),
        modulus_margin=_finite(verification.modulus_margin),
        limits=tuple(result.limits),
        limited_by=_limited_by(result),
        objective=objective,
        first=objective,
        stable_beds=_stable_share(result.robust),
        planned_error=_both(result, error.after, error.unmeasured),
        bed_error=_of_beds(result),
        values={parameter.name: parameter.tuned for parameter in result.parameters},
    )


# by the cause of a finding the word of a map; a limit of the case has its own name
WORD_OF_CAUSE = {
    "not_stable": "stability", "methods_disagree": "stability", "target_missed": "targets",
    "response_error": "response_error", "beds_not_stable": "beds", "beds_damping": "beds", "worst_bed": "beds",
    "free_play": OPENED_SHAFTS, "standstill": "standstill", "emulation_left": "supervision", "roll_off": "rolled_off",
    "command_noise": "command_noise", "sensor_offset": "sensor_offset", "slow_feed_forward": "feed_forward",
    "dead_time_alone": "response_error", "other_specimen": "response_error",
}  # fmt: skip


def _limited_by(result: MatchResult) -> tuple[str, ...]:
    """Names of what stands in the way, without the words."""
    limiting = [one for one in result.findings if one.limits]
    names = [one.data.get("limit", WORD_OF_CAUSE.get(one.cause, "")) for one in limiting]
    return ("stability",) if "stability" in names else tuple(dict.fromkeys(name for name in names if name))


def _stable_share(robust: Verification | None) -> float | None:
    beds = None if robust is None else robust.beds
    return beds.stable / beds.drawn if beds is not None and beds.drawn else None


def _both(result: MatchResult, measured: float | None, unmeasured: float | None) -> float | None:
    """Both errors over their scales as one."""
    if measured is None or unmeasured is None:
        return None
    return _finite(result.case.error_scales.both(measured, unmeasured))


def _of_beds(result: MatchResult) -> float | None:
    """The same of the medians of drawn beds; None without any."""
    beds = result.verification.beds
    return None if beds is None else _both(result, quantile(beds.measured, 0.5), quantile(beds.unmeasured, 0.5))


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)


# --- Points of a map improved from their neighbours, so that it is smooth where the truth is.
#
# Single matches end in local optima now and then. In every pass each point is solved again from the solutions of those
# of its four neighbours that changed in the pass before (in the first one: of all), and the better end is kept, until a
# pass changes nothing. A pass depends on the results of the one before alone, so the order in which points end does not
# matter, and each task states all that its result depends on, so a map that was stopped goes on. It ends: a point
# changes only for the better, by more than half a percent of its objective.
#
# What it does not do: where the margin is missed between the frequencies of the optimiser's grid, each end is repaired
# by itself and may come out a few percent apart from its neighbours, which no start from them then mends.

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
        (tuned values by name of each), to their results: a :class:`Point` or None where nothing better
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
    solutions = [dict(neighbour.values) for neighbour in near]
    return {"x": point.x, "y": point.y, "below": point.objective, "near": solutions}


# --- Map


@dataclass(frozen=True)
class Map(Displayed):
    """Points (y, x) row by row over two axes; of a sweep, whose ``y`` is None, one row."""

    title: str
    band: tuple[float, float]
    x: Axis
    y: Axis | None
    points: tuple[tuple[Point, ...], ...]

    def errors(self, which: str = "error") -> np.ndarray:
        """Response errors (y, x), or ``unmeasured`` or ``bound``; NaN where there is none."""
        values = [[getattr(point, which) for point in row] for row in self.points]
        return np.array([[np.nan if value is None else value for value in row] for row in values])

    def to_dict(self) -> dict[str, Any]:
        """The content of ``map.json``."""
        axes = {"x": self.x.to_dict(), "y": None if self.y is None else self.y.to_dict()}
        points = [point.to_dict() for row in self.points for point in row]
        return {"title": self.title, "band": list(self.band), **axes, "points": points}

    def to_xarray(self) -> Any:
        """Error and modulus margin over the quantities (xarray Dataset)."""
        margins = [[point.modulus_margin for point in row] for row in self.points]
        margin = [[np.nan if value is None else value for value in row] for row in margins]
        axes = [axis for axis in (self.y, self.x) if axis is not None]
        names, shape = [axis.name for axis in axes], [len(axis.values) for axis in axes]
        return labelled(
            {
                "error": (names, self.errors().reshape(shape), "1"),
                "modulus_margin": (names, np.array(margin).reshape(shape), "1"),
            },
            {axis.name: (list(axis.values), axis.unit) for axis in axes},
        )


def map_case(
    case: Case, x: Axis | str, y: Axis | str | None, executor: Executor | None = None, *,
    seed: int = 0, starts: int = 2,
    workers: int | None = None, record: Path | None = None, progress: Callable[[int, int], None] | None = None,
) -> Map:  # fmt: skip
    """Match a case at every value of a quantity or pair of two: first each point by itself, then from its neighbours.

    See :mod:`matching.match.map`. The map depends neither on the executor nor on the order in which
    points end.

    Parameters
    ----------
    x, y : Axis or str
        As :func:`axis` reads them; ``y`` may be None.
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
    """
    x = axis(case, x) if isinstance(x, str) else x
    y = axis(case, y) if isinstance(y, str) else y
    together = quantities(case)[x.name].together
    if y is not None and y.name in together:
        raise InputError(y.name, "is on both axes", "name two quantities")
    files = (f"{key}: {text}" for key, text in case_files(case).items())
    names = x.name, None if y is None else y.name
    content = "\n".join([VERSION, *files, f"{names[0]} {names[1]} {seed} {starts}"])
    before = 0  # matches of the passes before

    def advance(done: int, total: int) -> None:
        if progress:
            progress(before + done, before + total)

    with nullcontext(executor) if executor else executor_of(workers) as pool:

        def solved(chunks: list[PointTask]) -> list[Any]:
            nonlocal before
            rows = run(
                _point_at, _prepare, (case, names, seed, starts), chunks, pool,
                content=content, record=record, progress=advance,
            )  # fmt: skip
            before += len(chunks)
            return [None if row is None else Point.of(row) for row in rows]

        first = solved([{"x": a, "y": b} for b in ([None] if y is None else y.values) for a in x.values])
        width = len(x.values)
        points = improved([first[i : i + width] for i in range(0, len(first), width)], solved)
    return Map(case.title, case.band, x, y, tuple(tuple(row) for row in points))


Prepared = tuple[Case, tuple[str, str | None], int, int]


def _prepare(prepared: Prepared) -> Prepared:
    return prepared


def _point_at(prepared: Prepared, task: PointTask) -> dict[str, Any] | None:
    """A point as plain values: from starts of its own, or from its neighbours' solutions where there are such."""
    case, names, seed, starts = prepared
    x = names[0], task["x"]
    y = None if names[1] is None else (names[1], task["y"])
    if "near" not in task:
        return vars(match_at(case, x, y, seed, starts))
    point = improved_at(case, x, y, Near(tuple(task["near"]), task["below"]))
    return None if point is None else vars(point)
