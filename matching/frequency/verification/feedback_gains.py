"""A feedback law tuned over drawn beds: their errors, with what every bed and the loop have to keep.

The gains move alone; residual vehicle and adapters stay as they are. A loop that contains the emulated vehicle has a
large sensitivity inside its band, whatever the controller, so the margin counts above it, see :class:`.Requirements`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy

from matching.frequency.beds.closed_loop import (
    Action,
    BedSet,
    SampledBeds,
    bed_set,
    damping_ratios,
    errors,
    sampled_beds,
)
from matching.frequency.beds.design_point import Judged
from matching.frequency.beds.figures import BED_POINTS, Planned, command_noise, counted, loop_curves, planned
from matching.frequency.beds.requirements import LARGEST_ROLLED_OFF, Requirements, requirements
from matching.frequency.beds.resolvent import resolvent
from matching.frequency.beds.tuner import DAMPING_RESERVE, LARGEST_ROOM, RESERVE, WORST
from matching.frequency.case.case import Case, Move
from matching.frequency.case.tuned import apply
from matching.frequency.loop.parts import Parts, parts_of
from matching.frequency.programme.scaling import scaled, unscaled
from modelling.bed.feed_forward import FeedForward
from modelling.bed.observer.model import NOISE
from modelling.bed.residual_vehicle import cut
from modelling.common.errors import InputError
from modelling.controller.law import law_of_feed_forward
from modelling.linear.state_space import StateSpace

DRAWN, POOL, GUARDS = 16, 512, 16  # beds whose errors are tuned; beds that stay damped; of those, seen at a time
ROUNDS, STEPS = 3, 20
WORTH_A_ROUND = 0.01  # relative gain of a round below which no other follows
DIFFERENCE = 1e-4  # of a range
PRICE = 30.0  # of a requirement that is missed by all of it
AT_REST = 1e-7  # of poles at 1: motions that nothing slows


@dataclass
class FeedbackTuner:
    """Cost of the gains of a feedback law on a set of beds, and what is left of the requirements.

    Attributes
    ----------
    moves : tuple of Move (m)
        Those of the loop; points of the search are their scaled parts (m,), 0 … 1.
    pool : SampledBeds
        The bed as planned, then those that have to stay damped, of which the search sees ``guarded``.
    feed_forward : FeedForward or None
        Does not depend on the gains.
    """

    case: Case
    moves: tuple[Move, ...]
    parts: Parts
    feed_forward: FeedForward | None
    required: Requirements
    plan: Planned
    beds: BedSet
    pool: SampledBeds
    guarded: np.ndarray = field(default_factory=lambda: np.zeros(1, int))
    known: dict[tuple[float, ...], Judged] = field(default_factory=dict)

    def values(self, at: np.ndarray) -> dict[str, float]:
        """Values of the loop's quantities, SI, at a point (m,)."""
        return {move.name: float(unscaled(part, move)) for move, part in zip(self.moves, at, strict=True)}

    def judged(self, at: np.ndarray) -> Judged:
        """Cost and requirements at a point (m,); results are kept until other beds are guarded."""
        key = tuple(at.tolist())
        if key not in self.known:
            self.known[key] = self._judged(at)
        return self.known[key]

    def guard(self, at: np.ndarray) -> None:
        """Have the search see the least damped beds of the pool at a point (m,) as well, the planned one always."""
        order = np.argsort(self._damping_room(self.pool, self._feedback(at), np.arange(len(self.pool.A))))
        self.guarded = np.unique(np.concatenate([[0], self.guarded, order[:GUARDS]]))
        self.known.clear()

    def _feedback(self, at: np.ndarray) -> StateSpace:
        """From readings, signs as the rig has them, and what acts inside the residual vehicle, to commands."""
        tuned = replace(self.parts, case=apply(self.case, self.values(at)))
        return tuned.sampled_controller

    @cached_property
    def _signs(self) -> np.ndarray:
        return np.concatenate([self.parts.toward, np.ones(len(self.parts.toward))])

    @cached_property
    def _frequencies(self) -> np.ndarray:
        return np.concatenate([self.plan.every.frequencies, self.plan.band.frequencies, self.beds.frequencies])

    def _action(self, feedback: StateSpace) -> Action:
        """The law at all frequencies."""
        z, y = np.exp(2j * np.pi * self._frequencies * self.case.loop["sample_time"]), len(self._signs)
        if self.feed_forward is None:
            answers = feedback.C @ resolvent(feedback.A).columns(z, feedback.B) + feedback.D
            return Action(answers[:, :, :y] * self._signs, answers[:, :, y:], self.parts.simulated)
        law = law_of_feed_forward(self.feed_forward, feedback, self._signs, ("",) * y)
        B, D = np.hstack([law.By + law.Bs @ law.Dy, law.Bw + law.Bs @ law.Dw]), np.hstack([law.Dy, law.Dw])
        answers = law.K @ resolvent(law.A + law.Bs @ law.K).columns(z, B) + D
        return Action(answers[:, :, :y], answers[:, :, y:], law.known)

    def _judged(self, at: np.ndarray) -> Judged:
        feedback = self._feedback(at)
        acting = self._action(feedback)
        ends = np.cumsum([len(each.frequencies) for each in (self.plan.every, self.plan.band, self.beds)])
        curves = loop_curves(self.plan, acting.at(slice(0, int(ends[0]))))
        of_plan = self._squares(self.plan.band, acting.at(slice(int(ends[0]), int(ends[1]))))
        of_beds = self._squares(self.beds, acting.at(slice(int(ends[1]), int(ends[2]))))
        margin, rolled_off = counted(self.plan, self.required)
        allowed, noise = self.required.command_noise, command_noise(curves, self.plan.every.frequencies)
        rooms = [
            self._damping_room(self.pool, feedback, self.guarded),
            np.ones(len(noise)) if allowed is None else 1 - (1 + RESERVE) * noise / allowed,
            1 - (1 + RESERVE) * curves.closed[rolled_off] / LARGEST_ROLLED_OFF,
            curves.margin[margin] / (self.required.modulus_margin * (1 + RESERVE)) - 1,
        ]
        rooms = [np.clip(part, -1e2, LARGEST_ROOM) for part in rooms]
        least = [rooms[0], *(np.array([part.min(initial=LARGEST_ROOM)]) for part in rooms[1:])]
        return Judged(float(of_plan.mean() + of_beds.mean()), np.concatenate(rooms), np.concatenate(least))

    def _squares(self, beds: BedSet, acting: Action) -> np.ndarray:
        """Squares (b,) of the errors to unmeasured and to measured torques, each over its tolerance."""
        total = np.zeros(len(beds.sampled.A))
        measured = [name for name in self.case.loop.measured if name in acting.known]
        for known, tolerance in (((), self.case.unmeasured_tolerance), (measured, self.case.tolerance)):
            total += np.minimum(errors(beds, acting, known).mean(axis=1) / tolerance**2, WORST)
        return total

    def _damping_room(self, beds: SampledBeds, feedback: StateSpace, which: np.ndarray) -> np.ndarray:
        """What is left (b,) of the damping that beds of these numbers need."""
        poles = np.linalg.eigvals(_closed(beds.some(which), feedback, self._signs))
        needed = self.required.damping_ratio * (1 + DAMPING_RESERVE)
        wanted = np.where(which == 0, max(needed, self.case.limits.get("damping_ratio", 0.0) * (1 + RESERVE)), needed)
        moving = np.where(np.abs(poles - 1) < AT_REST, 0.0, poles)
        least = damping_ratios(moving, self.case.loop["sample_time"]).min(axis=1)
        beyond = 1 - np.abs(moving).max(axis=1) + 2 * self.required.damping_ratio
        room: np.ndarray = np.minimum(least, beyond) / wanted - 1
        return room


def _closed(beds: SampledBeds, feedback: StateSpace, signs: np.ndarray) -> np.ndarray:
    """State matrices (b, x + c, x + c) of the closed loops; known torques stay outside."""
    y = len(signs)
    By, Dy = feedback.B[:, :y] * signs, feedback.D[:, :y] * signs
    top = np.concatenate([beds.A + beds.B @ Dy @ beds.C, beds.B @ feedback.C], axis=2)
    below = np.concatenate([By @ beds.C, np.broadcast_to(feedback.A, (len(beds.A), *feedback.A.shape))], axis=2)
    return np.concatenate([top, below], axis=1)


@dataclass(frozen=True)
class DrawnBeds:
    """Beds that a feedback law is tuned on: those with errors, and the pool of those that stay damped."""

    beds: BedSet
    pool: SampledBeds


def drawn_beds(case: Case) -> DrawnBeds:
    """Beds from the box of a case, as they are without a controller: neither gains nor residual vehicle change them.

    Raises
    ------
    InputError
        If a model cannot be made linear.
    """
    positions = case.uncertainty.spread(max(DRAWN, POOL))
    values = [case.uncertainty.at(position) for position in positions]
    of_errors = bed_set(case, values[:DRAWN], np.geomspace(*case.band, BED_POINTS))
    return DrawnBeds(of_errors, sampled_beds(case, [{}, *values[:POOL]]))


def feedback_tuner(case: Case, moves: Sequence[Move], drawn: DrawnBeds) -> FeedbackTuner:
    """Prepare the search for the gains of a case whose residual vehicle and adapters stay.

    Parameters
    ----------
    drawn : DrawnBeds
        Those of the case, or of one with other gains or another residual vehicle.

    Raises
    ------
    InputError
        If a model cannot be made linear or the feed-forward has no solution.
    """
    parts, by_name = parts_of(case), {sensor.name: sensor for sensor in case.rig.sensors}
    sensors = [by_name[name] for name in case.loop.controller_sensors]
    noise = np.array([sensor.uncertainty or NOISE[sensor.measures] for sensor in sensors])
    return FeedbackTuner(
        case, tuple(moves), parts,
        case.loop.structure.feed_forward(case.rig, cut(case.emulated_vehicle, case.rig), case.loop),
        requirements(case), planned(case, noise), drawn.beds, drawn.pool,
    )  # fmt: skip


def tuned_over_beds(case: Case, moves: Sequence[Move], drawn: DrawnBeds) -> tuple[Mapping[str, float], Judged]:
    """Values of the loop's quantities from those of a case on, SI, and how they are judged on drawn beds.

    Raises
    ------
    InputError
        As :func:`feedback_tuner`.
    """
    search = feedback_tuner(case, moves, drawn)
    best = np.array([np.clip(scaled(case.loop[move.name.removeprefix("loop.")], move), 0, 1) for move in moves])
    last = np.inf
    for _ in range(ROUNDS):
        search.guard(best)
        _improve(search, best)
        best = np.array(min(search.known, key=lambda key: search.known[key].merit))
        merit = search.judged(best).merit
        if merit > (1 - WORTH_A_ROUND) * last and search.judged(best).least.min() >= -RESERVE:
            break
        last = merit
    search.guard(best)
    return search.values(best), search.judged(best)


def _improve(search: FeedbackTuner, begin: np.ndarray) -> None:
    """Sequential quadratic programming with differences; what was judged on the way is known to the search."""

    def difference(at: np.ndarray, what: str) -> np.ndarray:
        here, steps = getattr(search.judged(at), what), np.where(at > 0.5, -DIFFERENCE, DIFFERENCE)
        there = [getattr(search.judged(at + step), what) for step in np.diag(steps)]
        return np.array([(each - here) / step for each, step in zip(there, steps, strict=True)]).T

    # what a start misses is allowed at a price, beds' damping apart from the rest: no gain may do anything for it
    of_damping = np.arange(len(search.judged(begin).room)) < len(search.guarded)
    slacks = np.stack([of_damping, ~of_damping], axis=1).astype(float)
    missed = [max(0.0, -float(search.judged(begin).room[part].min())) for part in (of_damping, ~of_damping)]
    try:
        scipy.optimize.minimize(
            lambda at: search.judged(at[:-2]).cost + PRICE * at[-2:].sum(), np.append(begin, missed), method="SLSQP",
            jac=lambda at: np.append(difference(at[:-2], "cost"), [PRICE, PRICE]),
            bounds=[*[(0.0, 1.0)] * len(begin), (0.0, None), (0.0, None)],
            constraints={
                "type": "ineq", "fun": lambda at: search.judged(at[:-2]).room + slacks @ at[-2:],
                "jac": lambda at: np.hstack([difference(at[:-2], "room"), slacks]),
            },
            options={"maxiter": STEPS, "ftol": 1e-4},
        )  # fmt: skip
    except InputError:
        return
