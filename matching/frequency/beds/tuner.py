"""What the search over an observer's weights asks at a point: cost and requirements, and their first derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from matching.frequency.beds.bed import Bed, bed_of
from matching.frequency.beds.closed_loop import (
    BedSet,
    SampledBeds,
    action,
    ahead_states,
    bed_set,
    damping_ratios,
    eased,
    errors,
    shared_poles,
    side_by_side,
)
from matching.frequency.beds.design_point import DesignPoint, Judged
from matching.frequency.beds.figures import BED_POINTS, Planned, command_noise, counted, loop_curves, planned
from matching.frequency.beds.gains import Gains
from matching.frequency.beds.requirements import LARGEST_ROLLED_OFF, Requirements, requirements
from matching.frequency.beds.slopes import (
    ActionSlopes,
    GainSlopes,
    action_slopes,
    error_slopes,
    loop_slopes,
    pole_slopes,
)
from matching.frequency.beds.softened import damping_left, softened
from matching.frequency.case.case import Case
from modelling.bed.observer.design import runs_ahead
from modelling.bed.observer.model import ObserverModel, observer_model
from modelling.bed.residual_vehicle import cut
from modelling.common.errors import InputError

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
        """What is left (b,) of the damping that each bed needs at a point (w,), as a share of it.

        Raises
        ------
        InputError
            If the design has no solution there.
        """
        poles = shared_poles(beds, self.gains.controller(logarithms), self.model.on_their_way)
        return self._damping_room(poles, beds)

    def add(self, positions: np.ndarray, share: float = 1.0, left: float = 1.0) -> None:
        """Have the search keep beds at positions (b, p) of the box damped by a share of what drawn beds need.

        Of stiffness and damping of their cut shafts ``left`` is left; where they open, the share falls with it.
        """
        count, box = len(self.positions), self.case.uncertainty
        self.positions = np.vstack([self.positions, positions])
        values = [softened(self.case, box.at(position), left) for position in positions]
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
        return ahead_states(self.gains.controller(start), self._frequencies)

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
        """Work a point (w,) out.

        Raises
        ------
        InputError
            If the design has no solution there.
        """
        key = tuple(logarithms.tolist())
        if self._last is None or self._last[0] != key:
            controller = self.gains.controller(logarithms)
            acting = action(controller, self._frequencies, self._ahead)
            errors_of = [errors(beds, acting.at(self._of(beds)), ()) for beds in (self.beds, self.plan.band)]
            self._last = key, DesignPoint(
                controller, acting, loop_curves(self.plan, acting.at(self._of(self.plan.every))),
                shared_poles(self._guards, controller, self.model.on_their_way),
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
        return eased(beds, poles, self.model.sample_time, self._damping, self.required.rolled_off_from)

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
        changes = action_slopes(at.controller, gains, self._frequencies, self._ahead)
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

    def _cost_slopes(self, at: DesignPoint, changes: ActionSlopes) -> np.ndarray:
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
