"""What a workshop or a supplier has to know of the adapters of a match: values, ranges that serve, and loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.match.case import Case, Move
from matching.match.demands import stresses
from matching.match.result import MatchResult
from matching.match.variables import RIG
from modelling.system import MOVABLE_DIMENSIONS, Drawing, Shaft
from modelling.units import QUANTITY_UNITS

SAME = 1e-9  # relative, up to which a value is as planned


@dataclass(frozen=True)
class OrderedValue:
    """One value of a part, SI.

    Attributes
    ----------
    key, unit : str
    planned, ordered : float
    serves : tuple of float or None
        The range that serves as well; None where it is not known.
    bounds : tuple of float or None
        What ``[move]`` allows; None of what follows from other values, or stays.
    at_bound : bool
        Whether the order ends at one of them.
    catalogue : tuple of float
        Parts that can be bought; empty where any value can be made.
    """

    key: str
    unit: str
    planned: float
    ordered: float
    serves: tuple[float, float] | None = None
    bounds: tuple[float, float] | None = None
    at_bound: bool = False
    catalogue: tuple[float, ...] = ()

    @property
    def changes(self) -> bool:
        """Whether it is not what was planned."""
        return abs(self.ordered - self.planned) > SAME * max(abs(self.ordered), abs(self.planned))


@dataclass(frozen=True)
class Load:
    """What the manoeuvre takes of a part, and what the case allows (None: it sets no limit), SI."""

    what: str
    unit: str
    value: float
    limit: float | None


@dataclass(frozen=True)
class OrderedPart:
    """A part of the rig that may change: ``place`` is ``shafts.NAME`` or ``inertias.NAME``.

    Attributes
    ----------
    place : str
    also : tuple of str
        Mirror images, which are ordered alike.
    drawing : Drawing or None
        As ordered, of a shaft that is stated by its drawing.
    values : tuple of OrderedValue
        What may move first, then what follows from it.
    loads : tuple of Load
        Of a shaft; empty where the manoeuvre could not be simulated.
    """

    place: str
    also: tuple[str, ...]
    drawing: Drawing | None
    values: tuple[OrderedValue, ...]
    loads: tuple[Load, ...]

    @property
    def changes(self) -> bool:
        """Whether something of it is not what was planned."""
        return any(value.changes for value in self.values)


def ordered_parts(result: MatchResult) -> tuple[OrderedPart, ...]:
    """Every part of the rig that may change, in the order of ``[move]``."""
    moves: dict[str, list[Move]] = {}
    for move in result.case.moves:
        if move.name.startswith(RIG):
            moves.setdefault(move.name.removeprefix(RIG).rpartition(".")[0], []).append(move)
    return tuple(_part(result, place, some) for place, some in moves.items())


def _part(result: MatchResult, place: str, moves: Sequence[Move]) -> OrderedPart:
    shafts = {f"shafts.{shaft.name}": shaft for shaft in result.tuned.rig.shafts}
    shaft = shafts.get(place)
    also = dict.fromkeys(name.removeprefix(RIG).rpartition(".")[0] for move in moves for name in move.together)
    also.pop(place, None)
    values = [_moved(result, move) for move in moves]
    if shaft is not None and shaft.drawing is not None:
        values += _by_drawing(result.case, shaft, values)
    loads = [] if shaft is None else _loads(result, [shaft, *(shafts[other] for other in also)])
    return OrderedPart(place, tuple(also), None if shaft is None else shaft.drawing, tuple(values), tuple(loads))


def _moved(result: MatchResult, move: Move) -> OrderedValue:
    row = next(one for one in result.parameters if one.name == move.name)
    trade = next((one for one in result.adapters if one.name == move.name), None)
    return OrderedValue(
        move.name.rpartition(".")[2], move.unit, move.planned, row.tuned, None if trade is None else trade.acceptable,
        (move.lower, move.upper), row.at_bound, move.catalogue,
    )  # fmt: skip


def _by_drawing(case: Case, shaft: Shaft, moved: Sequence[OrderedValue]) -> list[OrderedValue]:
    """Dimensions that stay, and the stiffness and inertia that follow; of one dimension that moves with their range."""
    planned, drawing = next(one.drawing for one in case.rig.shafts if one.name == shaft.name), shaft.drawing
    if planned is None or drawing is None:
        return []
    own = {value.key for value in moved}
    made = [
        OrderedValue(key, "m", getattr(planned, key).value, getattr(drawing, key).value)
        for key in MOVABLE_DIMENSIONS
        if key not in own and (getattr(drawing, key).value or key != "inner_diameter")
    ]
    sizes = [value for value in moved if value.key in MOVABLE_DIMENSIONS]
    ends: list[Drawing] = []
    if len(sizes) == 1 and sizes[0].serves is not None:
        ends = [drawing.with_sizes({sizes[0].key: end}) for end in sizes[0].serves]
    for key, unit in (("stiffness", QUANTITY_UNITS["stiffness"]), ("inertia", QUANTITY_UNITS["J"])):
        if key not in own:
            found = sorted(getattr(one, key).value for one in ends)
            serves = (found[0], found[1]) if found else None
            made.append(OrderedValue(key, unit, getattr(planned, key).value, getattr(drawing, key).value, serves))
    return made


def _loads(result: MatchResult, shafts: Sequence[Shaft]) -> list[Load]:
    """The largest of each load over a shaft and its mirror images, in the manoeuvre and in the case's drives."""
    traces = result.verification.traces
    if traces is None:
        return []
    found: dict[str, Load] = {}
    for shaft in shafts:
        place = f"shafts.{shaft.name}"
        if f"{place}.torque" not in traces.matched:
            continue
        drives = () if result.driving is None else result.driving.drives
        torques = [traces.absolute(f"{place}.torque")]
        torques += [drive.torques[shaft.name] for drive in drives if shaft.name in drive.torques]
        values = {
            "torque": ("N*m", max(float(np.abs(one).max()) for one in torques)),
            "torque amplitude": ("N*m", max(float(np.ptp(one)) / 2 for one in torques)),
        }
        if f"{place}.twist" in traces.matched:
            values["twist"] = "rad", float(np.abs(traces.absolute(f"{place}.twist")).max())
        if shaft.drawing is not None:
            found_in = [stresses(shaft.drawing, one) for one in torques]
            values |= {what: ("Pa", max(one[what] for one in found_in)) for what in found_in[0]}
        for what, (unit, value) in values.items():
            if what not in found or value > found[what].value:
                found[what] = Load(what, unit, value, result.case.limits.get(f"{place}.{what}"))
    return list(found.values())
