"""Tuning of an observer's weights over drawn beds: the beds' mean square error, with what every one has to keep."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TypeGuard, TypeVar

import numpy as np
import scipy

from matching.match.beds import (
    BED_POINTS,
    SHARES,
    DesignPoint,
    GainSlopes,
    Judged,
    Planned,
    ResponseSlopes,
    beds_at,
    command_noise,
    counted,
    damping_left,
    error_slopes,
    feedback_slopes,
    filter_slopes,
    loop_curves,
    loop_slopes,
    planned,
    pole_slopes,
    response_slopes,
    with_reduced_stiffness,
)
from matching.match.case import LARGEST_ROLLED_OFF, Case, Requirements, requirements
from matching.match.loop import (
    Bed,
    BedSet,
    SampledBeds,
    bed_of,
    bed_set,
    closed_poles,
    damping_ratios,
    damping_weights,
    errors,
    feedforward_states,
    frequency_response,
    of_observer,
    side_by_side,
)
from modelling.bed.bed import ObserverController
from modelling.bed.observer import (
    Ahead,
    Feedback,
    Filter,
    ObserverModel,
    assembled,
    feedback_on_all,
    filter_of,
    laid_out,
    observer_model,
    predicted,
    runs_ahead,
)
from modelling.bed.vehicle import cut
from modelling.errors import InputError

# --- Gains of an observer and its state feedback for given weights, and their derivatives.

SETS_KEPT = 40  # of the points last worked out
REGULATOR = (
    "command_weight",
    "command_change_weight",
)  # the weights of the state feedback; the others are the filter's
PER_DECADE = float(np.log(10))
Design = TypeVar("Design")


@dataclass
class Gains:
    """Of a model; w weights, given by their decimal logarithms in the order of ``names``.

    ``_regulators`` (with gains (k, o)) and ``_filters`` hold what was worked out lately.
    """

    model: ObserverModel
    ahead: Ahead
    names: tuple[str, ...]
    _regulators: dict[tuple[float, ...], tuple[Feedback, np.ndarray]] = field(default_factory=dict)
    _filters: dict[tuple[float, ...], Filter] = field(default_factory=dict)

    def controller(self, logarithms: np.ndarray) -> ObserverController:
        """The controller for weights (w,)."""
        return assembled(self.model, self.ahead, self.feedback(logarithms), self.correction(logarithms))

    def feedback(self, logarithms: np.ndarray) -> np.ndarray:
        """Gains (k, o) of the state feedback for logarithms (w,), see :mod:`modelling.bed.observer`."""
        return self._regulator(logarithms)[1]

    def correction(self, logarithms: np.ndarray) -> np.ndarray:
        """Correction for logarithms (w,), (n + e + v, y); see :class:`modelling.bed.observer.Filter`."""
        return self._filter(logarithms).correction

    def _weights(self, logarithms: np.ndarray, of_regulator: bool) -> dict[str, float]:
        named = zip(self.names, logarithms.tolist(), strict=True)
        return {name: 10.0**value for name, value in named if (name in REGULATOR) == of_regulator}

    def _regulator(self, logarithms: np.ndarray) -> tuple[Feedback, np.ndarray]:
        weights = self._weights(logarithms, True)

        def design() -> tuple[Feedback, np.ndarray]:
            made = feedback_on_all(self.model, *(weights[name] for name in REGULATOR))
            return made, predicted(self.model, made.F, made.of_torques)

        return _kept_design(self._regulators, tuple(weights.values()), design)

    def _filter(self, logarithms: np.ndarray) -> Filter:
        weights = self._weights(logarithms, False)
        return _kept_design(self._filters, tuple(weights.values()), lambda: filter_of(self.model, weights))

    def slopes(self, logarithms: np.ndarray) -> GainSlopes:
        """Derivatives of the gains at logarithms (w,): a weight changes feedback or correction alone."""
        priced, weights = self._weights(logarithms, True), self._weights(logarithms, False)
        made, gains = self._regulator(logarithms)
        model, x = self.model, len(self.model.bed.whole)
        o = x + len(model.dynamometers) * (model.bed.delay + 1) + model.estimated
        of_feedback = feedback_slopes(model, made, *(PER_DECADE * priced[name] for name in REGULATOR))
        of_filter = filter_slopes(model, self._filter(logarithms), weights, tuple(weights))
        feedback = np.zeros((len(self.names), *gains[:, :o].shape))
        correction = np.zeros((len(self.names), o, of_filter.shape[2]))
        for slopes, name in zip(of_feedback, REGULATOR, strict=True):
            feedback[self.names.index(name)] = slopes[:, :o]
        for slopes, name in zip(of_filter, weights, strict=True):
            correction[self.names.index(name)] = laid_out(model, slopes)
        return GainSlopes(feedback, correction)


def _kept_design(
    designs: dict[tuple[float, ...], Design], key: tuple[float, ...], design: Callable[[], Design]
) -> Design:
    """A design that was worked out lately, or is now."""
    if key not in designs:
        if len(designs) > SETS_KEPT:
            designs.clear()
        designs[key] = design()
    return designs[key]


# --- What the search over an observer's weights asks at a point: cost and requirements, and their first derivatives.

RESERVE = 0.03  # relative, by which requirements are drawn in: figures of the search are a little coarse
DAMPING_RESERVE = 0.1  # the same for the least damping, whose tail over beds is long
PLANNED = 0.1  # weight of the bed as planned beside the mean of the drawn ones
WORST = 1e3  # cost of a design that has no solution, and largest error over its tolerance that counts
LARGEST_ROOM = 1.0  # of a requirement: what is kept by more than this does not steer the search
STABLE_SHARE = 0.1  # of the damping that drawn beds need, for beds that only have to be stable, with a reserve
GUARDS = 12  # of the pool's beds, the least damped ones, that the search comes to see at a time


@dataclass
class Tuner:
    """Cost of an observer's weights on a set of beds, and what is left of the requirements.

    Attributes
    ----------
    beds : BedSet
        Whose errors are the cost.
    pool, positions : tuple of Bed, ndarray (b, p)
        All that have to stay damped, and where in the case's box they are. The search sees those that ``guarded``
        numbers: the least damped ones, see :meth:`guard`, and those that were added.
    shares : mapping of int to float
        What part of the damping that drawn beds need a bed has to keep, by number, where it is not all of it.
    gains : Gains
        Its w weights are the variables of the search, as decimal logarithms; ``highest`` bounds some of them.
    """

    case: Case
    model: ObserverModel
    required: Requirements
    plan: Planned
    beds: BedSet
    pool: tuple[Bed, ...]
    positions: np.ndarray
    gains: Gains
    guarded: tuple[int, ...] = ()
    shares: Mapping[int, float] = field(default_factory=dict)
    highest: Mapping[str, float] = field(default_factory=dict)
    known: dict[tuple[float, ...], Judged] = field(default_factory=dict)
    _last: tuple[tuple[float, ...], DesignPoint] | None = None

    def judged(self, logarithms: np.ndarray) -> Judged:
        """Cost and requirements at a point of the search, decimal logarithms (w,) of the weights; results are kept."""
        key = tuple(logarithms.tolist())
        if key not in self.known:
            try:
                self.known[key] = self._judged(self.point(logarithms))
            except InputError:
                count = len(self.guarded) + 3
                self.known[key] = Judged(WORST, np.full(self._requirements, -1.0), np.full(count, -1.0))
        return self.known[key]

    @cached_property
    def sampled_pool(self) -> SampledBeds:
        """The pool from sample to sample."""
        return side_by_side(self.pool)

    @property
    def _guards(self) -> SampledBeds:
        return self.sampled_pool.some(np.array(self.guarded, int))

    def guard(self, logarithms: np.ndarray, count: int = GUARDS) -> None:
        """Have the search see the least damped beds of the pool at a point (w,) as well."""
        try:
            room = self.rooms_of(self.sampled_pool, logarithms)
        except InputError:
            return
        self.guarded = tuple(sorted({*self.guarded, *np.argsort(room)[:count].tolist()}))
        self.known.clear()
        self._last = None

    def rooms_of(self, beds: SampledBeds, logarithms: np.ndarray) -> np.ndarray:
        """What is left (b,) of the damping that each bed needs at a point (w,), as a share of it."""
        poles = closed_poles(beds, of_observer(self.gains.controller(logarithms)))
        return self._damping_room(poles, beds)

    def add(self, positions: np.ndarray, share: float = 1.0, left: float = 1.0) -> None:
        """Have the search keep beds at positions (b, p) of the box damped by a share of what drawn beds need.

        Of stiffness and damping of their cut shafts ``left`` is left; where they open, the share falls with it.
        """
        count, box = len(self.positions), self.case.uncertainty
        self.positions = np.vstack([self.positions, positions])
        values = [with_reduced_stiffness(self.case, box.at(position), left) for position in positions]
        self.pool = (*self.pool, *(bed_of(self.case, of_bed) for of_bed in values))
        added = range(count, len(self.positions))
        self.ask(dict.fromkeys(added, share * damping_left(left)))
        self.guarded = (*self.guarded, *added)
        self._forget_pool()

    def ask(self, shares: Mapping[int, float]) -> None:
        """Have beds, by number, keep other parts of the damping that drawn beds need."""
        self.shares = {**self.shares, **shares}
        self.known.clear()

    def keep_first(self, count: int) -> None:
        """Leave out the beds that were added after the first ``count``."""
        self.positions, self.pool = self.positions[:count], self.pool[:count]
        self.guarded = tuple(number for number in self.guarded if number < count)
        self._forget_pool()

    def _forget_pool(self) -> None:
        self.__dict__.pop("sampled_pool", None)
        self.known.clear()
        self._last = None

    @property
    def best(self) -> np.ndarray:
        """The best point (w,) that was judged since the beds to be seen were chosen."""
        return np.array(min(self.known, key=lambda key: self.known[key].merit))

    @cached_property
    def _ahead(self) -> np.ndarray:
        """States of the model that runs ahead at all frequencies; the weights do not reach it."""
        start = np.log10([self.case.loop.values[name] for name in self.gains.names])
        return feedforward_states(of_observer(self.gains.controller(start)), self._frequencies)

    @cached_property
    def _frequencies(self) -> np.ndarray:
        return np.concatenate([self.plan.every.frequencies, self.plan.band.frequencies, self.beds.frequencies])

    def _of(self, beds: BedSet) -> slice:
        """Where the frequencies of a set of beds stand among all."""
        sets = [self.plan.every, self.plan.band, self.beds]
        begins = np.cumsum([0, *(len(each.frequencies) for each in sets)])
        at = next(i for i, each in enumerate(sets) if each is beds)
        return slice(int(begins[at]), int(begins[at + 1]))

    @cached_property
    def _counted(self) -> tuple[np.ndarray, np.ndarray]:
        return counted(self.plan, self.required)

    @property
    def _requirements(self) -> int:
        return len(self.guarded) + len(self.model.dynamometers) + sum(int(where.sum()) for where in self._counted)

    def point(self, logarithms: np.ndarray) -> DesignPoint:
        """Work a point (w,) out."""
        key = tuple(logarithms.tolist())
        if self._last is None or self._last[0] != key:
            controller = self.gains.controller(logarithms)
            acting = frequency_response(of_observer(controller), self._frequencies, self._ahead)
            errors_of = [errors(beds, acting.at(self._of(beds)), ()) for beds in (self.beds, self.plan.band)]
            self._last = key, DesignPoint(
                controller, acting, loop_curves(self.plan, acting.at(self._of(self.plan.every))),
                closed_poles(self._guards, of_observer(controller)),
                np.sqrt(np.concatenate([each.mean(axis=1) for each in errors_of])) / self.case.unmeasured_tolerance,
            )  # fmt: skip
        return self._last[1]

    def _judged(self, at: DesignPoint) -> Judged:
        squares = np.minimum(at.errors, WORST) ** 2
        rooms = [np.clip(part, -1e2, LARGEST_ROOM) for part in self._rooms(at)]
        least = [rooms[0], *(np.array([part.min(initial=LARGEST_ROOM)]) for part in rooms[1:])]
        return Judged(
            float(squares[:-1].mean() + PLANNED * squares[-1]), np.concatenate(rooms), np.concatenate(least)
        )  # fmt: skip

    def _rooms(self, at: DesignPoint) -> tuple[np.ndarray, ...]:
        """Of the beds' damping, the commands' noise, roll-off, margin."""
        (margin, rolled_off), allowed = self._counted, self.required.command_noise
        noise = command_noise(at.curves, self.plan.every.frequencies)
        return (
            1
            + self._damping_room(at.poles, self._guards)
            - np.array([self.shares.get(number, 1.0) for number in self.guarded]),
            np.ones(len(noise)) if allowed is None else 1 - (1 + RESERVE) * noise / allowed,
            1 - (1 + RESERVE) * at.curves.closed[rolled_off] / LARGEST_ROLLED_OFF,
            at.curves.margin[margin] / (self.required.modulus_margin * (1 + RESERVE)) - 1,
        )

    @property
    def _damping(self) -> float:
        return self.required.damping_ratio * (1 + DAMPING_RESERVE)

    def _damping_room(self, poles: np.ndarray, beds: SampledBeds) -> np.ndarray:
        """What is left (b,) of the damping that beds with poles (b, x) need."""
        ratio = (self._eased(poles, beds) * damping_ratios(poles, self.model.sample_time)).min(axis=1)
        return np.minimum(ratio, self._beyond_stable(poles)) / self._damping - 1

    def _eased(self, poles: np.ndarray, beds: SampledBeds) -> np.ndarray:
        return damping_weights(beds, poles, self.model.sample_time, self._damping, self.required.rolled_off_from)

    def _beyond_stable(self, poles: np.ndarray) -> np.ndarray:
        """As a damping ratio (b,) that is small where a pole that does not swing leaves the unit circle."""
        return 1 - np.abs(poles).max(axis=1) + 2 * self.required.damping_ratio

    def slopes(self, logarithms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of cost (w,) and room (r, w) at a point (w,)."""
        judged = self.judged(logarithms)
        try:
            at, gains = self.point(logarithms), self.gains.slopes(logarithms)
        except InputError:
            return np.zeros(len(self.gains.names)), np.zeros((self._requirements, len(self.gains.names)))
        changes = response_slopes(at.controller, gains, self._frequencies, self._ahead)
        margin, closed, noise = loop_slopes(self.plan, at.curves, changes.at(self._of(self.plan.every)))
        where, allowed = self._counted, self.required.command_noise
        rooms = [
            self._damping_slopes(at, gains) / self._damping,
            np.zeros_like(noise) if allowed is None else -(1 + RESERVE) * noise / allowed,
            -(1 + RESERVE) * closed[:, where[1]] / LARGEST_ROLLED_OFF,
            margin[:, where[0]] / (self.required.modulus_margin * (1 + RESERVE)),
        ]
        steering = (judged.room < LARGEST_ROOM)[:, None]
        return self._cost_slopes(at, changes), np.where(steering, np.concatenate(rooms, axis=1).T, 0.0)

    def _cost_slopes(self, at: DesignPoint, changes: ResponseSlopes) -> np.ndarray:
        share: np.ndarray = np.where(at.errors < WORST, 1.0, 0.0) / self.case.unmeasured_tolerance**2
        share = share * np.r_[np.full(len(share) - 1, 1 / (len(share) - 1)), PLANNED]
        slopes = [
            error_slopes(beds, at.acting.at(self._of(beds)), changes.at(self._of(beds)), part)
            for beds, part in ((self.beds, share[:-1]), (self.plan.band, share[-1:]))
        ]  # fmt: skip
        return slopes[0] + slopes[1]

    def _damping_slopes(self, at: DesignPoint, gains: GainSlopes) -> np.ndarray:
        """Of the least damping ratio (w, b), or of what stands for it where a pole leaves the unit circle."""
        step, beds = at.controller.sample_time, np.arange(len(at.poles))
        factors, size = self._eased(at.poles, self._guards), np.abs(at.poles)
        ratios = factors * damping_ratios(at.poles, step)
        swings = ratios.min(axis=1) <= self._beyond_stable(at.poles)
        chosen = np.where(swings, ratios.argmin(axis=1), size.argmax(axis=1))
        z, factors = at.poles[beds, chosen], factors[beds, chosen]
        close = np.minimum(ratios.min(axis=1), self._beyond_stable(at.poles)) < (1 + LARGEST_ROOM) * self._damping
        slopes = np.zeros((len(self.gains.names), len(beds)))
        if not close.any():
            return slopes
        z, swings, factors = z[close], swings[close], factors[close]
        change = pole_slopes(self._guards.some(beds[close]), at.controller, gains, z)
        s = np.log(z.astype(complex)) / step
        by_s = change / (z * step)
        of_ratio = -by_s.real / np.abs(s) + s.real * (s.conj() * by_s).real / np.abs(s) ** 3
        slopes[:, close] = np.where(swings, factors * of_ratio, -(z.conj() * change).real / np.abs(z))
        return slopes


def tuner(case: Case, drawn: int = 24, pool: int = 160) -> Tuner:
    """Prepare the search over beds from the case's box: spread evenly, the same whenever the case is matched."""
    model = observer_model(case.rig, cut(case.emulated_vehicle, case.rig), case.loop)
    positions = case.uncertainty.spread(max(drawn, pool))
    values = [case.uncertainty.at(position) for position in positions]
    return Tuner(
        case, model, requirements(case), planned(case, model.readings.noise),
        bed_set(case, values[:drawn], np.geomspace(*case.band, BED_POINTS)),
        tuple(bed_of(case, of_bed) for of_bed in values[:pool]), positions[:pool],
        Gains(model, runs_ahead(model), tuple(case.loop.structure.quantities)),
    )  # fmt: skip


# --- Rounds of the search over an observer's weights, each from where the one before ended.

FURTHEST = 1.0  # decades that a round may go
WORTH_A_ROUND = 0.01  # relative gain of a round below which no other follows
WORTH_AT_ALL = 1e-3  # of the squared tolerance: the same where the errors are far below it
SETTLED = 1e-4  # change of the cost at which a round ends; where the cost is above 1, relative to it
POINTS_A_STEP = 4  # that a round may judge for each of its steps: where line searches come to nothing, it ends
KEPT = -2e-3  # of a requirement: what is missed by so little is within its reserve
HOPELESS_MERIT = 50.0  # merit after a round, several requirements missed by all of them: no other round follows


@dataclass(frozen=True)
class TuningEffort:
    """Of the search and of its judgement.

    Attributes
    ----------
    drawn, pool : int
        Beds whose errors are tuned, and beds that are kept damped.
    rounds, steps : int
        At most, and steps of each.
    most_steps : int
        Of all rounds together, as many from every start; added beds get what is left, one round at least.
    scenarios : int
        Times that the least damped beds of the whole box, and of further beds that fill it, are added to the pool, at
        most, each with one more round.
    blind : int
        Settings spread over the whole bounds, where every start of the structure's ends with a requirement missed.
    fresh : int
        Beds that judge the result.
    """

    drawn: int = 24
    pool: int = 160
    rounds: int = 6
    steps: int = 20
    most_steps: int = 200
    scenarios: int = 2
    blind: int = 64
    fresh: int = 200


@dataclass(frozen=True)
class TuningEnd:
    """Where a search ended: logarithms (w,) of the weights, what was judged there, and the steps that led there."""

    logarithms: np.ndarray
    judged: Judged
    steps: int = 0

    @property
    def merit(self) -> float:
        """By which ends are compared."""
        return self.judged.merit

    @property
    def keeps_all(self) -> bool:
        """Whether every requirement is met."""
        return bool(self.judged.least.min() >= KEPT)

    @property
    def misses(self) -> bool:
        """Whether a requirement is missed by more than the reserve by which the search draws it in."""
        *damping, noise, rolled_off, margin = self.judged.least
        return min(damping, default=0.0) < -DAMPING_RESERVE or min(noise, rolled_off, margin) < -RESERVE


def end_at(search: Tuner, logarithms: np.ndarray) -> TuningEnd:
    """A point (w,) judged with the beds of the pool that are least damped there."""
    search.guard(logarithms)
    return TuningEnd(logarithms, search.judged(logarithms))


def judged_again(search: Tuner, end: TuningEnd) -> TuningEnd:
    """The same point by what the search asks now, with the beds that it sees."""
    return replace(end, judged=search.judged(end.logarithms))


def bounds_of(search: Tuner) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper logarithms (w,) of the weights."""
    quantities, names = search.case.loop.structure.quantities, search.gains.names
    low, high = (np.log10([getattr(quantities[name], side) for name in names]) for side in ("lower", "upper"))
    return low, np.minimum(high, [search.highest.get(name, np.inf) for name in names])


def rounds(search: Tuner, begin: TuningEnd, effort: TuningEffort, most_steps: int) -> TuningEnd:
    """Rounds of the search, each from the best point of the one before with the beds that were least damped there."""
    (low, high), best, used = bounds_of(search), begin, 0
    for _ in range(effort.rounds):
        at = best.logarithms
        within = list(zip(np.maximum(low, at - FURTHEST), np.minimum(high, at + FURTHEST), strict=True))
        used += _improve(search, at, within, max(min(effort.steps, most_steps - used), 1))
        end = end_at(search, search.best)
        worth = best.merit - end.merit >= max(WORTH_A_ROUND * best.merit, WORTH_AT_ALL)
        best = min(best, end, key=lambda end: end.merit)
        if not worth or used >= most_steps or (end.merit > HOPELESS_MERIT and end.judged.cost > 1):
            break
    return replace(best, steps=used)


class _TooManyPoints(Exception):
    """Line searches come to nothing."""


def _improve(search: Tuner, begin: np.ndarray, within: list[tuple[float, float]], steps: int) -> int:
    """The steps that were taken; what was judged on the way is known to the search."""
    judged = 0

    def cost(logarithms: np.ndarray) -> float:
        nonlocal judged
        judged += 1
        if judged > POINTS_A_STEP * steps:
            raise _TooManyPoints
        return search.judged(logarithms).cost

    @lru_cache(maxsize=1)  # cost and requirements ask for their slopes one after the other, at the same point
    def slopes(logarithms: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        return search.slopes(np.array(logarithms))

    try:
        result = scipy.optimize.minimize(
            cost, begin, bounds=within, method="SLSQP",
            jac=lambda at: slopes(tuple(at.tolist()))[0],
            constraints={
                "type": "ineq", "fun": lambda at: search.judged(at).room,
                "jac": lambda at: slopes(tuple(at.tolist()))[1],
            },
            options={"maxiter": steps, "ftol": SETTLED * max(1.0, search.judged(search.best).cost)},
        )  # fmt: skip
    except _TooManyPoints:
        return steps
    return int(result.nit)


# --- Beds with opened cut shafts have to be stable: asked for little by little, and first with less dead time.
#
# From weights that know no opened shafts the requirements are far off and their slopes lead nowhere. So what is missed
# is asked for in parts, each round beginning near what it has to keep; and where that comes to a stop, shorter dead
# times, at which opened shafts cost little, lead there (continuation: Allgower and Georg, Numerical Continuation
# Methods, 1990).

DRAWN = 16  # drawn beds, each looked at with all shares of its cut shafts left
PLANNED_PRICE, DRAWN_PRICE = 2.0, 0.25  # relative cost that stable opened beds may add, as planned and drawn
RAISED = {"command_weight": 2.0}  # decades at most: more would damp the emulated modes along with the opened beds
PARTS = 12  # that a requirement is asked for in, at most
PART = 0.5  # of what the worst one misses, that a round leaves
SMALL = 1.0  # of the damping that drawn beds need: what is missed by less is asked for at once
STEPS = 8  # of a round that asks for a part
STUCK = 0.9  # of what the worst one missed before: a round that leaves more is the last one
LAST_ROUNDS, DRAWN_ROUNDS = 4, 2  # that ask for everything, as planned and drawn
DEAD_TIMES = (0.5, 0.6, 0.7, 0.8, 0.9)  # of the case's own, over which the search comes to it


def with_opened(search: Tuner, best: TuningEnd, effort: TuningEffort) -> TuningEnd:
    """The best end with opened cut shafts that are stable, or ``best`` where none is there at the price.

    First the bed as planned has to be stable with every share of its cut shafts, then drawn beds have to be. What is
    kept is seen by the search from then on.
    """
    planned = {left: np.zeros((1, search.positions.shape[1])) for left in SHARES}
    begin = dict(zip(search.gains.names, best.logarithms.tolist(), strict=True))
    search.highest = {name: begin[name] + decades for name, decades in RAISED.items()}
    end = _kept_opened(search, best, effort, planned)
    if end is None:
        search.highest = {}
        return best
    drawn = least_stable_opened(search, end.logarithms)
    return (_kept_of_drawn(search, end, effort, drawn) if drawn else None) or end


def least_stable_opened(search: Tuner, logarithms: np.ndarray) -> dict[float, np.ndarray]:
    """Position (1, p) of the least stable of some beds with opened cut shafts, by the share left, if it is unstable."""
    positions, least = search.case.uncertainty.spread(DRAWN), {}
    for left in SHARES:
        room = search.rooms_of(beds_at(search.case, positions, left), logarithms)
        if room.min() < STABLE_SHARE * damping_left(left) - 1:
            least[left] = positions[[int(room.argmin())]]
    return least


def _kept_opened(
    search: Tuner, best: TuningEnd, effort: TuningEffort, opened: Mapping[float, np.ndarray]
) -> TuningEnd | None:  # fmt: skip
    """The end with opened beds, positions (n, p) by the share left, if they are stable at no more than the price.

    Without an end they are not seen any more.
    """
    if not best.keeps_all:
        return None
    count, most = len(search.positions), min((1 + PLANNED_PRICE) * best.judged.cost, 1.0)
    numbers = _add(search, opened)
    end: TuningEnd | None = _in_parts(search, best.logarithms, effort, numbers, most)
    if not _is_within(end, most):
        search.guarded = numbers
        end = _over_dead_times(search, best.logarithms, effort, opened, most)
    if not _is_within(end, most):
        search.keep_first(count)
        return None
    return end


def _kept_of_drawn(
    search: Tuner, best: TuningEnd, effort: TuningEffort, opened: Mapping[float, np.ndarray]
) -> TuningEnd | None:  # fmt: skip
    """The same of drawn beds, which the best end nearly keeps: at once, and for less."""
    count = len(search.positions)
    _add(search, opened)
    end = _asked_at_once(search, end_at(search, best.logarithms), effort, DRAWN_ROUNDS)
    if not _is_within(end, min((1 + DRAWN_PRICE) * best.judged.cost, 1.0)):
        search.keep_first(count)
        return None
    return end


def _is_within(end: TuningEnd | None, most: float) -> TypeGuard[TuningEnd]:
    return end is not None and end.keeps_all and end.judged.cost <= most


def _add(search: Tuner, opened: Mapping[float, np.ndarray]) -> tuple[int, ...]:
    """The numbers that they have in the pool."""
    count = len(search.positions)
    for left, positions in opened.items():
        search.add(positions, STABLE_SHARE, left)
    return tuple(range(count, len(search.positions)))


def _asked_at_once(search: Tuner, begin: TuningEnd, effort: TuningEffort, most_rounds: int = LAST_ROUNDS) -> TuningEnd:
    return rounds(search, begin, replace(effort, rounds=most_rounds), effort.most_steps // 2)


def _in_parts(
    search: Tuner, begin: np.ndarray, effort: TuningEffort, numbers: tuple[int, ...], most: float
) -> TuningEnd:  # fmt: skip
    """The end from ``begin`` (w,) on, the beds of some numbers asked for in parts.

    It is where the rounds stopped, if they came to a stop or if the cost rose above ``most``.
    """
    beds = search.sampled_pool.some(np.array(numbers))
    asked = np.array([search.shares[number] for number in numbers])
    end, before = end_at(search, begin), np.inf
    for _ in range(PARTS):
        missed = np.maximum(asked - 1 - search.rooms_of(beds, end.logarithms), 0.0)
        worst = float(missed.max())
        stopped = worst > SMALL and (worst > STUCK * before or end.judged.cost > most)
        if stopped or worst <= SMALL:
            break
        search.ask(dict(zip(numbers, asked - np.minimum(missed, PART * worst), strict=True)))
        end = rounds(search, judged_again(search, end), replace(effort, rounds=1), STEPS)
        before = worst
    search.ask(dict(zip(numbers, asked, strict=True)))
    end = judged_again(search, end)
    return end if stopped else _asked_at_once(search, end, effort)


def _over_dead_times(
    search: Tuner, begin: np.ndarray, effort: TuningEffort, opened: Mapping[float, np.ndarray], most: float
) -> TuningEnd | None:
    """The end at the dead time of the case, reached from ``begin`` (w,) over shorter ones; none where one has none."""
    first, *others = DEAD_TIMES
    at = _with_dead_time(search, first, effort)
    begin = rounds(at, end_at(at, begin), effort, effort.steps).logarithms
    end = _in_parts(at, begin, effort, _add(at, opened), most)
    for part in (*others, 1.0):
        if not _is_within(end, most):
            return None
        at = search if part == 1 else _with_dead_time(search, part, effort)
        if at is not search:
            _add(at, opened)
        end = _asked_at_once(at, end_at(at, end.logarithms), effort)
    return end


def _with_dead_time(search: Tuner, part: float, effort: TuningEffort) -> Tuner:
    """The same search where the dead time in the middle of the box is only a part of the case's."""
    case = search.case
    dead_time = part * case.loop["dead_time"]
    loop = case.loop.with_values({"dead_time": dead_time})
    box = case.uncertainty.about({"loop.dead_time": dead_time})
    made = tuner(replace(case, loop=loop, uncertainty=box), effort.drawn, effort.pool)
    made.highest = search.highest
    return made


# --- The least damped beds of a box: from the least damped ones of a pool to the corners that the gradients point to.

STARTING_BEDS = 2  # of the pool's beds, the least damped ones
ROUNDS = 3  # of a descent at most, each with a gradient of its own
DIFFERENCE = 0.02  # of a half-width
BOX_SHARES = (1.0, 0.5)  # of the way to the corner that the gradient points to
WORTH_A_SEARCH = 0.02  # of the requirement: a round that takes away less is the last


def worst_positions(room: Callable[[np.ndarray], np.ndarray], pool: np.ndarray) -> np.ndarray:
    """Positions (n, p) in the box at which least is left of a requirement, by descents from those of a pool (b, p).

    Parameters
    ----------
    room : callable
        What is left (b,) of the requirement at positions (b, p), each coordinate from −1 to 1.
    """
    if not pool.size:
        return pool[:0]
    begins = pool[np.argsort(room(pool))[:STARTING_BEDS]]
    return np.unique([_descended(room, begin) for begin in begins], axis=0)


def _descended(room: Callable[[np.ndarray], np.ndarray], position: np.ndarray) -> np.ndarray:
    """The position (p,) with the least room that was met on the way."""
    value = float(room(position[None])[0])
    for _ in range(ROUNDS):
        inward = np.where(position > 0, -DIFFERENCE, DIFFERENCE)
        corner = -np.sign((room(position + np.diag(inward)) - value) / inward)
        tried = np.array([position + share * (corner - position) for share in BOX_SHARES])
        rooms = room(tried)
        best = int(np.argmin(rooms))
        worth = rooms[best] < value - WORTH_A_SEARCH
        if rooms[best] < value:
            value, position = float(rooms[best]), tried[best]
        if not worth:
            break
    return position


# --- Tune

BEYOND_POOL = 5.4  # times the pool: beds that are looked through once for what the pool has missed
MOST_ADDED = 12  # of those, the least damped ones
STARTS = 2  # that are followed at most
NEARLY_AS_CHEAP = 1.5  # times the cost of the cheapest start, up to which the requirements decide between starts


def tuned_weights(search: Tuner, effort: TuningEffort | None = None) -> tuple[dict[str, float], float]:
    """Weights by name, and their cost: sequential quadratic programming with exact derivatives.

    The cost is the mean square of the drawn beds' response errors to unmeasured torques, over the tolerance. The search
    begins at the better one of the case's weights and the structure's further starts, and at the next one where it ends
    with a requirement missed; where all do by more than the reserve, at the best of settings drawn over the bounds.
    Then beds with opened cut shafts have to be stable as well, see :mod:`matching.match.tune_observer`, where that
    keeps all else.
    """
    effort = effort or TuningEffort()
    best, used = _from_starts(search, effort)
    if effort.scenarios and best.judged.cost <= 1:  # beyond their tolerance the errors limit the match anyway
        best = with_opened(search, best, effort)
    for _ in range(effort.scenarios):
        if not add_scenarios(search, end_at(search, best.logarithms), effort):
            break
        best, used = _further_round(search, best, effort, used)
    return dict(zip(search.gains.names, (10.0**best.logarithms).tolist(), strict=True)), best.judged.cost


def _from_starts(search: Tuner, effort: TuningEffort) -> tuple[TuningEnd, int]:
    """The best end, and the steps of all."""
    begins, ends = _ranked([_anew(search, start) for start in _starts(search)]), []
    search.guarded = ()
    for begin in begins[:STARTS]:
        ends.append(rounds(search, end_at(search, begin.logarithms), effort, effort.most_steps // 4))
        if ends[-1].keeps_all:
            break
    if effort.blind and all(end.misses for end in ends):
        ends.append(rounds(search, _blind(search, effort.blind), effort, effort.most_steps // 4))
    return min(ends, key=lambda end: end.merit), sum(end.steps for end in ends)


def _starts(search: Tuner) -> list[np.ndarray]:
    loop, names = search.case.loop, search.gains.names
    return [np.log10([values[name] for name in names]) for values in (loop.values, *loop.structure.further_starts)]


def _anew(search: Tuner, logarithms: np.ndarray) -> TuningEnd:
    """A start judged with the beds alone that are least damped there."""
    search.guarded = ()
    return end_at(search, logarithms)


def _ranked(begins: list[TuningEnd]) -> list[TuningEnd]:
    """First those nearly as cheap as the cheapest one, then the others, each by what they miss."""
    cheap = NEARLY_AS_CHEAP * min(begin.judged.cost for begin in begins)
    return sorted(begins, key=lambda begin: (begin.judged.cost > cheap, begin.merit))


def add_scenarios(search: Tuner, at: TuningEnd, effort: TuningEffort) -> bool:
    """Whether beds miss their damping there that the search did not see; it sees the least damped from now on.

    Looked at are the worst beds of the box and further beds that fill it.
    """
    logarithms, box = at.logarithms, search.case.uncertainty
    try:
        worst = worst_positions(
            lambda positions: search.rooms_of(beds_at(search.case, positions), logarithms),
            search.positions[list(search.guarded)],
        )
        unstable = worst[search.rooms_of(beds_at(search.case, worst), logarithms) < STABLE_SHARE - 1]
        count = 0 if at.misses else round(BEYOND_POOL * effort.pool)  # what beds miss anyway, more beds do not cure
        further = box.spread(effort.pool + count)[effort.pool :]
        room = search.rooms_of(beds_at(search.case, further), logarithms) if count else np.zeros(0)
    except InputError:
        return False
    missed = further[np.argsort(room)[: min(MOST_ADDED, int((room < -DAMPING_RESERVE / 2).sum()))]]
    for positions, share in ((unstable, STABLE_SHARE), (missed, 1.0)):
        if len(positions):
            search.add(positions, share)
    return bool(len(unstable) or len(missed))


def _further_round(search: Tuner, best: TuningEnd, effort: TuningEffort, used: int) -> tuple[TuningEnd, int]:
    """One more round with beds that were added, and the steps that all rounds took."""
    left = max(effort.most_steps - used, effort.steps)
    end = rounds(search, end_at(search, best.logarithms), replace(effort, rounds=1), left)
    return end, used + end.steps


def _blind(search: Tuner, count: int) -> TuningEnd:
    """The best of settings spread over all bounds."""
    low, high = bounds_of(search)
    spread = low + (high - low) * scipy.stats.qmc.Sobol(len(low), seed=0).random(count)
    return end_at(search, min(spread, key=lambda logarithms: search.judged(logarithms).merit))
