"""What to order: which adapter quantities gain over the bed as planned, judged by delivered controllers on fresh beds.

Every adapter quantity is held at its planned value, and free, each with everything else tuned by the same search. It is
ordered only where the error of the delivered controller over fresh beds is better by more than the error scatters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from matching.match.beds import BedVerdicts, Judge, quantile
from matching.match.case import Case, apply
from matching.match.loop import controller_on, linear_bed
from matching.match.loop_modes import neutral_motions
from matching.match.objective import Search
from matching.match.result import AdapterTrade, Contribution
from matching.match.rounds import SearchEnd, end_at, judged_again, misses, rounds
from matching.match.search import Found
from matching.match.variables import CONTROLLER, RIG, Variable
from matching.match.verify import FRESH
from modelling.errors import NoDesign
from modelling.system import MOVABLE_DIMENSIONS
from modelling.units import printed


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
    resolution : float
        Share of a quantity's range to which an end of the range in which no value is worse is looked for: 3 % of a
        range of 16 to 1 are 9 % of a stiffness, which is as exactly as adapters are made.
    most_tries : int
        Values that are tried for an end at most.
    again : int
        Times at most that a better value on the curve of a quantity is ordered in place of what the search found, or
        that an order is given up since it gains too little beside another one. More than two are rare.
    parts : int
        Number of parts of a catalogue up to which every one is tried; of a longer one those next to the value found.
    lost : float
        Share of the fresh beds that has to be gained, or lost, to count by itself: fewer are an accident of the draw.
    digits : int
        Significant digits of an ordered value.
    """

    gain: float = 0.02
    deviations: float = 2.0
    rounds: int = 2
    steps: int = 24
    steps_of_curve: int = 6
    resolution: float = 0.03
    most_tries: int = 5
    again: int = 4
    parts: int = 8
    lost: float = 0.02
    digits: int = 2


ORDER = OrderSettings()
SMALLEST_ERROR = 1e-12  # over its scale: errors of 0 gain nothing


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
    """A tuned setting on fresh beds: both errors over their scales as one (b,), infinite where not damped.

    ``verdicts`` are those of the beds, of the bed as planned last.
    """

    end: SearchEnd
    errors: np.ndarray
    keeps_all: bool
    verdicts: BedVerdicts | None = None

    @property
    def error(self) -> float:
        """The mean over the beds that are damped, by which orders are judged; infinite where none is."""
        damped = self.errors[np.isfinite(self.errors)]
        return float(damped.mean()) if len(damped) else np.inf


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
        both = case.error_scales.both(found.measured, found.unmeasured)
        errors = np.where(found.stable & found.damped, both, np.inf)[:-1]
        return Delivered(end, errors, not misses(search, end), found)  # within the reserve the judge sees it kept


def lead(one: Delivered, other: Delivered) -> float:
    """How much better one setting is, over what an order needs: above 1 it is better, below it is no better.

    An order needs the gain that is asked for, and more than the difference scatters over the same fresh beds. The lead
    is infinite where one setting keeps every requirement and the other does not, or where it damps more beds, and more
    than the draw decides; it is −infinite where it misses a requirement that the other keeps, or a bed that the other
    damps.
    """
    if one.keeps_all != other.keeps_all:
        return np.inf if one.keeps_all else -np.inf
    kept = [float(np.isfinite(each.errors).mean()) for each in (one, other)]
    scatter = ORDER.deviations * np.sqrt(sum(share * (1 - share) for share in kept) / len(one.errors))
    gained_beds = kept[0] - kept[1]
    both = np.isfinite(one.errors) & np.isfinite(other.errors)
    if gained_beds < 0:
        return -np.inf
    if gained_beds > max(ORDER.lost, scatter) or not both.any():
        return np.inf if gained_beds > 0 else 0.0
    gained = other.errors[both] - one.errors[both]
    scatter = float(gained.std() / np.sqrt(len(gained)))
    mean = float(other.errors[both].mean())
    return float(gained.mean() / max(ORDER.gain * mean, ORDER.deviations * scatter, SMALLEST_ERROR))


def is_better(one: Delivered, other: Delivered) -> bool:
    """Whether one setting is better by what an order needs, see :func:`lead`."""
    return lead(one, other) > 1


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
    if len(held) < len(adapters):
        settled = _bought(search, fresh, settled, held, [i for i in adapters if i not in held])
        if not is_better(settled, everything):
            settled = everything
    # the cost of the search is not the error that judges: a curve may show a better value, first tried at few places
    left, tries, curves = ORDER.again, 1, [{float(settled.end.x[i]): settled} for i in adapters]
    while True:
        trades = [
            _trade(search, fresh, curve, i, planned, everything, tries)
            for i, curve in zip(adapters, curves, strict=True)
        ]
        shown = [(i, min(curve.values(), key=_rank)) for i, curve in zip(adapters, curves, strict=True)]
        better = [(i, one) for i, one in shown if is_better(one, settled)] if left else []
        if better:
            i, one = min(better, key=lambda pair: _rank(pair[1]))
            others = {j: float(settled.end.x[j]) for j in adapters if j != i}
            bought = _bought(search, fresh, one, others, [i])
            if is_better(bought, settled):
                settled, left, tries = bought, left - 1, 1
                curves = [{float(settled.end.x[i]): settled} for i in adapters]
                continue
        # what gained before another quantity was ordered may gain too little now
        moved = [
            (curve, planned[i]) for i, curve in zip(adapters, curves, strict=True) if planned[i] != next(iter(curve))
        ]
        back = [curve[place] for curve, place in moved if place in curve and not is_better(settled, curve[place])]
        if back and left:
            settled, left, tries = min(back, key=_rank), left - 1, 1
            curves = [{float(settled.end.x[i]): settled} for i in adapters]
            continue
        if tries == ORDER.most_tries:
            break
        tries = ORDER.most_tries
    search.free = np.ones(len(search.variables), bool)
    made = contributions(search, found, fresh, {"adapters as planned": everything, "all": settled})
    return Ordered(settled.end.x, settled.keeps_all, tuple(trades), made)


def planned_unless_better(search: Search, found: Found, fresh: Fresh) -> Ordered:
    """Of a match that misses a requirement: every adapter as planned, unless what the search found is better."""
    adapters = [i for i, one in enumerate(search.variables) if one.name.startswith(RIG)]
    best = fresh.delivered(search, found.end)
    planned = {i: search.variables[i].at(search.variables[i].move.planned) for i in adapters}
    everything = _held(search, fresh, found.controller_alone, planned)
    search.free = np.ones(len(search.variables), bool)
    settled = best if is_better(best, everything) else everything
    listed = [i for i in adapters if search.variables[i].move.catalogue]
    if settled is best and listed:
        settled = _bought(search, fresh, best, {}, listed)
        search.free = np.ones(len(search.variables), bool)
        settled = settled if is_better(settled, everything) else everything
    made = contributions(search, found, fresh, {"adapters as planned": everything, "all": settled})
    return Ordered(settled.end.x, settled.keeps_all, (), made)


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


def _bought(
    search: Search, fresh: Fresh, settled: Delivered, held: Mapping[int, float], moved: Sequence[int]
) -> Delivered:  # fmt: skip
    """The setting with every quantity that moved, by number, at a value that can be bought.

    Where there is a catalogue, the parts next to the value found are tried, one quantity after another, with everything
    else tuned for each; without one the value is rounded, and kept as it is where a requirement would be missed.
    """
    listed = [i for i in moved if search.variables[i].move.catalogue]
    rounded = {i: _rounded(search.variables[i], float(settled.end.x[i])) for i in moved if i not in listed}
    if rounded:
        tried = _held(search, fresh, settled.end, {**held, **rounded})
        settled = tried if tried.keeps_all or not settled.keeps_all else settled
    fixed = {**held, **{i: float(settled.end.x[i]) for i in rounded}}
    for i in listed:
        tries = [_held(search, fresh, settled.end, {**fixed, i: part}) for part in _parts_near(search, settled, i)]
        settled = min(tries, key=_rank)
        fixed[i] = float(settled.end.x[i])
    return settled


def _parts_near(search: Search, settled: Delivered, i: int) -> list[float]:
    """Coordinates of the parts of a catalogue on both sides of where a setting has its quantity."""
    variable = search.variables[i]
    parts = np.array([variable.at(value) for value in variable.move.catalogue])
    above = int(np.searchsorted(parts, settled.end.x[i]))
    return [float(part) for part in parts[max(above - 1, 0) : above + 1]]


def _rounded(variable: Variable, x: float) -> float:
    """Coordinate of a value rounded as parts are ordered."""
    return variable.at(float(f"{variable.value(x):.{ORDER.digits}g}"))


def _held(
    search: Search, fresh: Fresh, begin: SearchEnd, held: Mapping[int, float], steps: int | None = None
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
    search: Search, fresh: Fresh, curve: dict[float, Delivered], number: int, planned: dict[int, float],
    everything: Delivered, tries: int,
) -> AdapterTrade:  # fmt: skip
    """What an adapter quantity gains, the others as they are ordered, everything else tuned for it.

    ``curve`` holds what was tried, by coordinate, the setting as ordered first; what is tried here is added. ``tries``
    is how many values are tried for an end of the range in which none is worse, at most.
    """
    variable = search.variables[number]
    here, settled = next(iter(curve.items()))
    others = {i: float(settled.end.x[i]) for i in planned if i != number}

    def tried(place: float, near: Delivered) -> Delivered | None:
        """The setting with the quantity at a coordinate, begun at a neighbour; None where there is no design."""
        if place not in curve:
            try:
                held = {**others, number: place}
                curve[place] = _held(search, fresh, near.end, held, steps=ORDER.steps_of_curve)
            except NoDesign:
                return None
        return curve[place]

    tried(planned[number], settled)
    ends = [_end_of_no_worse(tried, settled, here, bound, variable.span, tries) for bound in (0.0, variable.span)]
    as_planned, move = curve.get(planned[number]), variable.move
    for value in move.catalogue if len(move.catalogue) <= ORDER.parts else ():
        tried(variable.at(value), settled)
    if as_planned is not None and not is_better(settled, as_planned):
        ends = [min(ends[0], planned[number]), max(ends[1], planned[number])]
    torque, stiffness = _rated_torque(search.case, move.name), _stiffness(search, settled, move.name)
    shown = {
        place: one
        for place, one in curve.items()
        if np.isfinite(one.error) and (one.keeps_all or not settled.keeps_all)
    }
    return AdapterTrade(
        name=move.name, unit=move.unit, planned=move.planned, ordered=variable.value(here),
        acceptable=(variable.value(ends[0]), variable.value(ends[1])),
        error_as_planned=None if as_planned is None else as_planned.error,
        error_all_as_planned=everything.error if everything.keeps_all else None,
        error_as_ordered=settled.error,
        curve=tuple((variable.value(place), one.error) for place, one in sorted(shown.items())),
        rated_torque=torque,
        twist=None if torque is None or stiffness is None else torque / stiffness,
        reason=_reason(variable, curve, here, planned[number]),
    )  # fmt: skip


def _reason(variable: Variable, curve: Mapping[float, Delivered], here: float, planned: float) -> str:
    """Why a quantity is ordered, or why it stays as planned, by the settings that were tried, by coordinate."""
    ordered = curve[here]
    if abs(here - planned) > SAME_PLACE:
        plan = curve.get(planned)
        if plan is None or plan.keeps_all != ordered.keeps_all:
            return "as planned a requirement is missed" if ordered.keeps_all else "nearer to the requirements"
        more = int(np.isfinite(ordered.errors).sum() - np.isfinite(plan.errors).sum())
        if np.isinf(lead(ordered, plan)):
            return f"{more} of {len(ordered.errors)} beds more are damped"
        return f"{_gain(ordered, plan):.1%} less error than as planned"
    others = [(place, one) for place, one in curve.items() if place != here and one.keeps_all == ordered.keeps_all]
    place, best = min(others, key=lambda pair: _rank(pair[1]), default=(here, ordered))
    gain = _gain(best, ordered)
    if gain <= 0:
        return "no value that was tried has less error"
    at = f"{variable.value(place):.3g} {printed(variable.move.unit)}"
    if lead(best, ordered) > 1:
        return f"no part near {at}, which would have {gain:.1%} less error"
    if lead(best, ordered) < 0:
        return f"{at} has {gain:.1%} less error and does not damp every bed that is damped as planned"
    asked = f"an order needs {ORDER.gain:.0%}" if gain < ORDER.gain else "the difference is within its scatter"
    return f"{at} has {gain:.1%} less error: {asked}"


SAME_PLACE = 1e-9  # between coordinates


def _gain(one: Delivered, other: Delivered) -> float:
    """Share of the mean error that one setting has less than another, on the beds that both damp."""
    both = np.isfinite(one.errors) & np.isfinite(other.errors)
    return float(1 - one.errors[both].mean() / max(other.errors[both].mean(), SMALLEST_ERROR)) if both.any() else 0.0


def _end_of_no_worse(
    tried: Callable[[float, Delivered], Delivered | None],
    settled: Delivered,
    here: float,
    bound: float,
    span: float,
    tries: int,
) -> float:
    """The coordinate towards a bound up to which no value is worse: a search for where the lead of the order is 1.

    Regula falsi with the weights of the Illinois rule (Dowell and Jarratt 1971), bisection where a lead is infinite.
    The answer is the last value that was tried and is no worse.
    """
    if bound == here:
        return here
    at_bound = tried(bound, settled)
    ahead = np.inf if at_bound is None else lead(settled, at_bound)
    if ahead <= 1:
        tried((here + bound) / 2, settled)  # two ends that are alike may have a better value between them
        return bound
    good, bad, near, of_good, of_bad, kept = here, bound, settled, -1.0, ahead - 1, 0
    for _ in range(tries):
        if abs(bad - good) <= ORDER.resolution * span:
            break
        share = of_good / (of_good - of_bad) if np.isfinite(of_bad) and np.isfinite(of_good) else 0.5
        place = good + float(np.clip(share, INWARD, 1 - INWARD)) * (bad - good)
        found = tried(place, near)
        ahead = np.inf if found is None else lead(settled, found)
        if found is not None and ahead <= 1:
            good, near, of_good, of_bad, kept = place, found, ahead - 1, of_bad / (2 if kept > 0 else 1), 1
        else:
            bad, of_bad, of_good, kept = place, ahead - 1, of_good / (2 if kept < 0 else 1), -1
    return good


def _stiffness(search: Search, settled: Delivered, name: str) -> float | None:
    """N·m/rad, as ordered, of the shaft that a quantity belongs to; None of others."""
    place = f"{name.removeprefix(RIG).rpartition('.')[0]}.stiffness"
    if place not in search.case.rig.parameters:
        return None
    values = search.values(settled.end.x)
    return values.get(f"{RIG}{place}", search.case.rig.parameters[place].value)


INWARD = 0.15  # of a bracket, by which the next value lies at least within it


def _rated_torque(case: Case, name: str) -> float | None:
    """N·m that a shaft has to carry whose stiffness or dimension has this name: its own limit, else that of the
    dynamometers."""
    place, _, quantity = name.removeprefix(RIG).rpartition(".")
    if quantity not in ("stiffness", *MOVABLE_DIMENSIONS) or not place.startswith("shafts."):
        return None
    largest = float(case.limits_of("torque").max())
    return case.limits.get(f"{place}.torque", largest if np.isfinite(largest) else None)
