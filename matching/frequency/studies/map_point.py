"""One point of a map: both quantities held, the rest matched, from starts of its own or from its neighbours' ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.case.demands import demands
from matching.frequency.case.tuned import apply
from matching.frequency.search.match import match
from matching.frequency.search.result import MatchResult
from matching.frequency.solver.task import Near, NoBetter
from matching.frequency.studies.map_axis import quantities
from matching.frequency.verification.observed import RobustVerification
from modelling.common.errors import InputError, unknown


@dataclass(frozen=True)
class Point:
    """A match with both quantities held.

    Attributes
    ----------
    status : str
        ``matched`` or ``limited``; ``impossible`` where no match could be tried, with the reason in ``limits`` and no
        errors.
    error, unmeasured, bound : float or None
        As :class:`matching.frequency.search.result.ResponseError` has them: ``after``, ``unmeasured``, ``bound``.
    limited_by : tuple of str
        What stands in the way, by name: ``stability``, ``targets``, or the limits of the case that are broken.
    objective, first : float or None
        What the optimiser minimised, and what it reached from starts of this point's own, before those of its
        neighbours were tried; None where no setting kept the constraints.
    values : dict of str to float
        Tuned values by name, SI.
    stable_beds : float or None
        Share of the drawn beds that are stable; None where no beds judge the match.
    pairs : tuple of float
        The goals' eigenpairs, see :class:`matching.frequency.solver.task.Solution`: what a neighbour starts from
        beside them.
    """

    x: float
    y: float
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
    pairs: tuple[float, ...] = ()

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Point:
        """From plain values, as a record holds them."""
        return cls(**{**row, **{key: tuple(row[key]) for key in ("limits", "limited_by", "pairs")}})

    def to_dict(self) -> dict[str, Any]:
        """As ``map.json`` holds it."""
        entries = {key: value for key, value in vars(self).items() if key not in ("first", "pairs")}
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
    """The case with a quantity at a value where it stays, whether it might move before or not; beds vary about it.

    Raises
    ------
    InputError
        If the name is unknown, the value impossible, or nothing would be left to move.
    """
    known = quantities(case)
    if name not in known:
        raise unknown(name, list(known), "")
    values = dict.fromkeys(known[name].together, value)
    moved = apply(case, values)
    left = tuple(move for move in case.moves if name not in move.together)
    if not left and not case.loop.structure.is_observer:
        raise InputError(name, "is all that may move", "let the case move something else as well")
    return replace(moved, moves=left)


def match_at(case: Case, x: tuple[str, float], y: tuple[str, float], seed: int, starts: int) -> Point:
    """One point, from starts of its own."""
    try:
        result = match(held_at(held_at(case, *x), *y), seed=seed, starts=starts, ordering=False)
    except InputError as fault:
        return Point(x[1], y[1], "impossible", None, None, None, False, None, (str(fault),))
    return _point(x[1], y[1], result)


def improved_at(case: Case, x: tuple[str, float], y: tuple[str, float], near: Near) -> Point | None:
    """The same point from its neighbours' solutions; None where that leads to nothing better.

    An observer's search always starts from the same weights, so a neighbour's leads to nothing else.
    """
    if case.loop.structure.is_observer:
        return None
    try:
        return _point(x[1], y[1], match(held_at(held_at(case, *x), *y), near=near))
    except NoBetter:
        return None


def _point(x: float, y: float, result: MatchResult) -> Point:
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
        values={parameter.name: parameter.tuned for parameter in result.parameters},
        pairs=tuple(result.pairs),
    )


def _limited_by(result: MatchResult) -> tuple[str, ...]:
    """Names of what stands in the way: as in ``search.limits``, without the words."""
    if not result.verification.stable:
        return ("stability",)
    rig = {f"rig.{name}": parameter.value for name, parameter in result.tuned.rig.parameters.items()}
    names = ["targets"] if any(not target.met for target in result.targets) else []
    names += [violation.limit for violation in result.verification.violations]
    names += [exceeded.limit for exceeded in demands(result.tuned).broken(rig)]
    if result.robust is not None:
        names += _not_kept_over_beds(result, result.robust)
    return tuple(dict.fromkeys(names))


def _not_kept_over_beds(result: MatchResult, robust: RobustVerification) -> list[str]:
    """Names of errors beyond their tolerance and of beds that are not stable or damped too little."""
    case, error, names = result.case, result.response_error, []
    if error.after > case.tolerance or error.unmeasured > case.unmeasured_tolerance:
        names.append("response_error")
    if not robust.beds.holds or (robust.beds.worst is not None and robust.beds.worst.damping_ratio <= 0):
        names.append("beds")
    return names


def _stable_share(robust: RobustVerification | None) -> float | None:
    return robust.beds.stable / robust.beds.drawn if robust is not None and robust.beds.drawn else None


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)
