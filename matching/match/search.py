"""The search: controller, residual vehicle and adapters tuned together over a set of beds, for every structure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeGuard, TypeVar

import numpy as np
import scipy

from matching.match.beds import (
    BED_POINTS,
    SHARES,
    LoopCurves,
    Planned,
    command_noise,
    counted,
    damping_left,
    descended,
    loop_curves,
    noise_weights,
    planned,
    sensor_noise,
    with_reduced_stiffness,
)
from matching.match.case import (
    Case,
    Demands,
    Move,
    Requirements,
    apply,
    change_weight,
    requirements,
    rig_values,
    scaled,
    target_modes,
    unscaled,
)
from matching.match.loop import (
    Bed,
    BedSet,
    FrequencyResponse,
    SampledBeds,
    SampledController,
    bed_of,
    closed_matrices,
    closed_poles,
    compared_columns,
    compared_inputs,
    controller_on,
    damping_ratios,
    damping_weights,
    drive,
    errors,
    feed_forward_of,
    frequency_response,
    linear_bed,
    rates,
    responses_of,
    return_difference,
    side_by_side,
    without_limits,
    without_resting,
)
from matching.match.loop_modes import eigenvalue_of, inside_unit_circle, neutral_motions
from modelling.bed.observer import (
    Ahead,
    Feedback,
    Filter,
    ObserverModel,
    assembled,
    feedback_on_all,
    feedback_slopes,
    filter_of,
    filter_slopes,
    observer_model,
    predicted,
    runs_ahead,
)
from modelling.errors import InputError
from modelling.linear.resolvent import resolvent

# --- What the search works with.


@dataclass(frozen=True)
class SearchSettings:
    """Numbers of the search. Where no source is given, a number was chosen by trial on the reference and drawn cases.

    Attributes
    ----------
    drawn : int
        Beds whose response errors are the cost.
    pool : int
        Beds that have to stay damped; of these the search sees the least damped ones.
    active : int
        Beds of the pool that are added to the active set at a time.
    rounds, steps, most_steps : int
        Rounds of SQP at most, steps of each, and steps of all rounds together from one start.
    joint_rounds : int
        Rounds in which residual vehicle and adapters move together with the controller.
    scenarios : int
        Times that the least damped beds of the whole box are added to the pool.
    blind : int
        Settings spread over all bounds (Sobol 1967) where every start misses a requirement.
    starts : int
        Starts that are followed; an observer's search stops at the first one that keeps every requirement.
    fresh : int
        Beds that judge the result; none of them is seen by the search.
    weight_planned : float
        Weight of the bed as planned, beside the mean of the drawn beds.
    weight_change : float
        Cost of a quantity that moves over its whole range and holds all energy of a target mode; what holds less costs
        more, by Eqs. 6 to 8.
    reserve, damping_reserve : float
        Relative, by which requirements are drawn in: the search works on coarser grids than the judge, and the least
        damping over beds has a long tail.
    penalty : float
        Cost of a requirement missed by all of it, by which points are compared.
    stable_share : float
        Of the damping that drawn beds need, for beds that only have to be stable.
    largest_room : float
        Relative constraint margin above which a requirement does not steer the search.
    worst : float
        Largest squared error over its tolerance that counts, and the cost of a setting without a controller.
    furthest : float
        Decades of a weight, or share of a range, that a round may go.
    worth_a_round : float
        Relative gain of a round below which no other follows.
    worth_at_all : float
        The same, absolute: thousandths of the squared tolerance.
    settled : float
        Change of the cost at which a round ends.
    points_a_step : int
        Points that a round may judge for each step: where line searches come to nothing, it ends.
    kept : float
        Relative constraint margin from which a requirement counts as met: within its reserve.
    hopeless : float
        Merit after a round above which no other follows, and cost above which no adapter is worth ordering for.
    calmer : tuple of float
        Shares of the controller's quantities above their lower bounds that are tried where the end is not stable.
    difference : float
        Half the step of central differences, decades or share of a range: error of the sixth digit.
    inset : float
        Share of a range by which bounds are drawn in: at a bound of 0 a lead or an integrator would lose its state.
    """

    drawn: int = 24
    pool: int = 160
    active: int = 12
    rounds: int = 6
    steps: int = 20
    most_steps: int = 200
    joint_rounds: int = 3
    scenarios: int = 2
    blind: int = 64
    starts: int = 4
    fresh: int = 200
    weight_planned: float = 0.1
    weight_change: float = 1e-3
    reserve: float = 0.03
    damping_reserve: float = 0.1
    penalty: float = 10.0
    stable_share: float = 0.1
    largest_room: float = 1.0
    worst: float = 1e3
    furthest: float = 1.0
    worth_a_round: float = 0.01
    worth_at_all: float = 1e-3
    settled: float = 1e-4
    points_a_step: int = 4
    kept: float = -2e-3
    hopeless: float = 50.0
    calmer: tuple[float, ...] = (1.0, 0.9, 0.7, 0.5, 0.35, 0.25, 0.12, 0.06, 0.0)
    difference: float = 1e-4
    inset: float = 5e-4


CONTROLLER, RESIDUAL, RIG = "loop.", "residual_vehicle.", "rig."  # the names of quantities begin so
REGULATOR = "command_weight", "command_change_weight"  # of the observer's state feedback; the others are the filter's


@dataclass(frozen=True)
class Variable:
    """A quantity that the search moves; its coordinate runs from 0 to ``span``: decades of a weight, else 1."""

    move: Move
    span: float
    weight: float

    @property
    def name(self) -> str:
        """As under ``[move]``."""
        return self.move.name

    def at(self, value: float) -> float:
        """Coordinate of a value, SI."""
        return self.span * scaled(float(np.clip(value, self.move.lower, self.move.upper)), self.move)

    def value(self, x: float) -> float:
        """Value, SI, at a coordinate."""
        return float(unscaled(x / self.span, self.move))


def variables_of(case: Case, moves: Sequence[Move], shares: Mapping[str, float]) -> tuple[Variable, ...]:
    """The weights of an observer, unless it is fixed, then what may move.

    ``shares`` are those of the target modes' energy by name.
    """
    made = []
    if case.loop.tunes_observer:
        for name, known in case.loop.structure.quantities.items():
            move = Move(
                f"{CONTROLLER}{name}", (f"{CONTROLLER}{name}",), case.loop[name], known.lower, known.upper, known.unit,
                case.loop[name],
            )  # fmt: skip
            made.append(Variable(move, float(np.log10(known.upper / known.lower)), 0.0))
    for move in moves:
        if move.name.startswith(CONTROLLER):
            if not case.loop.tunes_observer:
                made.append(Variable(move, 1.0, 0.0))
        else:
            made.append(Variable(move, 1.0, change_weight(shares.get(move.name, 1.0))))
    return tuple(made)


# --- The controller and the beds at a point of the search. Beds depend on the quantities of the rig alone.

UNSTABLE = 1e6  # cost of a bed as planned that is not stable: more than any errors of one that is
KEPT = 40  # designs of a kind that are kept
Design = TypeVar("Design")


class Controllers:
    """The controllers of a case by values (SI): models and gains that were worked out lately are kept."""

    def __init__(self, case: Case):
        self.case = case
        self._designs: dict[str, dict[tuple[float, ...], Any]] = {}

    def at(self, values: Mapping[str, float]) -> SampledController:
        """The controller with quantities at other values than the case's."""
        case = apply(self.case, values)
        of_bed = tuple(value for name, value in values.items() if not name.startswith(CONTROLLER))
        if not case.loop.structure.is_observer:
            of_rig = tuple(value for name, value in values.items() if name.startswith(RIG))
            bed = self._kept("bed", of_bed, lambda: linear_bed(case))
            feed_forward = self._kept("feed-forward", of_rig, lambda: feed_forward_of(case))
            return controller_on(replace(bed, case=case), feed_forward)
        model, ahead, feedback, estimate = self._observer(case, of_bed)
        gains = predicted(model, feedback.F, feedback.of_torques)
        return without_limits(assembled(model, ahead, gains, estimate.correction))

    def weight_slopes(self, values: Mapping[str, float], names: Sequence[str]) -> list[np.ndarray]:
        """What a decade of each of some weights of an observer changes of the controller's matrices."""
        case = apply(self.case, values)
        of_bed = tuple(value for name, value in values.items() if not name.startswith(CONTROLLER))
        model, ahead, feedback, estimate = self._observer(case, of_bed)
        gains, correction = predicted(model, feedback.F, feedback.of_torques), estimate.correction
        of_filter = [name for name in names if name not in REGULATOR]
        loop = case.loop.values
        slopes = feedback_slopes(model, feedback, *(loop[name] for name in REGULATOR))
        by_gains = dict(zip(REGULATOR, slopes, strict=True))
        by_correction = dict(zip(of_filter, filter_slopes(model, estimate, loop, of_filter), strict=True))

        def ended(of_gains: np.ndarray | float, of_correction: np.ndarray | float) -> np.ndarray:
            return block(without_limits(assembled(model, ahead, gains + of_gains, correction + of_correction)))

        here = ended(0.0, 0.0)  # the matrices are linear in the gains
        return [ended(by_gains.get(name, 0.0), by_correction.get(name, 0.0)) - here for name in names]

    def _observer(self, case: Case, of_bed: tuple[float, ...]) -> tuple[ObserverModel, Ahead, Feedback, Filter]:
        loop = case.loop.values
        model, ahead = self._kept("model", of_bed, lambda: self._model(case))
        regulator = tuple(loop[name] for name in REGULATOR)
        of_filter = tuple(loop[name] for name in case.loop.structure.quantities if name not in REGULATOR)
        feedback = self._kept("feedback", (*of_bed, *regulator), lambda: feedback_on_all(model, *regulator))
        return model, ahead, feedback, self._kept("filter", (*of_bed, *of_filter), lambda: filter_of(model, loop))

    def _model(self, case: Case) -> tuple[ObserverModel, Ahead]:
        model = observer_model(case.rig, case.residual_vehicle, case.loop)
        return model, runs_ahead(model)

    def _kept(self, kind: str, key: tuple[float, ...], design: Callable[[], Design]) -> Design:
        designs = self._designs.setdefault(kind, {})
        if key not in designs:
            if len(designs) >= KEPT:
                designs.clear()
            designs[key] = design()
        made: Design = designs[key]
        return made


@dataclass(frozen=True)
class Hardware:
    """The beds with certain adapters: as planned, those whose errors are the cost, and others by their places."""

    case: Case
    plan: Planned
    beds: BedSet
    others: dict[tuple[bytes, float], Bed] = field(default_factory=dict)
    sets: dict[tuple[bytes, ...], SampledBeds] = field(default_factory=dict)

    def beds_at(self, positions: np.ndarray, left: float | Sequence[float] = 1.0) -> SampledBeds:
        """Beds at positions (b, p) of the case's box, with ``left`` of the stiffness and damping of their cut shafts.

        Each, and each set, is worked out once.
        """
        lefts = np.broadcast_to(left, len(positions))
        key = positions.tobytes(), lefts.tobytes()
        if key not in self.sets:
            if len(self.sets) > 4:
                self.sets.clear()
            places = zip(positions, lefts.tolist(), strict=True)
            self.sets[key] = side_by_side([self._bed(position, share) for position, share in places])
        return self.sets[key]

    def _bed(self, position: np.ndarray, left: float) -> Bed:
        key = position.tobytes(), left
        if key not in self.others:
            values = with_reduced_stiffness(self.case, self.case.uncertainty.at(position), left)
            self.others[key] = bed_of(self.case, values)
        return self.others[key]


@dataclass(frozen=True)
class Judged:
    """Cost of a point and relative constraint margins, negative where a requirement is missed.

    Attributes
    ----------
    room : ndarray (r,)
        Damping of every active bed and of what runs on known torques alone, limits of the manoeuvre, command noise of
        every dynamometer, roll-off and margin at every frequency, targets.
    least : ndarray (s,)
        The same, of roll-off and margin the worst alone.
    penalty : float
        Cost of a requirement missed by all of it.
    unstable : float
        Cost of a bed as planned that is not stable, 0 where it is.
    """

    cost: float
    room: np.ndarray
    least: np.ndarray
    penalty: float
    unstable: float = 0.0

    @property
    def merit(self) -> float:
        """By which points are compared: the cost, and much for what is missed, more where the errors are large."""
        missed = float(np.maximum(-self.least, 0.0).sum())
        return self.cost + self.penalty * max(self.cost, 1.0) * missed + self.unstable


@dataclass(frozen=True)
class Point:
    """What was worked out at a point: poles (b, x) of the ``active`` beds, errors (2, b + 1) over their tolerances.

    Errors to unmeasured and to measured torques, of the bed as planned last.
    """

    hardware: Hardware
    active: SampledBeds
    controller: SampledController
    acting: FrequencyResponse
    curves: LoopCurves
    poles: np.ndarray
    own_poles: np.ndarray
    errors: np.ndarray


@dataclass
class Search:
    """Cost of a point on a set of beds, and what is left of the requirements.

    Attributes
    ----------
    variables : tuple of Variable (m)
    free : ndarray (m,)
        Which of them move now.
    positions : ndarray (b, p)
        Where in the box the beds of the pool are, the bed as planned first; ``left`` is what is left of the stiffness
        of their cut shafts, by number, where it is not all, ``shares`` the part of the damping they have to keep.
    active : tuple of int
        The beds of the pool that the search sees.
    highest : dict of str to float
        Largest coordinate of some variables, by name.
    """

    case: Case
    variables: tuple[Variable, ...]
    required: Requirements
    demands: Demands
    settings: SearchSettings
    positions: np.ndarray
    free: np.ndarray
    active: tuple[int, ...] = (0,)
    left: dict[int, float] = field(default_factory=dict)
    shares: dict[int, float] = field(default_factory=dict)
    highest: dict[str, float] = field(default_factory=dict)
    known: dict[tuple[float, ...], Judged] = field(default_factory=dict)
    _points: dict[tuple[float, ...], Point] = field(default_factory=dict)
    _hardware: dict[tuple[float, ...], Hardware] = field(default_factory=dict)
    _vehicle: np.ndarray | None = None

    def __post_init__(self) -> None:
        self.controllers = Controllers(self.case)
        self.neutral = neutral_motions(linear_bed(self.case))
        wanted = [eigenvalue_of(mode) for _, mode in target_modes(self.case)]
        self.targets = list(zip(self.case.targets, wanted, strict=True))
        self.tolerances = ((), self.case.unmeasured_tolerance), (self.case.loop.measured, self.case.tolerance)

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
        """Values by name, SI, mirror images too, at a point (m,)."""
        return {
            name: one.value(part) for one, part in zip(self.variables, x.tolist(), strict=True)
            for name in one.move.together
        }  # fmt: skip

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest coordinates (m,)."""
        spans = np.array([one.span for one in self.variables])
        inset = self.settings.inset
        highest = [self.highest.get(one.name, np.inf) for one in self.variables]
        return inset * spans, np.minimum((1 - inset) * spans, highest)

    def controller(self, x: np.ndarray) -> SampledController:
        """The controller at a point (m,)."""
        return self.controllers.at(self.values(x))

    # beds

    def hardware(self, x: np.ndarray) -> Hardware:
        """The beds at a point (m,)."""
        values = {name: value for name, value in self.values(x).items() if name.startswith(RIG)}
        key = tuple(values.values())
        if key not in self._hardware:
            if len(self._hardware) > KEPT:
                self._hardware.clear()
            case = apply(self.case, values)
            noise = sensor_noise(case, case.loop.controller_sensors)
            drawn = [case.uncertainty.at(position) for position in self.positions[1 : self.settings.drawn + 1]]
            frequencies = np.geomspace(*case.band, BED_POINTS)
            beds = responses_of(case, [bed_of(case, of_bed) for of_bed in drawn], drawn, frequencies, self._vehicle)
            self._hardware[key] = Hardware(case, planned(case, noise), beds)
            if not any(name.removeprefix(RIG) in case.vehicle.parameters for name in values):
                self._vehicle = beds.vehicle  # adapters are no part of the vehicle
        return self._hardware[key]

    def activate(self, x: np.ndarray, count: int | None = None) -> None:
        """Have the search see the least damped beds of the pool at a point (m,) as well."""
        try:
            room = self.rooms_at(x, self.positions)
        except InputError:
            return
        least = np.argsort(room)[: self.settings.active if count is None else count]
        self.active = tuple(sorted({0, *self.active, *least.tolist()}))
        self.forget()

    def rooms_at(self, x: np.ndarray, positions: np.ndarray, left: float = 1.0) -> np.ndarray:
        """What is left (b,) of the damping that beds at positions (b, p) need, as a share of it."""
        beds = self.hardware(x).beds_at(positions, left)
        return self._damping_room(closed_poles(beds, self.controller(x)), beds)

    def add(self, positions: np.ndarray, share: float = 1.0, left: float = 1.0) -> tuple[int, ...]:
        """Have the search see beds at positions (b, p) that keep a share of the damping drawn beds need; their numbers.

        Of stiffness and damping of their cut shafts ``left`` is left; where they open, the share falls with it.
        """
        count = len(self.positions)
        self.positions = np.vstack([self.positions, positions])
        added = tuple(range(count, len(self.positions)))
        self.left |= dict.fromkeys(added, left)
        self.shares |= dict.fromkeys(added, share * damping_left(left))
        self.active = (*self.active, *added)
        self.forget()
        return added

    def keep_first(self, count: int) -> None:
        """Leave out the beds that were added after the first ``count``."""
        self.positions = self.positions[:count]
        self.active = tuple(number for number in self.active if number < count)
        self.forget()

    def ask(self, shares: Mapping[int, float]) -> None:
        """Have beds, by number, keep other parts of the damping that drawn beds need."""
        self.shares |= shares
        self.known.clear()

    def forget(self) -> None:
        """What was judged with other beds."""
        self.known.clear()
        self._points.clear()

    # cost and requirements

    def judged(self, x: np.ndarray) -> Judged:
        """Cost and requirements at a point (m,); kept until other beds are seen."""
        key = tuple(x.tolist())
        if key not in self.known:
            try:
                self.known[key] = self._judged(x, self.point(x))
            except InputError:
                count = 1 if not self.known else len(next(iter(self.known.values())).room)
                short = 1 if not self.known else len(next(iter(self.known.values())).least)
                self.known[key] = Judged(
                    self.settings.worst, np.full(count, -1.0), np.full(short, -1.0), self.settings.penalty
                )
        return self.known[key]

    @property
    def best(self) -> np.ndarray:
        """The best point (m,) that was judged since the beds to be seen were chosen."""
        return np.array(min(self.known, key=lambda key: self.known[key].merit))

    def point(self, x: np.ndarray) -> Point:
        """Work a point (m,) out."""
        key = tuple(x.tolist())
        if key not in self._points:
            if len(self._points) > 4:
                self._points.clear()
            hardware, controller = self.hardware(x), self.controller(x)
            sets = hardware.plan.every, hardware.plan.band, hardware.beds
            acting = frequency_response(controller, np.concatenate([each.frequencies for each in sets]))
            parts = self._parts(hardware)
            drawn, plan = ((beds, acting.at(part)) for beds, part in ((sets[2], parts[2]), (sets[1], parts[1])))
            squares = [
                np.concatenate([errors(*beds, known).mean(axis=1) for beds in (drawn, plan)]) / tolerance**2
                for known, tolerance in self.tolerances
            ]
            active = hardware.beds_at(
                self.positions[list(self.active)], [self.left.get(number, 1.0) for number in self.active]
            )
            # what does not steer the search needs no search between frequencies
            below = self.required.modulus_margin * (1 + self.settings.reserve) * (1 + self.settings.largest_room)
            curves = loop_curves(hardware.plan, controller, acting.at(parts[0]), self.required, below)
            self._points[key] = Point(
                hardware, active, controller, acting, curves,
                closed_poles(active, controller), np.linalg.eigvals(controller.own_matrix),
                np.array(squares),
            )  # fmt: skip
        return self._points[key]

    def _parts(self, hardware: Hardware) -> list[slice]:
        """Where the frequencies of all, of the band as planned and of the drawn beds stand among those of a point."""
        sets = hardware.plan.every, hardware.plan.band, hardware.beds
        begins = np.cumsum([0, *(len(each.frequencies) for each in sets)]).tolist()
        return [slice(a, b) for a, b in pairwise(begins)]

    def _shares(self) -> np.ndarray:
        """Of the damping that drawn beds need, what each active bed has to keep; as planned also the case's limit."""
        of_limit = self.case.limits["damping_ratio"] * (1 + self.settings.reserve) / self._damping
        return np.array([self.shares.get(number, max(1.0, of_limit) if number == 0 else 1.0) for number in self.active])

    @property
    def _damping(self) -> float:
        return self.required.damping_ratio * (1 + self.settings.damping_reserve)

    def _judged(self, x: np.ndarray, at: Point) -> Judged:
        settings = self.settings
        squares = np.minimum(at.errors, settings.worst).mean(axis=0)
        cost = float(squares[:-1].mean() + settings.weight_planned * squares[-1]) + self._change(x)
        rooms = [np.clip(part, -1e2, settings.largest_room) for part in self._rooms(x, at)]
        *single, rolled_off, margin, targets = rooms
        worst = [np.array([part.min(initial=settings.largest_room)]) for part in (rolled_off, margin)]
        return Judged(
            cost,
            np.concatenate(rooms),
            np.concatenate([*single, *worst, targets]),
            settings.penalty,
            UNSTABLE if rooms[0][0] <= -self._shares()[0] else 0.0,
        )

    def _change(self, x: np.ndarray) -> float:
        changes = [
            one.weight * (part / one.span - one.at(one.move.planned) / one.span) ** 2
            for one, part in zip(self.variables, x, strict=True)
        ]
        return self.settings.weight_change * float(sum(changes))

    def _rooms(self, x: np.ndarray, at: Point) -> list[np.ndarray]:
        """Of damping, of own poles, manoeuvre, noise, roll-off, margin, targets."""
        settings, plan, allowed = self.settings, at.hardware.plan, self.required.command_noise
        margin, rolled_off = counted(plan, self.required)
        noise = command_noise(at.curves, plan.every.frequencies)
        own = self._least_own(at)[0]
        return [
            1 + self._damping_room(at.poles, at.active) - self._shares(),
            np.zeros(0) if own is None else np.array([own / self.required.damping_ratio - 1 + settings.reserve]),
            1 - (1 + settings.reserve) * self.demands.shares(rig_values(at.hardware.case)),
            np.ones(len(noise)) if allowed is None else 1 - (1 + settings.reserve) * noise / allowed,
            1 - (1 + settings.reserve) * at.curves.closed[rolled_off] / self.required.rolled_off,
            at.curves.margin[margin] / (self.required.modulus_margin * (1 + settings.reserve)) - 1,
            self._of_targets(at)[0],
        ]

    def _least_own(self, at: Point) -> tuple[float | None, int]:
        """Least damping ratio of what runs on known torques alone, and the number of that pole."""
        if not len(at.own_poles):
            return None, 0
        ratios = damping_ratios(without_resting(at.own_poles[None], self.neutral), at.controller.sample_time)[0]
        return float(ratios.min()), int(ratios.argmin())

    def _of_targets(self, at: Point) -> tuple[np.ndarray, list[int]]:
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

    def _damping_room(self, poles: np.ndarray, beds: SampledBeds) -> np.ndarray:
        """What is left (b,) of the damping that beds with poles (b, x) need."""
        poles = without_resting(poles, self.neutral)
        ratio = (self._weights(poles, beds) * damping_ratios(poles, self.case.loop["sample_time"])).min(axis=1)
        return np.minimum(ratio, self._beyond_stable(poles)) / self._damping - 1

    def _weights(self, poles: np.ndarray, beds: SampledBeds) -> np.ndarray:
        step = self.case.loop["sample_time"]
        return damping_weights(beds, poles, step, self._damping, self.required.rolled_off_from)

    def _beyond_stable(self, poles: np.ndarray) -> np.ndarray:
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
        cost, room = np.zeros(len(x)), np.zeros((len(judged.room), len(x)))
        try:
            at = self.point(x)
            of_controller = [i for i, one in enumerate(self.variables) if self.free[i] and not one.name.startswith(RIG)]
            if of_controller:
                change = self._controller_slopes(x, of_controller)
                cost[of_controller], rows = backward(self, at, change)
                room[:, of_controller] = rows
            for i in np.flatnonzero(self.free):
                if self.variables[i].name.startswith(RIG):
                    cost[i], room[:, i] = self._rig_slope(x, int(i))
        except InputError:
            return np.zeros(len(x)), np.zeros((len(judged.room), len(x)))
        spans = np.array([one.span for one in self.variables])
        planned_at = np.array([one.at(one.move.planned) for one in self.variables])
        weights = np.array([one.weight for one in self.variables])
        cost += 2 * self.settings.weight_change * np.where(self.free, weights * (x - planned_at) / spans**2, 0.0)
        return cost, np.where((judged.room < self.settings.largest_room)[:, None], room, 0.0)

    def _sides(self, x: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
        step = np.zeros(len(x))
        step[i] = self.settings.difference
        return x + step, x - step

    def _controller_slopes(self, x: np.ndarray, numbers: Sequence[int]) -> np.ndarray:
        """Of the controller's matrices [A B; C D] by some variables; of an observer's weights they are exact."""
        weights = [
            name.removeprefix(CONTROLLER) for name in (self.names[i] for i in numbers)
            if self.case.loop.tunes_observer and name.startswith(CONTROLLER)
        ]  # fmt: skip
        slopes = self.controllers.weight_slopes(self.values(x), weights) if weights else []
        for i in numbers[len(weights) :]:
            there, back = (block(self.controller(side)) for side in self._sides(x, i))
            slopes.append((there - back) / (2 * self.settings.difference))
        return np.stack(slopes)

    def _rig_slope(self, x: np.ndarray, i: int) -> tuple[float, np.ndarray]:
        """To four digits, by a forward difference: a set of beds takes long."""
        side, here = self._sides(x, i)[0], self.judged(x)
        there = self._judged(side, self.point(side))
        change = self._change(side) - self._change(x)
        return (there.cost - here.cost - change) / self.settings.difference, (there.room - here.room) / (
            self.settings.difference
        )


# --- First derivatives with respect to the controller's matrices, worked backwards from the figures.


def block(controller: SampledController) -> np.ndarray:
    """[A B; C D] (x + k, x + y + w)."""
    return np.block([[controller.A, controller.B], [controller.C, controller.D]])


def backward(search: Search, at: Point, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the cost (v,) and of every requirement (r, v) by v variables.

    Parameters
    ----------
    change : ndarray (v, x + k, x + y + w)
        What a unit of each variable changes of the controller's matrices.
    """
    settings, plan, controller = search.settings, at.hardware.plan, at.controller
    sets = plan.every, plan.band, at.hardware.beds
    parts = search._parts(at.hardware)
    f, minima = [each.frequencies for each in sets], at.curves.minima
    z = np.exp(2j * np.pi * np.concatenate([*f, at.curves.margin_at[minima]]) * controller.sample_time)
    form = resolvent(controller.A)
    k, m = len(controller.C), controller.B.shape[1]
    left = np.concatenate([form.rows(z, controller.C), np.broadcast_to(np.eye(k), (len(z), k, k))], axis=2)
    right = np.concatenate([form.columns(z, controller.B), np.broadcast_to(np.eye(m), (len(z), m, m))], axis=1)
    total = np.zeros(change.shape[1:])
    for number, beds, part, weight in (
        (slice(None, -1), sets[2], parts[2], 1.0), (slice(-1, None), sets[1], parts[1], settings.weight_planned),
    ):  # fmt: skip
        for row, (known, tolerance) in zip(at.errors, search.tolerances, strict=True):
            counts = np.where(row[number] < settings.worst, weight / (2 * len(row[number]) * tolerance**2), 0.0)
            pull = error_pull(beds, at.acting.at(part), known, counts)
            total += np.einsum("fki,fkm,fjm->ij", left[part], pull, right[part], optimize=True).real
    cost = np.tensordot(change, total, 2)
    every = slice(parts[0].start, parts[0].stop)
    beside = slice(sum(map(len, f)), None)
    left, right, beside_left, beside_right = left[every], right[every], left[beside], right[beside]
    of_margin = left.copy(), right.copy()
    of_margin[0][minima], of_margin[1][minima] = beside_left, beside_right
    rows = [*_damping_rows(search, at, change), *_loop_rows(search, at, change, (left, right), of_margin)]
    return cost, np.concatenate(rows)


def error_pull(beds: BedSet, acting: FrequencyResponse, known: Sequence[str], share: np.ndarray) -> np.ndarray:
    """Derivatives (f, k, y + w) of Σ share·error² by the controller's responses to readings and known torques.

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
    weight = 2 * share[:, None, None] / (ratio.shape[1] * ratio.shape[2])
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


def _damping_rows(search: Search, at: Point, change: np.ndarray) -> list[np.ndarray]:
    """Of the damping of the active beds, of own poles, and of limits of the manoeuvre, which no controller moves."""
    step, controller, beds = at.controller.sample_time, at.controller, at.active
    poles = without_resting(at.poles, search.neutral)
    factors, size, numbers = search._weights(poles, beds), np.abs(poles), np.arange(len(poles))
    ratios = factors * damping_ratios(poles, step)
    beyond = search._beyond_stable(poles)
    swings = ratios.min(axis=1) <= beyond
    chosen = np.where(swings, ratios.argmin(axis=1), size.argmax(axis=1))
    rows = np.zeros((len(poles), len(change)))
    near = (1 + search.settings.largest_room) * max(search._damping, search.case.limits["damping_ratio"])
    close = np.minimum(ratios.min(axis=1), beyond) < near
    if close.any():
        z = poles[numbers, chosen][close]
        moved = pole_changes(beds.some(numbers[close]), controller, z, change)
        of_ratio = factors[numbers, chosen][close, None] * _ratio_change(z, moved, step)
        of_size = -(z.conj()[:, None] * moved).real / np.abs(z)[:, None]
        rows[close] = np.where(swings[close, None], of_ratio, of_size) / search._damping
    own, number = search._least_own(at)
    of_own = np.zeros((0 if own is None else 1, len(change)))
    if own is not None:
        z = at.own_poles[[number]]
        of_own = _ratio_change(z, own_changes(controller, z, change), step) / search.required.damping_ratio
    shares = search.demands.shares(rig_values(at.hardware.case))
    return [rows, of_own, np.zeros((len(shares), len(change)))]


def _ratio_change(z: np.ndarray, moved: np.ndarray, step: float) -> np.ndarray:
    """Of damping ratios (n, v) where poles z (n,) change by ``moved`` (n, v)."""
    s = (np.log(z.astype(complex)) / step)[:, None]
    by_s = moved / (z[:, None] * step)
    ratio: np.ndarray = -by_s.real / np.abs(s) + s.real * (s.conj() * by_s).real / np.abs(s) ** 3
    return ratio


OFF_THE_POLE = 1e-9  # of |z|: an inverse iteration beside the eigenvalue finds its vectors in one step


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
    search: Search, at: Point, change: np.ndarray, sides: tuple[np.ndarray, np.ndarray],
    of_margin: tuple[np.ndarray, np.ndarray],
) -> list[np.ndarray]:  # fmt: skip
    """Of command noise, roll-off, margin and targets; a singular value changes by uᴴ·dM·v.

    ``sides`` are what stands left and right of the change in the controller's response, ``of_margin`` the same where
    the margin is looked at: at a minimum over frequency its place does not count.
    """
    settings, plan, curves, allowed = search.settings, at.hardware.plan, at.curves, search.required.command_noise
    margin, rolled_off = counted(plan, search.required)
    f, held = plan.every.frequencies, plan.every.held[0]
    y = held.shape[1]
    left, readings = sides[0], sides[1][..., :y]  # (f, x + m, y)
    inverse = np.linalg.inv(curves.difference)
    # dH = left·change·readings; the return difference changes by −dH·held
    noisy = np.eye(y) * plan.uncertainty + held @ curves.noise
    power = command_noise(curves, f)
    noise = np.zeros((len(power), len(change)))
    if allowed is not None:
        for k in range(len(power)):
            pull = np.einsum(
                "f,fj,fy,fly->fjl", noise_weights(f), inverse[:, k], curves.noise[:, k].conj(), noisy, optimize=True
            )
            total = np.einsum("fji,fjl,fml->im", left, pull, readings, optimize=True).real
            noise[k] = -(1 + settings.reserve) / allowed * np.tensordot(change, total, 2) / power[k]
    u, _, v = np.linalg.svd(inverse - np.eye(inverse.shape[-1]))
    before = np.einsum("fk,fkl,fli->fi", u[:, :, 0].conj(), inverse, left)
    after = np.einsum("fml,fly,fyj,fj->fm", readings, held, inverse, v[:, 0].conj(), optimize=True)
    closed = _products(before[rolled_off], change, after[rolled_off]).real
    u, _, v = np.linalg.svd(curves.at_margin)
    before = np.einsum("fk,fki->fi", u[:, :, -1].conj(), of_margin[0])
    after = np.einsum("fml,fly,fy->fm", of_margin[1][..., :y], curves.held, v[:, -1].conj(), optimize=True)
    least = -_products(before[margin], change, after[margin]).real
    return [
        noise, -(1 + settings.reserve) * closed / search.required.rolled_off,
        least / (search.required.modulus_margin * (1 + settings.reserve)), _target_rows(search, at, change),
    ]  # fmt: skip


def _target_rows(search: Search, at: Point, change: np.ndarray) -> np.ndarray:
    rows, step = [], at.controller.sample_time
    _, numbers = search._of_targets(at)
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


# --- Prepare


def search_for(
    case: Case,
    moves: Sequence[Move],
    shares: Mapping[str, float],
    asked: Demands,
    settings: SearchSettings | None = None,
) -> Search:
    """The search over beds from the case's box: spread evenly, the same whenever the case is matched.

    Parameters
    ----------
    moves : sequence of Move
        What may move beside the weights of an observer.
    shares : mapping
        Of the target modes' energy that each of them holds, by name.
    """
    settings = settings or SearchSettings()
    variables = variables_of(case, moves, shares)
    spread = case.uncertainty.spread(max(settings.drawn, settings.pool))
    positions = np.vstack([np.zeros((1, spread.shape[1])), spread])
    return Search(case, variables, requirements(case), asked, settings, positions, np.ones(len(variables), bool))


# --- Rounds of sequential quadratic programming (SciPy's SLSQP), each from where the one before ended.


@dataclass(frozen=True)
class SearchEnd:
    """Where a search ended: the point (m,), what was judged there, and the steps that led there."""

    x: np.ndarray
    judged: Judged
    steps: int = 0

    @property
    def merit(self) -> float:
        """By which ends are compared."""
        return self.judged.merit


def end_at(search: Search, x: np.ndarray) -> SearchEnd:
    """A point (m,) judged with the beds of the pool that are least damped there."""
    search.activate(x)
    return SearchEnd(x, search.judged(x))


def judged_again(search: Search, end: SearchEnd) -> SearchEnd:
    """The same point by what the search asks now, with the beds that it sees."""
    return replace(end, judged=search.judged(end.x))


def keeps_all(search: Search, end: SearchEnd) -> bool:
    """Whether every requirement is met."""
    return bool(end.judged.least.min() >= search.settings.kept)


def misses(search: Search, end: SearchEnd) -> bool:
    """Whether a requirement is missed by more than the reserve by which the search draws it in."""
    reserves = np.full(len(end.judged.least), search.settings.reserve)
    reserves[: len(search.active)] = search.settings.damping_reserve
    return bool((end.judged.least < -reserves).any())


def rounds(search: Search, begin: SearchEnd, most_rounds: int, most_steps: int) -> SearchEnd:
    """Rounds, each from the best point of the one before with the beds that were least damped there."""
    (low, high), best, used, settings = search.bounds(), begin, 0, search.settings
    for _ in range(most_rounds):
        x = best.x
        within = np.maximum(low, x - settings.furthest), np.minimum(high, x + settings.furthest)
        used += _improve(search, x, within, max(min(settings.steps, most_steps - used), 1))
        end = end_at(search, search.best)
        best = judged_again(search, best)
        worth = best.merit - end.merit >= max(settings.worth_a_round * best.merit, settings.worth_at_all)
        best = min(best, end, key=lambda end: end.merit)
        if not worth or used >= most_steps or (end.merit > settings.hopeless and end.judged.cost > 1):
            break
    return replace(best, steps=used)


class _TooManyPoints(Exception):
    """Line searches come to nothing."""


def _improve(search: Search, begin: np.ndarray, within: tuple[np.ndarray, np.ndarray], steps: int) -> int:
    """The steps that were taken; what was judged on the way is known to the search.

    What a start misses is allowed at a price, by one slack for the damping of beds and one for the rest: a setting that
    cannot do anything for one requirement may still do so for the others (elastic mode).
    """
    count, settings = 0, search.settings
    price = 3 * settings.penalty * max(1.0, search.judged(begin).cost)
    moving = np.flatnonzero(search.free)
    room = search.judged(begin).room
    of_damping = np.arange(len(room)) < len(search.active)
    groups = [group for group in (of_damping, ~of_damping) if room[group].min(initial=0.0) < settings.kept]
    slacks = np.stack([group.astype(float) for group in groups], axis=1) if groups else np.zeros((len(room), 0))
    missed = np.array([-room[group].min() for group in groups])

    def whole(y: np.ndarray) -> np.ndarray:
        x = begin.copy()
        x[moving] = y[: len(moving)]
        return x

    def cost(y: np.ndarray) -> float:
        nonlocal count
        count += 1
        if count > settings.points_a_step * steps:
            raise _TooManyPoints
        return search.judged(whole(y)).cost + price * float(y[len(moving) :].sum())

    @lru_cache(maxsize=1)  # cost and requirements ask for their slopes one after the other, at the same point
    def slopes(y: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        of_cost, of_room = search.slopes(whole(np.array(y)))
        prices = np.full(slacks.shape[1], price)
        return np.concatenate([of_cost[moving], prices]), np.hstack([of_room[:, moving], slacks])

    bounds = [*zip(within[0][moving], within[1][moving], strict=True), *[(0.0, None)] * len(missed)]
    try:
        result = scipy.optimize.minimize(
            cost, np.concatenate([begin[moving], missed]), bounds=bounds, method="SLSQP",
            jac=lambda y: slopes(tuple(y.tolist()))[0],
            constraints={
                "type": "ineq", "fun": lambda y: search.judged(whole(y)).room + slacks @ y[len(moving) :],
                "jac": lambda y: slopes(tuple(y.tolist()))[1],
            },
            options={"maxiter": steps, "ftol": settings.settled * max(1.0, search.judged(search.best).cost)},
        )  # fmt: skip
    except _TooManyPoints:
        return steps
    return int(result.nit)


# --- Beds with opened cut shafts have to be stable: reached by homotopy in the constraint level and in the dead time.
#
# From weights that know no opened shafts the requirements are far off and their slopes lead nowhere. So what is missed
# is asked for in parts, each round beginning near what it has to keep; and where that comes to a stop, shorter dead
# times, at which opened shafts cost little, lead there (continuation: Allgower and Georg, Numerical Continuation
# Methods, 1990).


@dataclass(frozen=True)
class OpenedSettings:
    """Numbers of that homotopy; all were chosen by trial.

    Attributes
    ----------
    drawn : int
        Drawn beds, each looked at with all shares of its cut shafts left.
    planned_price, drawn_price : float
        Relative cost that stable opened beds may add, as planned and drawn.
    raised : float
        Decades that the weight on commands may rise: more would damp the emulated modes along with the opened beds.
    parts : int
        That a requirement is asked for in, at most.
    part : float
        Of what the worst bed misses, that a round leaves.
    small : float
        Of the damping that drawn beds need: what is missed by less is asked for at once.
    steps : int
        Of a round that asks for a part.
    stuck : float
        Of what the worst bed missed before: a round that leaves more is the last one.
    last_rounds, drawn_rounds : int
        Rounds that ask for everything, as planned and drawn.
    dead_times : tuple of float
        Of the case's own, over which the search comes to it.
    """

    drawn: int = 16
    planned_price: float = 2.0
    drawn_price: float = 0.25
    raised: float = 2.0
    parts: int = 12
    part: float = 0.25
    small: float = 1.0
    steps: int = 20
    stuck: float = 0.9
    last_rounds: int = 4
    drawn_rounds: int = 2
    dead_times: tuple[float, ...] = (0.5, 0.6, 0.7, 0.8, 0.9)


OPENED = OpenedSettings()


def with_opened(search: Search, best: SearchEnd) -> SearchEnd:
    """The best end with opened cut shafts that are stable, or ``best`` where none is there at the price.

    First the bed as planned has to be stable with every share of its cut shafts, then drawn beds have to be. What is
    kept is seen by the search from then on.
    """
    planned_beds = {left: np.zeros((1, search.positions.shape[1])) for left in SHARES}
    name = f"{CONTROLLER}{REGULATOR[0]}"
    search.highest = {name: float(best.x[search.names.index(name)]) + OPENED.raised}
    end = _kept_opened(search, best, planned_beds)
    if end is None:
        search.highest = {}
        return best
    drawn = least_stable_opened(search, end.x)
    return (_kept_of_drawn(search, end, drawn) if drawn else None) or end


def least_stable_opened(search: Search, x: np.ndarray) -> dict[float, np.ndarray]:
    """Position (1, p) of the least stable of some beds with opened cut shafts, by the share left, if it is unstable."""
    positions, least = search.case.uncertainty.spread(OPENED.drawn), {}
    for left in SHARES:
        room = search.rooms_at(x, positions, left)
        if room.min() < search.settings.stable_share * damping_left(left) - 1:
            least[left] = positions[[int(room.argmin())]]
    return least


def _kept_opened(search: Search, best: SearchEnd, opened: Mapping[float, np.ndarray]) -> SearchEnd | None:
    """The end with opened beds, positions (n, p) by the share left, if they are stable at no more than the price.

    Without an end they are not seen any more.
    """
    if not keeps_all(search, best):
        return None
    count, most = len(search.positions), min((1 + OPENED.planned_price) * best.judged.cost, 1.0)
    numbers = _add(search, opened)
    end: SearchEnd | None = _in_parts(search, best.x, numbers, most)
    if not _is_within(search, end, most):
        search.active = (0, *numbers)
        search.forget()
        end = _over_dead_times(search, best.x, opened, most)
    if not _is_within(search, end, most):
        search.keep_first(count)
        return None
    return end


def _kept_of_drawn(search: Search, best: SearchEnd, opened: Mapping[float, np.ndarray]) -> SearchEnd | None:
    """The same of drawn beds, which the best end nearly keeps: at once, and for less."""
    count = len(search.positions)
    _add(search, opened)
    end = _asked_at_once(search, end_at(search, best.x), OPENED.drawn_rounds)
    if not _is_within(search, end, min((1 + OPENED.drawn_price) * best.judged.cost, 1.0)):
        search.keep_first(count)
        return None
    return end


def _is_within(search: Search, end: SearchEnd | None, most: float) -> TypeGuard[SearchEnd]:
    return end is not None and keeps_all(search, end) and end.judged.cost <= most


def _add(search: Search, opened: Mapping[float, np.ndarray]) -> tuple[int, ...]:
    """The numbers that they have in the pool."""
    return tuple(
        number
        for left, positions in opened.items()
        for number in search.add(positions, search.settings.stable_share, left)
    )


def _asked_at_once(search: Search, begin: SearchEnd, most_rounds: int = OPENED.last_rounds) -> SearchEnd:
    return rounds(search, begin, most_rounds, search.settings.most_steps // 2)


def _in_parts(search: Search, begin: np.ndarray, numbers: tuple[int, ...], most: float) -> SearchEnd:
    """The end from ``begin`` (m,) on, the beds of some numbers asked for in parts.

    It is where the rounds stopped, if they came to a stop or if the cost rose above ``most``.
    """
    asked = np.array([search.shares[number] for number in numbers])
    lefts = np.array([search.left[number] for number in numbers])
    positions = search.positions[list(numbers)]

    def rooms(x: np.ndarray) -> np.ndarray:
        each = [search.rooms_at(x, position[None], left)[0] for position, left in zip(positions, lefts, strict=True)]
        return np.array(each)

    end, before = end_at(search, begin), np.inf
    for _ in range(OPENED.parts):
        missed = np.maximum(asked - 1 - rooms(end.x), 0.0)
        worst = float(missed.max())
        stopped = worst > OPENED.small and (worst > OPENED.stuck * before or end.judged.cost > most)
        if stopped or worst <= OPENED.small:
            break
        search.ask(dict(zip(numbers, (asked - np.minimum(missed, OPENED.part * worst)).tolist(), strict=True)))
        end = rounds(search, judged_again(search, end), 1, OPENED.steps)
        before = worst
    search.ask(dict(zip(numbers, asked.tolist(), strict=True)))
    end = judged_again(search, end)
    return end if stopped else _asked_at_once(search, end)


def _over_dead_times(
    search: Search, begin: np.ndarray, opened: Mapping[float, np.ndarray], most: float
) -> SearchEnd | None:
    """The end at the dead time of the case, reached from ``begin`` (m,) over shorter ones; none where one has none."""
    first, *others = OPENED.dead_times
    at = _with_dead_time(search, first)
    begin = rounds(at, end_at(at, begin), search.settings.rounds, search.settings.steps).x
    end = _in_parts(at, begin, _add(at, opened), most)
    for part in (*others, 1.0):
        if not _is_within(at, end, most):
            return None
        at = search if part == 1 else _with_dead_time(search, part)
        if at is not search:
            _add(at, opened)
        end = _asked_at_once(at, end_at(at, end.x))
    return end


def _with_dead_time(search: Search, part: float) -> Search:
    """The same search where the dead time in the middle of the box is only a part of the case's."""
    dead_time = part * search.case.loop["dead_time"]
    case = apply(search.case, {"loop.dead_time": dead_time})
    return replace(
        search, case=case, positions=search.positions[: search.settings.pool + 1], active=(0,), left={}, shares={},
        known={}, _points={}, _hardware={},
    )  # fmt: skip


# --- The least damped beds of a box: descents from the least damped ones of a pool.


@dataclass(frozen=True)
class DescentSettings:
    """Numbers of the descents to the least damped beds; all were chosen by trial.

    Attributes
    ----------
    begins : int
        Beds of the pool from which a descent begins, the least damped ones.
    rounds : int
        Of a descent at most, each with a gradient of its own.
    further : float
        Times the pool: beds that are looked through once for what the pool has missed.
    most_added : int
        Of those, the least damped ones.
    """

    begins: int = 2
    rounds: int = 3
    further: float = 5.4
    most_added: int = 12


DESCENT = DescentSettings()


def worst_positions(room: Callable[[np.ndarray], np.ndarray], pool: np.ndarray) -> np.ndarray:
    """Positions (n, p) in the box at which least is left of a requirement, by descents from those of a pool (b, p).

    Parameters
    ----------
    room : callable
        What is left (b,) of the requirement at positions (b, p), each coordinate from −1 to 1.
    """
    if not pool.size:
        return pool[:0]
    begins = pool[np.argsort(room(pool))[: DESCENT.begins]]
    ends = [descended(lambda at: 1 + room(at)[:, None], begin, DESCENT.rounds) for begin in begins]
    return np.unique([position for _, position, _ in ends], axis=0)


def add_scenarios(search: Search, at: SearchEnd) -> bool:
    """Whether beds miss their damping there that the search did not see; it sees the least damped from now on.

    Looked at are the worst beds of the box and further beds that fill it.
    """
    settings, box = search.settings, search.case.uncertainty
    if not box.uncertain:
        return False
    try:
        seen = np.array([number for number in search.active if search.left.get(number, 1.0) == 1.0])
        worst = worst_positions(lambda positions: search.rooms_at(at.x, positions), search.positions[seen])
        unstable = worst[search.rooms_at(at.x, worst) < settings.stable_share - 1]
        # what beds miss anyway, more beds do not cure
        count = 0 if misses(search, at) else round(DESCENT.further * settings.pool)
        further = box.spread(settings.pool + count)[settings.pool :]
        room = search.rooms_at(at.x, further) if count else np.zeros(0)
    except InputError:
        return False
    number = min(DESCENT.most_added, int((room < -settings.damping_reserve / 2).sum()))
    missed = further[np.argsort(room)[:number]]
    for positions, share in ((unstable, settings.stable_share), (missed, 1.0)):
        if len(positions):
            search.add(positions, share)
    return bool(len(unstable) or len(missed))


# --- The whole search.

NEARLY_AS_CHEAP = 1.5  # times the cost of the cheapest start, up to which the requirements decide between starts
SPREAD_GAINS = 8  # starts of a feedback law's gains, spread over their bounds (Sobol 1967)
MIDDLE = 0.6  # of every gain's range, where a feedback law is searched from as well
GENTLE = 0.02  # the same: a loop that does little is stable where a bed without control is


@dataclass(frozen=True)
class Found:
    """What a search found: values by name (SI), the point, and how it is judged; ``starts`` are the starts' costs.

    ``controller_alone`` is the end where only the weights of an observer moved, of a feedback law where everything did;
    ``gains_alone`` the best end of a feedback law's gains alone.
    """

    values: dict[str, float]
    end: SearchEnd
    starts: tuple[float, ...]
    controller_alone: SearchEnd
    keeps_all: bool
    gains_alone: SearchEnd | None = None


def solve(
    search: Search, tell: Callable[[str], None] = lambda _: None, begins: Sequence[Mapping[str, float]] = ()
) -> Found:  # fmt: skip
    """The best point that was found.

    An observer's search begins at the better one of the case's weights and further starts, and at the next one where it
    ends with a requirement missed; where all do by more than the reserve, at the best of settings spread over the
    bounds. Only then do residual vehicle and adapters move as well: its weights alone come near the end. The cost of a
    feedback law has several valleys: its gains are tuned alone from several starts, then everything from the best end,
    and from the case's own gains where no end keeps every requirement. No answer is worse than the case as given.
    With ``begins``, values by name (SI), it begins at these instead.
    """
    settings, of_observer = search.settings, search.case.loop.tunes_observer
    given = end_at(search, search.begin())
    of_controller = np.array([one.name.startswith(CONTROLLER) for one in search.variables])
    everything = np.ones(len(search.variables), bool)
    search.free = of_controller if of_observer else everything
    ends, gains = _from_starts(search, [search.begin(values) for values in begins])
    tell("controller")
    if of_observer and settings.scenarios and ends[0].judged.cost <= 1:
        ends[0] = with_opened(search, ends[0])  # beyond their tolerance the errors limit the match anyway
    left = settings.most_steps - sum(end.steps for end in ends)
    alone = best = _with_scenarios(search, ends[0], left, 1 if of_observer else settings.joint_rounds)
    if of_observer and not of_controller.all():
        search.free = everything
        best = rounds(search, end_at(search, alone.x), settings.joint_rounds, settings.most_steps // 2)
        best = _with_scenarios(search, best, settings.steps)
    tell("residual vehicle and adapters")
    answers = [end.x for end in (best, alone, given)]
    stable = [is_stable(search, x) for x in answers]
    if not stable[0]:  # what misses its targets can still be run: it is delivered stable where anything is
        calm = [x for x in (_calmer(search, x) for x in (*answers, *(end.x for end in ends))) if x is not None]
        answers, stable = answers + calm, stable + [True] * len(calm)
    for x in answers:
        search.activate(x)
    ends_now = [SearchEnd(x, search.judged(x)) for x in answers]
    alone = ends_now[1]
    best = min(zip(stable, ends_now, strict=True), key=lambda one: (not one[0], one[1].merit))[1]
    return Found(
        search.values(best.x), best, tuple(end.judged.cost for end in ends), alone,
        keeps_all(search, best), gains,
    )  # fmt: skip


def is_stable(search: Search, x: np.ndarray) -> bool:
    """Whether the bed as planned and every bed of the pool are stable at a point (m,), also where they creep away."""
    hardware, controller = search.hardware(x), search.controller(x)
    sets = (side_by_side([bed_of(hardware.case, {})]), hardware.beds_at(search.positions))
    return all(inside_unit_circle(z, search.neutral) for beds in sets for z in closed_poles(beds, controller))


def _calmer(search: Search, x: np.ndarray) -> np.ndarray | None:
    """A point (m,) with the controller's quantities drawn towards their lower bounds until every bed is stable."""
    low, _ = search.bounds()
    of_controller = np.array([one.name.startswith(CONTROLLER) for one in search.variables])
    calm = (np.where(of_controller, low + part * (x - low), x) for part in search.settings.calmer)
    return next((point for point in calm if is_stable(search, point)), None)


def _with_scenarios(search: Search, best: SearchEnd, left: int, most_rounds: int = 1) -> SearchEnd:
    """The end with the least damped beds of the whole box added, while there are such."""
    for _ in range(search.settings.scenarios):
        if not add_scenarios(search, end_at(search, best.x)):
            break
        end = rounds(search, end_at(search, best.x), most_rounds, max(left, search.settings.steps))
        best = min((judged_again(search, one) for one in (best, end)), key=lambda one: one.merit)
    return best


def _from_starts(search: Search, given: list[np.ndarray]) -> tuple[list[SearchEnd], SearchEnd | None]:
    """Where the starts ended, the best one first, and the best end of a feedback law's gains alone."""
    settings, starts, ends = search.settings, given or _starts(search), []
    of_observer = search.case.loop.tunes_observer
    most_rounds, most_steps, gains = settings.rounds, settings.most_steps // 4, None
    if not of_observer:
        (starts, gains), most_rounds = _with_gains(search, starts), settings.joint_rounds
    begins = _ranked([_anew(search, start) for start in starts]) if of_observer else [_anew(search, x) for x in starts]
    search.active = (0,)
    for begin in begins[: settings.starts]:
        ends.append(rounds(search, end_at(search, begin.x), most_rounds, most_steps))
        if of_observer and keeps_all(search, ends[-1]):
            break
    if settings.blind and all(misses(search, end) for end in ends):
        ends.append(rounds(search, end_at(search, _spread(search, 1)[0]), most_rounds, most_steps))
    return sorted((judged_again(search, end) for end in ends), key=lambda end: end.merit), gains


def _with_gains(search: Search, starts: list[np.ndarray]) -> tuple[list[np.ndarray], SearchEnd | None]:
    """Points (m,) to go on from with everything free, and the best end with the gains of a feedback law tuned alone.

    The points are that end and, where it keeps not every requirement, the first start as it is.
    """
    settings = search.settings
    gains = np.array([one.name.startswith(CONTROLLER) for one in search.variables])
    if not gains.any():
        return starts[:1], None
    free, search.free = search.free, gains
    low, high = search.bounds()
    parts = scipy.stats.qmc.Sobol(int(gains.sum()), seed=0).random(SPREAD_GAINS if settings.blind else 0)
    ends, more = [], [starts[0].copy() for _ in parts]
    for start, part in zip(more, parts, strict=True):
        start[gains] = low[gains] + part * (high - low)[gains]
    for start in [*starts, *more][: settings.starts * 2]:
        begin = _anew(search, start)
        ends.append(rounds(search, begin, settings.joint_rounds, settings.most_steps // 4))
    search.free = free
    best = min(ends, key=lambda end: end.merit)
    return ([best.x] if keeps_all(search, best) else [best.x, starts[0]]), best


def _starts(search: Search) -> list[np.ndarray]:
    """Points (m,): the case's own, and others of the controller's quantities."""
    low, high = search.bounds()
    loop = search.case.loop
    begin = np.clip(search.begin(), low, high)
    if search.case.loop.tunes_observer:
        further = [
            {f"{CONTROLLER}{name}": value for name, value in values.items()} for values in loop.structure.further_starts
        ]
        return [begin, *(np.clip(search.begin(values), low, high) for values in further)]
    gains = np.array([one.name.startswith(CONTROLLER) for one in search.variables])
    if not gains.any():
        return [begin]
    return [begin, *(np.where(gains, low + part * (high - low), begin) for part in (MIDDLE, GENTLE))]


def _anew(search: Search, x: np.ndarray) -> SearchEnd:
    """A start judged with the beds alone that are least damped there."""
    search.active = (0,)
    return end_at(search, x)


def _ranked(begins: list[SearchEnd]) -> list[SearchEnd]:
    """First those nearly as cheap as the cheapest one, then the others, each by what they miss."""
    cheap = NEARLY_AS_CHEAP * min(begin.judged.cost for begin in begins)
    return sorted(begins, key=lambda begin: (begin.judged.cost > cheap, begin.merit))


def _spread(search: Search, count: int) -> list[np.ndarray]:
    """The best of settings whose free quantities are spread over all bounds."""
    low, high = search.bounds()
    begin = np.clip(search.begin(), low, high)
    spread = low + (high - low) * scipy.stats.qmc.Sobol(len(low), seed=0).random(search.settings.blind)
    tried = np.where(search.free, spread, begin)
    return sorted(tried, key=lambda x: search.judged(x).merit)[:count]
