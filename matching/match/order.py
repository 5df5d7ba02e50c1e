"""What to order: which adapter quantities gain over the bed as planned, judged by delivered controllers on fresh beds.

Every adapter quantity is held at its planned value, and free, each with everything else tuned by the same search. It is
ordered only where the error of the delivered controller over fresh beds is better by more than the error scatters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from matching.match.beds import BedVerdicts, Judge, quantile
from matching.match.case import apply
from matching.match.loop import controller_on, linear_bed
from matching.match.loop_modes import neutral_motions
from matching.match.objective import Search
from matching.match.result import AdapterTrade, Contribution
from matching.match.rounds import SearchEnd, end_at, judged_again, keeps_all, rounds
from matching.match.search import Found
from matching.match.variables import CONTROLLER, RIG, Variable
from matching.match.verify import FRESH
from modelling.errors import NoDesign


@dataclass(frozen=True)
class OrderSettings:
    """Numbers of the order.

    Attributes
    ----------
    gain : float
        Relative, by which an ordered value has to be better at least: less is not worth a part. Chosen by trial.
    deviations : float
        Standard deviations of the mean difference over the same fresh beds, by which it has to be better: 95 %.
    rounds, steps, steps_of_curve : int
        Of the search with a quantity held, and of every value of a curve. Chosen by trial.
    places : int
        Values of the curve over a quantity, between its bounds.
    digits : int
        Significant digits of an ordered value.
    """

    gain: float = 0.02
    deviations: float = 2.0
    rounds: int = 2
    steps: int = 24
    steps_of_curve: int = 6
    places: int = 4
    digits: int = 2


ORDER = OrderSettings()


@dataclass(frozen=True)
class Ordered:
    """The point (m,) that is delivered, whether it keeps every requirement, and what each adapter quantity gains.

    ``contributions``: see :func:`contributions`.
    """

    x: np.ndarray
    keeps_all: bool
    trades: tuple[AdapterTrade, ...] = ()
    contributions: tuple[Contribution, ...] = ()


@dataclass(frozen=True)
class Delivered:
    """A tuned setting on fresh beds: both errors over their tolerances as one (b,), infinite where not damped.

    ``verdicts`` are those of the beds, of the bed as planned last.
    """

    end: SearchEnd
    errors: np.ndarray
    keeps_all: bool
    verdicts: BedVerdicts | None = None

    @property
    def error(self) -> float:
        """The median over the beds."""
        return float(np.median(self.errors))


@dataclass(frozen=True)
class Fresh:
    """The fresh beds that judge all delivered controllers: how many, and their seed."""

    count: int
    seed: int

    def delivered(self, search: Search, end: SearchEnd) -> Delivered:
        """A setting on the beds, drawn about its values."""
        case = apply(search.case, search.values(end.x))
        positions = case.uncertainty.draw(max(self.count, 1), self.seed + FRESH)
        bed = linear_bed(case)
        judge = Judge(case, controller_on(bed), neutral_motions(bed), search.required)
        found = judge.verdicts([*(case.uncertainty.at(position) for position in positions), {}])
        squares = (found.unmeasured / case.unmeasured_tolerance) ** 2 + (found.measured / case.tolerance) ** 2
        errors = np.where(found.stable & found.damped, np.sqrt(squares / 2), np.inf)[:-1]
        return Delivered(end, errors, keeps_all(search, end), found)


def is_better(one: Delivered, other: Delivered) -> bool:
    """Whether one setting is better by more than the gain asked for, and by more than the difference scatters."""
    if one.keeps_all != other.keeps_all:
        return one.keeps_all
    lost = np.isfinite(one.errors).sum() - np.isfinite(other.errors).sum()
    both = np.isfinite(one.errors) & np.isfinite(other.errors)
    if lost or not both.any():
        return bool(lost > 0)
    gained = other.errors[both] - one.errors[both]
    scatter = float(gained.std() / np.sqrt(len(gained)))
    mean = float(other.errors[both].mean())
    return bool(gained.mean() > max(ORDER.gain * mean, ORDER.deviations * scatter))


def ordered(search: Search, found: Found, fresh: Fresh) -> Ordered:
    """The setting with nothing ordered that gains nothing, and the trade of every adapter quantity.

    Quantities are put back to their planned values one after another, first the one that costs least (backward
    elimination), since two may replace each other.
    """
    adapters = [i for i, one in enumerate(search.variables) if one.name.startswith(RIG)]
    best = fresh.delivered(search, found.end)
    planned = {i: search.variables[i].at(search.variables[i].move.planned) for i in adapters}
    everything = _held(search, fresh, found.controller_alone, planned)
    everything = min((everything, _held(search, fresh, found.end, planned)), key=_rank)
    held: dict[int, float] = {}
    settled = best
    if not is_better(best, everything):
        held, settled = planned, everything
    while len(held) < len(adapters) - 1:
        tried = [(i, _held(search, fresh, settled.end, {**held, i: planned[i]})) for i in adapters if i not in held]
        kept = [(i, one) for i, one in tried if not is_better(settled, one)]
        if not kept:
            break
        i, settled = min(kept, key=lambda pair: _rank(pair[1]))
        held[i] = planned[i]
    values = dict(held)
    for i in (i for i in adapters if i not in held):
        values[i] = _bought(search.variables[i], float(settled.end.x[i]))
    if len(held) < len(adapters):
        bought = _held(search, fresh, settled.end, values)
        settled = bought if bought.keeps_all or not settled.keeps_all else settled
    trades = tuple(_trade(search, fresh, settled, i, planned, everything) for i in adapters)
    search.free = np.ones(len(search.variables), bool)
    made = contributions(search, found, fresh, {"adapters as planned": everything, "all": settled})
    return Ordered(settled.end.x, settled.keeps_all, trades, made)


def contributions(
    search: Search, found: Found, fresh: Fresh, further: Mapping[str, Delivered]
) -> tuple[Contribution, ...]:  # fmt: skip
    """What each part more of what moves gains on the same fresh beds; none where the controller alone moves.

    Rows: nothing moved, the controller alone, and ``further``.
    """
    of_controller = [one.name.startswith(CONTROLLER) for one in search.variables]
    if all(of_controller):
        return ()
    given = fresh.delivered(search, end_at(search, search.begin()))
    rows = {"nothing": given}
    if any(of_controller):
        # judged again: the search has seen further beds since
        alone = judged_again(search, found.gains_alone or found.controller_alone)
        rows["controller alone"] = fresh.delivered(search, alone)
    return tuple(_contribution(moved, one) for moved, one in (rows | dict(further)).items())


def _contribution(moved: str, one: Delivered) -> Contribution:
    found = one.verdicts
    assert found is not None, "delivered settings were judged"
    stable = found.stable[:-1]
    measured, unmeasured = (errors[:-1][stable].tolist() for errors in (found.measured, found.unmeasured))
    return Contribution(
        moved, float(found.measured[-1]), float(found.unmeasured[-1]),
        quantile(measured, 0.5), quantile(measured, 0.95), quantile(unmeasured, 0.5), quantile(unmeasured, 0.95),
        int(stable.sum()), len(stable), one.keeps_all,
    )  # fmt: skip


def _rank(one: Delivered) -> tuple[bool, int, float]:
    return not one.keeps_all, -int(np.isfinite(one.errors).sum()), one.error


def _bought(variable: Variable, x: float) -> float:
    """Coordinate of the value rounded to what can be bought, within the bounds."""
    value = float(f"{variable.value(x):.{ORDER.digits}g}")
    return variable.at(value)


def _held(
    search: Search, fresh: Fresh, begin: SearchEnd, held: dict[int, float], steps: int | None = None
) -> Delivered:  # fmt: skip
    """The setting with some quantities, by number, held at coordinates and everything else tuned for it."""
    x = begin.x.copy()
    search.free = np.ones(len(x), bool)
    for i, place in held.items():
        x[i], search.free[i] = place, False
    if steps == 0 or not search.free.any():
        return fresh.delivered(search, end_at(search, x))
    end = rounds(search, end_at(search, x), 1 if steps else ORDER.rounds, steps or ORDER.steps)
    return fresh.delivered(search, judged_again(search, end))


def _trade(
    search: Search, fresh: Fresh, settled: Delivered, number: int, planned: dict[int, float], everything: Delivered
) -> AdapterTrade:  # fmt: skip
    """What an adapter quantity gains, the others as they are ordered, everything else tuned for it."""
    variable = search.variables[number]
    others = {i: float(settled.end.x[i]) for i in planned if i != number}
    here = float(settled.end.x[number])
    places = sorted({*np.linspace(0, variable.span, ORDER.places).tolist(), planned[number], here})
    at = places.index(here)
    curve = {here: settled}
    for way in (places[at + 1 :], places[:at][::-1]):
        near = settled
        for place in way:
            try:
                near = _held(search, fresh, near.end, {**others, number: place}, steps=ORDER.steps_of_curve)
            except NoDesign:
                break
            curve[place] = near
    good = [place for place in places if place in curve and not is_better(settled, curve[place])]
    as_planned = curve.get(planned[number])
    move = variable.move
    return AdapterTrade(
        name=move.name, unit=move.unit, planned=move.planned, ordered=variable.value(here),
        acceptable=(variable.value(min(good, default=here)), variable.value(max(good, default=here))),
        error_as_planned=None if as_planned is None else as_planned.error,
        error_all_as_planned=everything.error if everything.keeps_all else None,
        error_as_ordered=settled.error,
        curve=tuple(
            (variable.value(place), one.error) for place, one in sorted(curve.items()) if np.isfinite(one.error)
        ),
    )  # fmt: skip
