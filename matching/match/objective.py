"""Cost and requirements at a point of the search, with their first derivatives."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import numpy as np

from matching.match.beds import (
    BED_POINTS,
    LoopCurves,
    OffsetFigures,
    balanced,
    command_noise,
    counted,
    loop_curves,
    noise_of_sensors,
    noise_weights,
    offset_figures,
    planned,
)
from matching.match.case import Case, Move, apply
from matching.match.damping import damping_ratios, decay_rates, rates, without_resting
from matching.match.demands import Demands, rig_values
from matching.match.loop import (
    BedSet,
    FrequencyResponse,
    SampledBeds,
    SampledController,
    beds_of,
    can_be_unmeasured,
    closed_matrices,
    closed_poles,
    compared_columns,
    compared_inputs,
    drive,
    errors,
    frequency_response,
    linear_bed,
    responses_of,
    return_difference,
)
from matching.match.loop_modes import eigenvalue_of, neutral_motions
from matching.match.movable import with_sizes
from matching.match.opened import CLOSED, OPENED, Opened, openings
from matching.match.operating_range import at_speed, ends_of
from matching.match.requirements import Requirements, requirements
from matching.match.targets import target_modes
from matching.match.variables import (
    CONTROLLER,
    DESIGNS,
    POINTS,
    RIG,
    Controllers,
    Hardware,
    Recent,
    SearchSettings,
    Variable,
    block,
    variables_of,
)
from modelling.bed.observer import dynamometer_sizes, sensor_noise
from modelling.errors import NoDesign
from modelling.linear.resolvent import resolvent

Made = TypeVar("Made")
OF_ERRORS = 2  # margins of the errors of the bed as planned: to unmeasured and to measured torques
SMALLEST_SQUARE = 1e-12  # of an error over its scale: the root has a slope there
SMALLEST_RATE, FASTEST_RATE = 1e-6, 1e6  # 1/s, between which rates of decay steer the search
UNSTABLE = 1e6  # cost of a bed as planned that is not stable: more than any errors of one that is


@dataclass(frozen=True)
class Evaluation:
    """Cost of a point and relative constraint margins, negative where a requirement is missed.

    Attributes
    ----------
    margins : ndarray (r,)
        Damping of every active bed and of what runs on known torques alone, limits of the manoeuvre, command noise of
        every dynamometer, what offsets make of its flange torque, roll-off and margin at every frequency, targets,
        and at the end the ``OF_ERRORS`` of the errors of the bed as planned, unmeasured and measured torques.
    least_margins : ndarray (s,)
        The same, of roll-off and margin the worst alone.
    penalty, error_penalty : float
        Cost of a requirement, and of a tolerance of an error, missed by all of it.
    unstable : float
        Cost of a bed as planned that is not stable, 0 where it is.
    """

    cost: float
    margins: np.ndarray
    least_margins: np.ndarray
    penalty: float
    error_penalty: float
    unstable: float = 0.0

    @property
    def penalised_cost(self) -> float:
        """By which points are compared: the cost, and much for what is missed, more where the errors are large."""
        missed = np.maximum(-self.least_margins, 0.0)
        robust, of_errors = float(missed[:-OF_ERRORS].sum()), float(missed[-OF_ERRORS:].sum())
        priced = self.penalty * robust + self.error_penalty * of_errors
        return self.cost + max(self.cost, 1.0) * priced + self.unstable


@dataclass(frozen=True)
class Point:
    """What was worked out at a point: poles (b, x) of the ``active`` beds, errors (2, b + 1) over their scales.

    Squared errors to unmeasured and to measured torques over the squares of the scales, of the bed as planned last.
    """

    hardware: Hardware
    active: SampledBeds
    controller: SampledController
    acting: FrequencyResponse
    curves: LoopCurves
    offsets: OffsetFigures | None
    poles: np.ndarray
    own_poles: np.ndarray
    errors: np.ndarray


class _Pool(NamedTuple):
    """Beds of a pool and those of them that are seen; see :class:`SpeedSearch`."""

    positions: np.ndarray
    opened: dict[int, Opened]
    shares: dict[int, float]
    active: tuple[int, ...]


@dataclass
class SpeedSearch:
    """Cost of a point on a set of beds at one speed, and its relative constraint margins.

    Attributes
    ----------
    variables : tuple of Variable (m)
    free : ndarray (m,)
        Which of them move now.
    positions : ndarray (b, p)
        Where in the box the beds of the pool are, the bed as planned first; ``opened`` says, by number, which of them
        have opened cut shafts, ``shares`` which part of the damping that drawn beds need they have to keep.
    active : tuple of int
        The beds of the pool that the search sees.
    known : dict
        What was found at every point since the beds to be seen were chosen.
    failures : Counter of str
        Settings at which no controller exists, by the reason.
    """

    case: Case
    variables: tuple[Variable, ...]
    required: Requirements
    demands: Demands
    settings: SearchSettings
    positions: np.ndarray
    free: np.ndarray
    active: tuple[int, ...] = (0,)
    opened: dict[int, Opened] = field(default_factory=dict)
    shares: dict[int, float] = field(default_factory=dict)
    known: dict[tuple[float, ...], Evaluation] = field(default_factory=dict)
    failures: Counter[str] = field(default_factory=Counter)
    _points: Recent[tuple[float, ...], Point] = field(default_factory=lambda: Recent(POINTS))
    _pools: Recent[tuple[tuple[float, ...], bytes, tuple[Opened, ...]], tuple[SampledBeds, np.ndarray]] = field(
        default_factory=lambda: Recent(POINTS)
    )
    _hardware: Recent[tuple[float, ...], Hardware] = field(default_factory=lambda: Recent(DESIGNS))
    _vehicle: np.ndarray | None = None

    def __post_init__(self) -> None:
        self.controllers = Controllers(self.case)
        self.neutral = neutral_motions(linear_bed(self.case))
        wanted = [eigenvalue_of(mode) for _, mode in target_modes(self.case)]
        self.targets = list(zip(self.case.targets, wanted, strict=True))
        every = np.ones(len(self.case.compared), bool)
        self.compared = (
            ((), can_be_unmeasured(self.case), self.case.error_scales.unmeasured),
            (self.case.loop.measured, every, self.case.error_scales.measured),
        )
        # of the squares (2,) of the errors over their scales, what the case allows of the bed as planned
        allowed = self.case.unmeasured_tolerance, self.case.tolerance
        self.allowed = np.array([(most / scale) ** 2 for most, (*_, scale) in zip(allowed, self.compared, strict=True)])
        if self.required.opened_shafts and self.settings.opened:
            for opened in openings(self.case):
                self._pool(np.zeros((1, self.positions.shape[1])), self.settings.stable_share, opened)

    @property
    def beds_seen(self) -> int:
        """How many beds the search sees."""
        return len(self.active)

    # points

    @property
    def names(self) -> tuple[str, ...]:
        """Of the variables."""
        return tuple(variable.name for variable in self.variables)

    def begin(self, values: Mapping[str, float] | None = None) -> np.ndarray:
        """The point (m,) at the case's own values, some of them others."""
        given = values or {}
        return np.array([one.at(given.get(one.name, one.move.start)) for one in self.variables])

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Values by name, SI, mirror images and what follows from dimensions too, at a point (m,)."""
        moved = {
            name: one.value(part) for one, part in zip(self.variables, x.tolist(), strict=True)
            for name in one.move.together
        }  # fmt: skip
        return with_sizes(self.case.rig, moved)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest coordinates (m,)."""
        spans = np.array([one.span for one in self.variables])
        return self.settings.inset * spans, (1 - self.settings.inset) * spans

    def controller(self, x: np.ndarray) -> SampledController:
        """The controller at a point (m,)."""
        return self.controllers.at(self.values(x))

    # beds

    def hardware(self, x: np.ndarray) -> Hardware:
        """The beds at a point (m,)."""
        values = {name: value for name, value in self.values(x).items() if name.startswith(RIG)}

        def made() -> Hardware:
            case = apply(self.case, values)
            noise = noise_of_sensors(case, case.loop.controller_sensors)
            drawn = [case.uncertainty.at(position) for position in self.positions[1 : self.settings.drawn + 1]]
            frequencies = np.geomspace(*case.band, BED_POINTS)
            beds = responses_of(case, beds_of(case, drawn), drawn, frequencies, self._vehicle)
            if not any(name.removeprefix(RIG) in case.vehicle.parameters for name in values):
                self._vehicle = beds.vehicle  # adapters are no part of the vehicle
            return Hardware(case, planned(case, noise), beds)

        return self._hardware.at(tuple(values.values()), made)

    def activate(self, x: np.ndarray) -> None:
        """Have the search see the least damped beds of the pool at a point (m,) as well, closed and opened ones."""
        try:
            kept = self.pool_margins(x)
        except NoDesign as fault:
            self.failures[str(fault)] += 1
            return
        opened = np.array([number in self.opened for number in range(len(kept))])
        least = [np.argsort(np.where(some, kept, np.inf)) for some in (~opened, opened)]
        counts = self.settings.active, min(OPENED.active, int(opened.sum()))
        chosen = [number for order, count in zip(least, counts, strict=True) for number in order[:count].tolist()]
        self.active = tuple(sorted({0, *self.active, *chosen}))
        self.forget()

    def pool_margins(self, x: np.ndarray) -> np.ndarray:
        """Damping margin (b,) of every bed of the pool, relative to the requirement on drawn beds."""
        beds, poles = self.pool_poles(x)
        shares = np.array([self.shares.get(number, 1.0) for number in range(len(self.positions))])
        return 1 + self.damping_margins(poles, beds) - shares

    def pool_poles(self, x: np.ndarray) -> tuple[SampledBeds, np.ndarray]:
        """The beds of the pool and their poles (b, p) at a point (m,); worked out once a point and pool."""
        ways = tuple(self.opened.get(number, CLOSED) for number in range(len(self.positions)))

        def made() -> tuple[SampledBeds, np.ndarray]:
            beds = self.hardware(x).beds_at(self.positions, ways)
            return beds, closed_poles(beds, self.controller(x))

        return self._pools.at((tuple(x.tolist()), self.positions.tobytes(), ways), made)

    def damping_margins_at(self, x: np.ndarray, positions: np.ndarray, opened: Sequence[Opened] = ()) -> np.ndarray:
        """What is left (b,) of the damping that beds at positions (b, p) need, as a share of it."""
        beds = self.hardware(x).beds_at(positions, opened)
        return self.damping_margins(closed_poles(beds, self.controller(x)), beds)

    def misses_damping_at(self, x: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """By how much (b,) beds at positions (b, p) miss their damping, with half of the search's reserve; 0 if not."""
        beds, step = self.hardware(x).beds_at(positions), self.case.loop["sample_time"]
        z = without_resting(closed_poles(beds, self.controller(x)), self.neutral)
        asked = beds.asked_damping(z, step, self.required, 1 + self.settings.damping_reserve / 2)
        return np.maximum(1 - (damping_ratios(z, step) / asked).min(axis=1), 0.0)

    def add(self, positions: np.ndarray, share: float = 1.0) -> None:
        """Have the search see beds at positions (b, p) that keep a share of the damping drawn beds need."""
        self.active = (*self.active, *self._pool(positions, share))
        self.forget()

    def _pool(self, positions: np.ndarray, share: float, opened: Opened = CLOSED) -> tuple[int, ...]:
        """Add beds at positions (b, p) to the pool; their numbers. Where cut shafts open, the share falls with it."""
        added = tuple(range(len(self.positions), len(self.positions) + len(positions)))
        self.positions = np.vstack([self.positions, positions])
        self.shares |= dict.fromkeys(added, share * opened.damping_left)
        if opened != CLOSED:
            self.opened |= dict.fromkeys(added, opened)
        return added

    def with_opened(self, way: _Pool | None = None) -> _Pool:
        """The beds of the pool now; with ``way`` those of a pool before are seen again."""
        now = _Pool(self.positions, dict(self.opened), dict(self.shares), self.active)
        if way is not None:
            self.positions, self.active = way.positions, way.active
            self.opened, self.shares = dict(way.opened), dict(way.shares)
            self.forget()
        return now

    def leave_out_opened(self) -> None:
        """Have the search see no more beds with opened cut shafts."""
        kept = [number for number in range(len(self.positions)) if number not in self.opened]
        self.shares = {new: self.shares[old] for new, old in enumerate(kept) if old in self.shares}
        self.active = tuple(new for new, old in enumerate(kept) if old in self.active)
        self.positions, self.opened = self.positions[kept], {}
        self.forget()

    def forget(self) -> None:
        """What was judged with other beds."""
        self.known.clear()
        self._points.clear()

    # cost and requirements

    def judged(self, x: np.ndarray) -> Evaluation:
        """Cost and requirements at a point (m,); kept until other beds are seen."""
        key = tuple(x.tolist())
        if key not in self.known:
            try:
                self.known[key] = self.evaluated_at(x, self.point(x))
            except NoDesign as fault:
                self.failures[str(fault)] += 1
                like = next(iter(self.known.values()), None)
                few = 1 + OF_ERRORS
                many, few = (few, few) if like is None else (len(like.margins), len(like.least_margins))
                self.known[key] = Evaluation(
                    self.settings.worst, np.full(many, -1.0), np.full(few, -1.0), self.settings.penalty,
                    self.settings.error_penalty,
                )  # fmt: skip
        return self.known[key]

    @property
    def best(self) -> np.ndarray:
        """The best point (m,) that was judged since the beds to be seen were chosen."""
        return np.array(min(self.known, key=lambda key: self.known[key].penalised_cost))

    def point(self, x: np.ndarray) -> Point:
        """Work a point (m,) out."""
        return self._points.at(tuple(x.tolist()), lambda: self._worked_out(x))

    def _worked_out(self, x: np.ndarray) -> Point:
        hardware, controller = self.hardware(x), self.controller(x)
        sets = hardware.plan.every, hardware.plan.band, hardware.beds
        acting = frequency_response(controller, np.concatenate([each.frequencies for each in sets]))
        parts = self.frequency_parts(hardware)
        drawn, plan = ((beds, acting.at(part)) for beds, part in ((sets[2], parts[2]), (sets[1], parts[1])))
        squares = [
            np.concatenate([errors(*beds, known)[:, pairs].mean(axis=1) for beds in (drawn, plan)]) / scale**2
            for known, pairs, scale in self.compared
        ]
        active = hardware.beds_at(
            self.positions[list(self.active)], [self.opened.get(number, CLOSED) for number in self.active]
        )
        # what does not steer the search needs no search between frequencies
        below = self.required.modulus_margin * (1 + self.settings.reserve) * (1 + self.settings.largest_room)
        curves = loop_curves(hardware.plan, controller, acting.at(parts[0]), self.required, below)
        return Point(
            hardware, active, controller, acting, curves, offset_figures(hardware.plan, controller),
            closed_poles(active, controller), np.linalg.eigvals(controller.own_matrix),
            np.array(squares),
        )  # fmt: skip

    def frequency_parts(self, hardware: Hardware) -> list[slice]:
        """Where the frequencies of all, of the band as planned and of the drawn beds stand among those of a point."""
        sets = hardware.plan.every, hardware.plan.band, hardware.beds
        begins = np.cumsum([0, *(len(each.frequencies) for each in sets)]).tolist()
        return [slice(a, b) for a, b in pairwise(begins)]

    def damping_shares(self) -> np.ndarray:
        """Of the damping that drawn beds need, what each active bed has to keep; as planned also the case's limit."""
        of_limit = self.case.limits["damping_ratio"] * (1 + self.settings.reserve) / self.required_damping
        return np.array([self.shares.get(number, max(1.0, of_limit) if number == 0 else 1.0) for number in self.active])

    @property
    def required_damping(self) -> float:
        """What drawn beds need, with the reserve of the search."""
        return self.required.damping_ratio * (1 + self.settings.damping_reserve)

    def evaluated_at(self, x: np.ndarray, at: Point) -> Evaluation:
        """Cost and requirements of a point that was worked out."""
        settings = self.settings
        squares = np.minimum(at.errors, settings.worst).mean(axis=0)
        cost = float(squares[:-1].mean() + settings.weight_planned * squares[-1]) + self._change(x)
        margins = [np.clip(part, -1e2, settings.largest_room) for part in self.requirement_margins(x, at)]
        *single, rolled_off, margin, targets, of_errors = margins
        worst = [np.array([part.min(initial=settings.largest_room)]) for part in (rolled_off, margin)]
        return Evaluation(
            cost,
            np.concatenate(margins),
            np.concatenate([*single, *worst, targets, of_errors]),
            settings.penalty,
            settings.error_penalty,
            UNSTABLE if margins[0][0] <= -self.damping_shares()[0] else 0.0,
        )

    def _change(self, x: np.ndarray) -> float:
        changes = [
            one.weight * (part / one.span - one.at(one.move.planned) / one.span) ** 2
            for one, part in zip(self.variables, x, strict=True)
        ]
        return self.settings.weight_change * float(sum(changes))

    def requirement_margins(self, x: np.ndarray, at: Point) -> list[np.ndarray]:
        """Of damping, of own poles, manoeuvre, noise, offsets, roll-off, margin, targets, errors as planned."""
        settings, plan, allowed = self.settings, at.hardware.plan, np.array(self.required.command_noise)
        margin, rolled_off = counted(plan, self.required)
        noise = command_noise(at.curves, plan.every.frequencies)
        own = self.slowest_own_rate(at)[0]
        return [
            1 + self.damping_margins(at.poles, at.active) - self.damping_shares(),
            np.zeros(0) if own is None else np.array([own / self.own_rate - 1]),
            1 - (1 + settings.reserve) * self.demands.shares(rig_values(at.hardware.case)),
            1 - (1 + settings.reserve) * noise / allowed,
            self._offset_margins(at),
            1 - (1 + settings.reserve) * at.curves.closed[rolled_off] / self.required.rolled_off,
            at.curves.margin[margin] / (self.required.modulus_margin * (1 + settings.reserve)) - 1,
            self.target_margins(at)[0],
            1 - (1 + settings.error_reserve) * np.sqrt(at.errors[:, -1] / self.allowed),
        ]

    def _offset_margins(self, at: Point) -> np.ndarray:
        """Of what offsets of the sensors make an observer expect."""
        offsets, allowed = at.offsets, np.array(self.required.sensor_offset)
        if offsets is None:
            return np.zeros(0)
        return 1 - (1 + self.settings.reserve) * offsets.torque / allowed

    @property
    def own_rate(self) -> float:
        """Rate of decay, 1/s, of what runs on known torques alone; it is the same on every bed."""
        return max(self.required.decay_rate * (1 - self.settings.reserve), SMALLEST_RATE)

    def slowest_own_rate(self, at: Point) -> tuple[float | None, int]:
        """Least rate of decay, 1/s, of what runs on known torques alone, and the number of that pole."""
        if not len(at.own_poles):
            return None, 0
        moving = without_resting(at.own_poles[None], self.neutral)
        decay = decay_rates(moving, at.controller.sample_time)[0]
        return float(min(decay.min(), FASTEST_RATE)), int(decay.argmin())

    def target_margins(self, at: Point) -> tuple[np.ndarray, list[int]]:
        """What is left of the targets' tolerances in frequency and damping, and the numbers of their poles.

        The poles are those of the bed as planned, with a feed-forward those that known torques excite.
        """
        rooms, numbers = [], []
        z = at.own_poles if self.case.loop.structure.has_feed_forward else at.poles[0]
        s = rates(z[None], at.controller.sample_time)[0]
        s = np.where(s.imag > 1, s, 1e6)
        for target, wanted in self.targets:
            number = int(np.abs(np.log(s / wanted)).argmin())
            shown = s[number]
            numbers.append(number)
            off = abs(shown) / abs(wanted) - 1, -shown.real / abs(shown) + wanted.real / abs(wanted)
            shares = off[0] / target.frequency_tolerance, off[1] / target.damping_tolerance
            rooms += [1 + side * share for share in shares for side in (-1, 1)]
        return np.array(rooms) - self.settings.reserve, numbers

    def damping_margins(self, poles: np.ndarray, beds: SampledBeds) -> np.ndarray:
        """What is left (b,) of the damping that beds with poles (b, x) need."""
        poles = without_resting(poles, self.neutral)
        ratios = self.damping_weights(poles, beds) * damping_ratios(poles, self.case.loop["sample_time"])
        return np.minimum(ratios.min(axis=1), self.beyond_stable(poles)) / self.required_damping - 1

    def damping_weights(self, poles: np.ndarray, beds: SampledBeds) -> np.ndarray:
        """Factors (b, x) on the damping ratios of poles (b, x): what is asked at most over what is asked of each."""
        step, reserve = self.case.loop["sample_time"], 1 + self.settings.damping_reserve
        return self.required_damping / beds.asked_damping(poles, step, self.required, reserve)

    def beyond_stable(self, poles: np.ndarray) -> np.ndarray:
        """As a damping ratio (b,) that is small where a pole that does not swing leaves the unit circle."""
        return 1 - np.abs(poles).max(axis=1) + 2 * self.required.damping_ratio

    # first derivatives

    def slopes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of cost (m,) and room (r, m) at a point (m,); 0 of what is not free.

        Controller and residual vehicle change the controller's matrices alone. By the weights of an observer these are
        differentiated exactly; by other quantities their differences are exact to six digits. What the matrices do to
        responses, poles and noise is worked out backwards from the figures. Quantities of the rig change the beds too:
        there the figures are differenced.
        """
        judged = self.judged(x)
        cost, rows = np.zeros(len(x)), np.zeros((len(judged.margins), len(x)))
        try:
            at = self.point(x)
        except NoDesign:  # counted where the point was judged
            return cost, rows
        of_controller = [i for i, one in enumerate(self.variables) if self.free[i] and not one.name.startswith(RIG)]
        change, known = self.controller_slopes(x, of_controller)
        if known:
            cost[known], rows[:, known] = backward(self, at, change)
        for i in np.flatnonzero(self.free):
            if self.variables[i].name.startswith(RIG):
                cost[i], rows[:, i] = self._rig_slope(x, int(i))
        spans = np.array([one.span for one in self.variables])
        planned_at = np.array([one.at(one.move.planned) for one in self.variables])
        weights = np.array([one.weight for one in self.variables])
        cost += 2 * self.settings.weight_change * np.where(self.free, weights * (x - planned_at) / spans**2, 0.0)
        return cost, np.where((judged.margins < self.settings.largest_room)[:, None], rows, 0.0)

    def _sides(self, x: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
        step = np.zeros(len(x))
        step[i] = self.settings.difference
        return x + step, x - step

    def controller_slopes(self, x: np.ndarray, numbers: Sequence[int]) -> tuple[np.ndarray, list[int]]:
        """Of the controller's matrices [A B; C D] by some variables, and the numbers of those that have one.

        Of an observer's weights they are exact. Where one side of a difference has no controller the other side alone
        is taken; a variable without either is left where it is.
        """
        weights = [
            name.removeprefix(CONTROLLER) for name in (self.names[i] for i in numbers)
            if self.case.loop.tunes_observer and name.startswith(CONTROLLER)
        ]  # fmt: skip
        slopes = self.controllers.weight_slopes(self.values(x), weights) if weights else []
        known = list(numbers[: len(weights)])
        for i in numbers[len(weights) :]:
            sides = [(side, self._tried(lambda at: block(self.controller(at)), side)) for side in self._sides(x, i)]
            found = [(float(side[i]), matrices) for side, matrices in sides if matrices is not None]
            if len(found) == 1:
                found.append((float(x[i]), block(self.controller(x))))
            if found:
                (at, there), (back_at, back) = found
                slopes.append((there - back) / (at - back_at))
                known.append(i)
        return (np.stack(slopes) if slopes else np.zeros((0, 0, 0))), known

    def _tried(self, made: Callable[[np.ndarray], Made], x: np.ndarray) -> Made | None:
        """What is made at a point (m,), or None where no controller exists; that is counted."""
        try:
            return made(x)
        except NoDesign as fault:
            self.failures[str(fault)] += 1
            return None

    def _rig_slope(self, x: np.ndarray, i: int) -> tuple[float, np.ndarray]:
        """To four digits, by a difference to one side: a set of beds takes long.

        The other side is taken where the first has no controller, and the quantity stays where it is without either.
        """
        here = self.judged(x)
        for side in self._sides(x, i):
            there = self._tried(lambda at: self.evaluated_at(at, self.point(at)), side)
            if there is not None:
                step = float(side[i] - x[i])
                change = self._change(side) - self._change(x)
                return (there.cost - here.cost - change) / step, (there.margins - here.margins) / step
        return 0.0, np.zeros(len(here.margins))


# --- First derivatives with respect to the controller's matrices, worked backwards from the figures.


def backward(search: SpeedSearch, at: Point, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the cost (v,) and of every requirement (r, v) by v variables.

    Parameters
    ----------
    change : ndarray (v, x + k, x + y + w)
        What a unit of each variable changes of the controller's matrices.
    """
    settings, plan, controller = search.settings, at.hardware.plan, at.controller
    sets = plan.every, plan.band, at.hardware.beds
    parts = search.frequency_parts(at.hardware)
    f, minima = [each.frequencies for each in sets], at.curves.minima
    z = np.exp(2j * np.pi * np.concatenate([*f, at.curves.margin_at[minima]]) * controller.sample_time)
    form = resolvent(controller.A)
    k, m = len(controller.C), controller.B.shape[1]
    left = np.concatenate([form.rows(z, controller.C), np.broadcast_to(np.eye(k), (len(z), k, k))], axis=2)
    right = np.concatenate([form.columns(z, controller.B), np.broadcast_to(np.eye(m), (len(z), m, m))], axis=1)

    def of_squares(
        beds: BedSet, part: slice, known: Sequence[str], counts: np.ndarray, pairs: np.ndarray
    ) -> np.ndarray:
        """Derivatives (v,) of the sum of squared errors, each bed's times its count."""
        pull = error_pull(beds, at.acting.at(part), known, counts, pairs)
        total = np.einsum("fki,fkm,fjm->ij", left[part], pull, right[part], optimize=True).real
        return np.tensordot(change, total, 2)

    cost, as_planned = np.zeros(len(change)), np.zeros((OF_ERRORS, len(change)))
    for number, (row, (known, pairs, scale)) in enumerate(zip(at.errors, search.compared, strict=True)):
        counts = np.where(row[:-1] < settings.worst, 1 / (2 * (len(row) - 1) * scale**2), 0.0)
        cost += of_squares(sets[2], parts[2], known, counts, pairs)
        by_square = of_squares(sets[1], parts[1], known, np.array([1 / scale**2]), pairs)
        cost += settings.weight_planned / 2 * by_square * float(row[-1] < settings.worst)
        size = np.sqrt(max(row[-1], SMALLEST_SQUARE) * search.allowed[number])
        as_planned[number] = -(1 + settings.error_reserve) * by_square / (2 * size)
    every = slice(parts[0].start, parts[0].stop)
    there = slice(sum(map(len, f)), None)
    left, right, left_there, right_there = left[every], right[every], left[there], right[there]
    of_margin = left.copy(), right.copy()
    of_margin[0][minima], of_margin[1][minima] = left_there, right_there
    rows = [*_damping_rows(search, at, change), *_loop_rows(search, at, change, (left, right), of_margin), as_planned]
    return cost, np.concatenate(rows)


def error_pull(
    beds: BedSet, acting: FrequencyResponse, known: Sequence[str], share: np.ndarray, pairs: np.ndarray
) -> np.ndarray:
    """Derivatives (f, k, y + w) of Σ share·error² by the controller's responses to readings and known torques.

    ``share`` (b,) is that of each bed, ``pairs`` (h,) which compared functions count.

    With H the compared function, d|log(H/V)|² = 2·Re(conj(log(H/V))·dH/H).
    """
    driven = drive(beds, acting, compared_inputs(beds.case), known)
    difference = return_difference(beds, acting)
    commands = np.linalg.solve(difference, driven.commands)
    back = np.swapaxes(beds.commanded @ np.linalg.inv(difference), 2, 3)  # (b, f, k, c)
    sensors, inputs = compared_columns(beds.case)
    answers = (beds.commanded @ commands + driven.answered)[:, :, sensors, inputs]
    ratio = answers / beds.vehicle
    pull = np.zeros((*commands.shape[:2], back.shape[3], commands.shape[3]), complex)
    weight = 2 * share[:, None, None] * pairs / (ratio.shape[1] * pairs.sum())
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.nan_to_num(weight * np.log(ratio).conj() / answers)
    for h, (sensor, column) in enumerate(zip(sensors, inputs, strict=True)):
        pull[:, :, sensor, column] += part[:, :, h]
    at_command = back @ pull  # (b, f, k, i)
    readings = beds.held @ commands + driven.read  # (b, f, y, i)
    of_readings = (at_command @ np.swapaxes(readings, 2, 3)).sum(axis=0)
    of_known = np.zeros((*of_readings.shape[:2], len(acting.known)), complex)
    for column, number in driven.known.items():
        of_known[:, :, number] += at_command[..., column].sum(axis=0)
    return np.concatenate([of_readings, of_known], axis=2)


def _damping_rows(search: SpeedSearch, at: Point, change: np.ndarray) -> list[np.ndarray]:
    """Of the damping of the active beds, of own poles, and of limits of the manoeuvre, which no controller moves."""
    step, controller, beds = at.controller.sample_time, at.controller, at.active
    poles = without_resting(at.poles, search.neutral)
    factors, size, numbers = search.damping_weights(poles, beds), np.abs(poles), np.arange(len(poles))
    ratios = factors * damping_ratios(poles, step)
    beyond = search.beyond_stable(poles)
    swings = ratios.min(axis=1) <= beyond
    chosen = np.where(swings, ratios.argmin(axis=1), size.argmax(axis=1))
    rows = np.zeros((len(poles), len(change)))
    near = (1 + search.settings.largest_room) * max(search.required_damping, search.case.limits["damping_ratio"])
    close = np.minimum(ratios.min(axis=1), beyond) < near
    if close.any():
        z = poles[numbers, chosen][close]
        moved = pole_changes(beds.some(numbers[close]), controller, z, change)
        of_ratio = factors[numbers, chosen][close, None] * _ratio_change(z, moved, step)
        of_size = -(z.conj()[:, None] * moved).real / np.abs(z)[:, None]
        rows[close] = np.where(swings[close, None], of_ratio, of_size) / search.required_damping
    own, number = search.slowest_own_rate(at)
    of_own = np.zeros((0 if own is None else 1, len(change)))
    if own is not None and own < FASTEST_RATE:
        z = at.own_poles[[number]]
        moved = own_changes(controller, z, change)
        of_own = -(z.conj()[:, None] * moved).real / np.abs(z[:, None]) ** 2 / step / search.own_rate
    shares = search.demands.shares(rig_values(at.hardware.case))
    return [rows, of_own, np.zeros((len(shares), len(change)))]


def _ratio_change(z: np.ndarray, moved: np.ndarray, step: float) -> np.ndarray:
    """Of damping ratios (n, v) where poles z (n,) change by ``moved`` (n, v)."""
    s = (np.log(z.astype(complex)) / step)[:, None]
    by_s = moved / (z[:, None] * step)
    ratio: np.ndarray = -by_s.real / np.abs(s) + s.real * (s.conj() * by_s).real / np.abs(s) ** 3
    return ratio


OFF_THE_POLE = 1e-9  # of |z|: an inverse iteration next to the eigenvalue finds its vectors in one step


def _vectors(matrices: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Left and right eigenvectors (n, x) of matrices (n, x, x) at eigenvalues (n,), and their products (n,)."""
    size = matrices.shape[1]
    shifted = matrices.astype(complex) - (z * (1 + OFF_THE_POLE))[:, None, None] * np.eye(size)
    start = np.broadcast_to(np.cos(np.arange(size))[:, None], (len(z), size, 1)).astype(complex)
    v, w = np.linalg.solve(shifted, start), np.linalg.solve(np.swapaxes(shifted, 1, 2), start)
    v, w = (part[..., 0] / np.linalg.norm(part, axis=1) for part in (v, w))
    return w, v, np.einsum("nx,nx->n", w, v)


def pole_changes(beds: SampledBeds, controller: SampledController, z: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Derivatives (n, v) of one pole z (n,) of every bed's closed loop: dz = wᵀ·dM·v / wᵀ·v (Lancaster 1964)."""
    w, v, both = _vectors(closed_matrices(beds, controller), z)
    x, o, states, y = beds.A.shape[1], controller.reached, len(controller.A), len(controller.sensors)
    k, m = len(controller.C), controller.B.shape[1]
    left, right = np.zeros((len(z), states + k), complex), np.zeros((len(z), states + m), complex)
    left[:, :o], left[:, states:] = w[:, x:], np.einsum("nx,nxk->nk", w[:, :x], beds.B)
    right[:, :o], right[:, states : states + y] = v[:, x:], np.einsum("nyx,nx->ny", beds.C, v[:, :x])
    moved: np.ndarray = _products(left, change, right) / both[:, None]
    return moved


def own_changes(controller: SampledController, z: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The same of poles z (n,) of what runs on known torques alone."""
    o, states = controller.reached, len(controller.A)
    w, v, both = _vectors(np.broadcast_to(controller.own_matrix, (len(z), states - o, states - o)), z)
    left = np.zeros((len(z), change.shape[1]), complex)
    right = np.zeros((len(z), change.shape[2]), complex)
    left[:, o:states], right[:, o:states] = w, v
    moved: np.ndarray = _products(left, change, right) / both[:, None]
    return moved


def _products(left: np.ndarray, change: np.ndarray, right: np.ndarray) -> np.ndarray:
    """left·change·right (n, v) of vectors (n, i), (n, j)."""
    return np.einsum("vnj,nj->nv", np.einsum("ni,vij->vnj", left, change, optimize=True), right)


def _loop_rows(
    search: SpeedSearch, at: Point, change: np.ndarray, sides: tuple[np.ndarray, np.ndarray],
    of_margin: tuple[np.ndarray, np.ndarray],
) -> list[np.ndarray]:  # fmt: skip
    """Of command noise, roll-off, margin and targets; a singular value changes by uᴴ·dM·v.

    ``sides`` are what stands left and right of the change in the controller's response, ``of_margin`` the same where
    the margin is looked at: at a minimum over frequency its place does not count.
    """
    settings, plan, curves = search.settings, at.hardware.plan, at.curves
    allowed = np.array(search.required.command_noise)
    margin, rolled_off = counted(plan, search.required)
    f, held = plan.every.frequencies, plan.every.held[0]
    y = held.shape[1]
    left, readings = sides[0], sides[1][..., :y]  # (f, x + m, y)
    inverse = np.linalg.inv(curves.difference)
    # dH = left·change·readings; the return difference changes by −dH·held
    noisy = np.eye(y) * plan.uncertainty + held @ curves.noise
    power = command_noise(curves, f)
    noise = np.zeros((len(power), len(change)))
    for k in np.flatnonzero(np.isfinite(allowed)).tolist():
        pull = np.einsum(
            "f,fj,fy,fly->fjl", noise_weights(f), inverse[:, k], curves.noise[:, k].conj(), noisy, optimize=True
        )
        total = np.einsum("fji,fjl,fml->im", left, pull, readings, optimize=True).real
        noise[k] = -(1 + settings.reserve) / allowed[k] * np.tensordot(change, total, 2) / power[k]
    sizes = dynamometer_sizes(plan.every.case.rig, plan.every.case.loop)  # singular values are those in balance
    u, _, v = np.linalg.svd(balanced(inverse - np.eye(inverse.shape[-1]), plan.every.case))
    before = np.einsum("fk,fkl,fli->fi", u[:, :, 0].conj() / sizes, inverse, left)
    after = np.einsum("fml,fly,fyj,fj->fm", readings, held, inverse, v[:, 0].conj() * sizes, optimize=True)
    closed = _products(before[rolled_off], change, after[rolled_off]).real
    u, _, v = np.linalg.svd(curves.at_margin)
    before = np.einsum("fk,fki->fi", u[:, :, -1].conj() / sizes, of_margin[0])
    after = np.einsum("fml,fly,fy->fm", of_margin[1][..., :y], curves.held, v[:, -1].conj() * sizes, optimize=True)
    least = -_products(before[margin], change, after[margin]).real
    offsets, allowed = at.offsets, np.array(search.required.sensor_offset)
    of_offsets = np.zeros((0, len(change)))
    if offsets is not None:
        o, states, y_all, k = at.controller.reached, len(at.controller.A), change.shape[2], len(power)
        flanges = len(offsets.torque)
        before, after = np.zeros((flanges, states + k)), np.zeros((flanges, y_all))
        before[:, :o], before[:, states:] = offsets.left[:, :o], offsets.left[:, o:]
        after[:, :o], after[:, states : states + y] = offsets.right[:, :o], offsets.right[:, o:]
        of_offsets = -(1 + settings.reserve) / allowed[:, None] * _products(before, change, after)
    return [
        noise, of_offsets, -(1 + settings.reserve) * closed / search.required.rolled_off,
        least / (search.required.modulus_margin * (1 + settings.reserve)), _target_rows(search, at, change),
    ]  # fmt: skip


def _target_rows(search: SpeedSearch, at: Point, change: np.ndarray) -> np.ndarray:
    rows, step = [], at.controller.sample_time
    _, numbers = search.target_margins(at)
    own = search.case.loop.structure.has_feed_forward
    for number, (target, wanted) in zip(numbers, search.targets, strict=True):
        z = (at.own_poles if own else at.poles[0])[[number]]
        if own:
            moved = own_changes(at.controller, z, change)
        else:
            moved = pole_changes(at.active.some(np.array([0])), at.controller, z, change)
        s = np.log(z.astype(complex)) / step
        by_s = moved / (z[:, None] * step)
        size = (s.conj()[:, None] * by_s).real / np.abs(s)[:, None] / abs(wanted)
        slopes = size / target.frequency_tolerance, _ratio_change(z, moved, step) / target.damping_tolerance
        rows += [side * slope for slope in slopes for side in (-1, 1)]
    return np.concatenate(rows) if rows else np.zeros((0, len(change)))


class Search:
    """Searches of one case at its speeds, as one: mean of their costs, all of their requirements.

    Parameters
    ----------
    members : sequence of SpeedSearch
        With the same variables, one of each speed; a plain case has one. The first one, at the operating point of the
        case, gives targets and drawn beds.
    of : callable
        The same search of another case.
    """

    def __init__(self, members: Sequence[SpeedSearch], of: Callable[[Case], Search]):
        self.members, self._of = tuple(members), of
        first = self.members[0]
        self.case, self.required, self.settings = first.case, first.required, first.settings
        self.variables = first.variables
        self.begin, self.values, self.bounds = first.begin, first.values, first.bounds
        self.controller, self.hardware, self.names = first.controller, first.hardware, first.names
        self.known: dict[tuple[float, ...], Evaluation] = {}

    def with_less_noise(self, factor: float) -> Search:
        """The same search, every sensor of the controller with so many times less noise; for 1 the search itself."""
        if factor == 1:
            return self
        case, read = self.case, set(self.case.loop.controller_sensors)
        sensors = tuple(
            replace(one, uncertainty=sensor_noise(one, case.loop["sample_time"]) / factor, counts=None)
            if one.name in read else one
            for one in case.rig.sensors
        )  # fmt: skip
        quiet = self._of(replace(case, rig=replace(case.rig, sensors=sensors)))
        quiet.free = self.free
        return quiet

    @property
    def of_errors(self) -> int:
        """How many of the margins, the last ones, are errors of the bed as planned."""
        return OF_ERRORS * len(self.members)

    @property
    def free(self) -> np.ndarray:
        """Which variables (m,) move now."""
        return self.members[0].free

    @free.setter
    def free(self, which: np.ndarray) -> None:
        for one in self.members:
            one.free = which

    @property
    def beds_seen(self) -> int:
        """How many beds the search sees, over all speeds."""
        return sum(len(one.active) for one in self.members)

    def see_planned_beds(self) -> None:
        """Have the search see no other beds than those as planned."""
        for one in self.members:
            one.active = (0,)

    @property
    def sees_opened(self) -> bool:
        """Whether beds with opened cut shafts have to stay stable."""
        return any(one.opened for one in self.members)

    @property
    def failures(self) -> Counter[str]:
        """Settings without a controller at one of the speeds, by the reason."""
        return sum((one.failures for one in self.members), Counter[str]())

    def leave_out_opened(self) -> list[_Pool]:
        """See :meth:`SpeedSearch.leave_out_opened`; with the answer :meth:`see_again` takes it back."""
        before = [one.with_opened() for one in self.members]
        self._all("leave_out_opened")
        return before

    def see_again(self, pools: Sequence[_Pool]) -> list[_Pool]:
        """Have the search see the beds of other pools; the pools that it saw."""
        now = [one.with_opened(pool) for one, pool in zip(self.members, pools, strict=True)]
        self.known.clear()
        return now

    def activate(self, x: np.ndarray) -> None:
        """See :meth:`SpeedSearch.activate`."""
        self._all("activate", x)

    def forget(self) -> None:
        """See :meth:`SpeedSearch.forget`."""
        self._all("forget")

    def _all(self, method: str, *arguments: Any) -> None:
        for one in self.members:
            getattr(one, method)(*arguments)
        self.known.clear()

    @property
    def best(self) -> np.ndarray:
        """The best point (m,) that was judged since the beds to be seen were chosen."""
        return np.array(min(self.known, key=lambda key: self.known[key].penalised_cost))

    def judged(self, x: np.ndarray) -> Evaluation:
        """Cost and requirements at a point (m,): damping at every speed, what else is asked there, errors."""
        key = tuple(x.tolist())
        if key not in self.known:
            each = [one.judged(x) for one in self.members]
            least = self._ordered([one.least_margins for one in each])
            errors = np.min([one.least_margins[-OF_ERRORS:] for one in each], axis=0)
            self.known[key] = Evaluation(
                float(np.mean([one.cost for one in each])), self._ordered([one.margins for one in each]),
                np.concatenate([least[: -self.of_errors], errors]), self.settings.penalty,
                self.settings.error_penalty, max(one.unstable for one in each),
            )  # fmt: skip
        return self.known[key]

    def slopes(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See :meth:`SpeedSearch.slopes`."""
        each = [one.slopes(x) for one in self.members]
        return np.mean([cost for cost, _ in each], axis=0), self._ordered([rows for _, rows in each])

    def _ordered(self, each: Sequence[np.ndarray]) -> np.ndarray:
        """Requirements (r, …) of every speed in the order of one search: damping, the rest, errors."""
        counts = [len(one.active) for one in self.members]
        return np.concatenate([
            *(rows[:count] for rows, count in zip(each, counts, strict=True)),
            *(rows[count:-OF_ERRORS] for rows, count in zip(each, counts, strict=True)),
            *(rows[-OF_ERRORS:] for rows in each),
        ])  # fmt: skip


def search_for(
    case: Case,
    moves: Sequence[Move],
    shares: Mapping[str, float],
    asked: Demands,
    settings: SearchSettings | None = None,
) -> Search:
    """The search at the case's speeds over beds from its box: spread evenly, the same whenever the case is matched.

    Parameters
    ----------
    moves : sequence of Move
        What may move in addition to the weights of an observer.
    shares : mapping
        Of the target modes' energy that each of them holds, by name.
    """
    settings = settings or SearchSettings()
    speeds = [] if case.operating_range is None else [at_speed(case, speed) for speed in ends_of(case)]
    return Search(
        [_at_one_speed(one, moves, shares, asked, settings) for one in (case, *speeds)],
        lambda other: search_for(other, moves, shares, asked, settings),
    )


def _at_one_speed(
    case: Case, moves: Sequence[Move], shares: Mapping[str, float], asked: Demands, settings: SearchSettings
) -> SpeedSearch:
    variables = variables_of(case, moves, shares)
    spread = case.uncertainty.spread(max(settings.drawn, settings.pool))
    positions = np.vstack([np.zeros((1, spread.shape[1])), spread])
    return SpeedSearch(case, variables, requirements(case), asked, settings, positions, np.ones(len(variables), bool))
