"""What beds and loop of a match do not keep: sentences that limit it, and sentences that are only noted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy

from matching.match.beds import (
    BED_POINTS,
    BedsCheck,
    Judged,
    Planned,
    check_beds,
    command_noise,
    counted,
    loop_curves,
    planned,
    sensor_noise,
)
from matching.match.case import LARGEST_ROLLED_OFF, Case, Move, Requirements, apply, requirements, scaled, unscaled
from matching.match.loop import (
    BedSet,
    FrequencyResponse,
    LinearBed,
    SampledBeds,
    SampledController,
    bed_set,
    closed_poles,
    controller_on,
    damping_ratios,
    errors,
    frequency_response,
    linear_bed,
    sampled_beds,
)
from matching.match.loop_modes import neutral_motions
from matching.match.tune_observer import DAMPING_RESERVE, LARGEST_ROOM, RESERVE, WORST
from matching.match.verify import FRESH, Verification, verify
from modelling.bed.bed import HARDWARE
from modelling.bed.vehicle import FeedForward, cut
from modelling.errors import InputError
from modelling.system import System

# --- A tuned case on fresh beds.


def on_drawn_beds(case: Case, checked: Verification, count: int, seed: int = 0) -> Verification:
    """The verification of a tuned case with fresh beds: ``count`` of them from a ``seed``."""
    bed = linear_bed(case)
    beds = check_beds(case, controller_on(bed), neutral_motions(bed), checked.required, count, seed + FRESH)
    return replace(checked, beds=beds)


# --- A feedback law tuned over drawn beds: their errors, with what every bed and the loop have to keep.
#
# The gains move alone; residual vehicle and adapters stay as they are. A loop that contains the emulated vehicle has a
# large sensitivity inside its band, whatever the controller, so the margin counts above it, see :class:`.Requirements`.

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
    parts: LinearBed
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
        order = np.argsort(self._damping_room(self.pool, self.controller(at), np.arange(len(self.pool.A))))
        self.guarded = np.unique(np.concatenate([[0], self.guarded, order[:GUARDS]]))
        self.known.clear()

    def controller(self, at: np.ndarray) -> SampledController:
        """The controller at a point (m,)."""
        return controller_on(replace(self.parts, case=apply(self.case, self.values(at))), self.feed_forward)

    @cached_property
    def _frequencies(self) -> np.ndarray:
        return np.concatenate([self.plan.every.frequencies, self.plan.band.frequencies, self.beds.frequencies])

    def _judged(self, at: np.ndarray) -> Judged:
        controller = self.controller(at)
        acting = frequency_response(controller, self._frequencies)
        ends = np.cumsum([len(each.frequencies) for each in (self.plan.every, self.plan.band, self.beds)])
        curves = loop_curves(self.plan, acting.at(slice(0, int(ends[0]))))
        of_plan = self._squares(self.plan.band, acting.at(slice(int(ends[0]), int(ends[1]))))
        of_beds = self._squares(self.beds, acting.at(slice(int(ends[1]), int(ends[2]))))
        margin, rolled_off = counted(self.plan, self.required)
        allowed, noise = self.required.command_noise, command_noise(curves, self.plan.every.frequencies)
        rooms = [
            self._damping_room(self.pool, controller, self.guarded),
            np.ones(len(noise)) if allowed is None else 1 - (1 + RESERVE) * noise / allowed,
            1 - (1 + RESERVE) * curves.closed[rolled_off] / LARGEST_ROLLED_OFF,
            curves.margin[margin] / (self.required.modulus_margin * (1 + RESERVE)) - 1,
        ]
        rooms = [np.clip(part, -1e2, LARGEST_ROOM) for part in rooms]
        least = [rooms[0], *(np.array([part.min(initial=LARGEST_ROOM)]) for part in rooms[1:])]
        return Judged(float(of_plan.mean() + of_beds.mean()), np.concatenate(rooms), np.concatenate(least))

    def _squares(self, beds: BedSet, acting: FrequencyResponse) -> np.ndarray:
        """Squares (b,) of the errors to unmeasured and to measured torques, each over its tolerance."""
        total = np.zeros(len(beds.sampled.A))
        measured = [name for name in self.case.loop.measured if name in acting.known]
        for known, tolerance in (((), self.case.unmeasured_tolerance), (measured, self.case.tolerance)):
            total += np.minimum(errors(beds, acting, known).mean(axis=1) / tolerance**2, WORST)
        return total

    def _damping_room(self, beds: SampledBeds, controller: SampledController, which: np.ndarray) -> np.ndarray:
        """What is left (b,) of the damping that beds of these numbers need."""
        poles = closed_poles(beds.some(which), controller)
        needed = self.required.damping_ratio * (1 + DAMPING_RESERVE)
        wanted = np.where(which == 0, max(needed, self.case.limits.get("damping_ratio", 0.0) * (1 + RESERVE)), needed)
        moving = np.where(np.abs(poles - 1) < AT_REST, 0.0, poles)
        least = damping_ratios(moving, self.case.loop["sample_time"]).min(axis=1)
        beyond = 1 - np.abs(moving).max(axis=1) + 2 * self.required.damping_ratio
        room: np.ndarray = np.minimum(least, beyond) / wanted - 1
        return room


@dataclass(frozen=True)
class DrawnBeds:
    """Beds that a feedback law is tuned on: those with errors, and the pool of those that stay damped."""

    beds: BedSet
    pool: SampledBeds


def drawn_beds(case: Case) -> DrawnBeds:
    """Beds from the box of a case, as they are without a controller: neither gains nor residual vehicle change them."""
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
    """
    parts, noise = linear_bed(case), sensor_noise(case, case.loop.controller_sensors)
    return FeedbackTuner(
        case, tuple(moves), parts,
        case.loop.structure.feed_forward(case.rig, cut(case.emulated_vehicle, case.rig), case.loop),
        requirements(case), planned(case, noise), drawn.beds, drawn.pool,
    )  # fmt: skip


def tuned_over_beds(case: Case, moves: Sequence[Move], drawn: DrawnBeds) -> tuple[Mapping[str, float], Judged]:
    """Values of the loop's quantities from those of a case on, SI, and how they are judged on drawn beds."""
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


# --- The gains of a feedback law tuned over drawn beds, and the end judged on fresh ones.

MIDDLE = 0.6  # of every gain's scaled range: one of the points from which is searched


@dataclass(frozen=True)
class TunedOverBeds:
    """A case whose gains were tuned over beds.

    ``values`` are those of the moves by name, SI, ``as_cut`` whether the residual vehicle is as cut from the vehicle.
    """

    tuned: Case
    values: Mapping[str, float]
    as_cut: bool
    robust: Verification

    def sentence(self) -> str:
        """For the notes of a match."""
        kept = "the residual vehicle stays as it is cut from the vehicle" if self.as_cut else "the rest stays as found"
        return (
            f"the gains were tuned over drawn beds, with the modulus margin counted from "
            f"{self.robust.required.margin_from:.3g} Hz on, above the emulated modes; {kept}; "
            "what to order, its errors and the objective are those of the gains before that"
        )


def over_beds(
    tuned: Case, untuned: System, moves: Sequence[Move], count: int, seed: int
) -> TunedOverBeds | None:  # fmt: skip
    """Tune the gains over beds, from those of a case and from the middle, and judge the end on fresh beds.

    Parameters
    ----------
    tuned : Case
        As the programme left it; its adapters stay.
    untuned : System
        The rig before it was tuned.
    moves : sequence of Move
        What may move; without a gain among them there is no answer.
    count, seed : int
        Of the fresh beds.
    """
    gains = [move for move in moves if move.name.startswith("loop.")]
    residual = [move for move in moves if move.name.startswith("residual_vehicle.")]
    if not gains or tuned.loop.torqueless:
        return None
    planned = {name: move.planned for move in residual for name in move.together}
    middle = {move.name: _middle(move) for move in gains}
    begins = [({}, not residual), (planned, True), ({**planned, **middle}, True)]
    known: dict[tuple[float, ...], DrawnBeds] = {}
    ends = []
    for values, as_cut in begins:
        case = apply(tuned, values)
        hardware = tuple(case.loop[name] for name in HARDWARE)  # beside the rig all that the beds depend on
        try:
            if hardware not in known:
                known[hardware] = drawn_beds(case)
            of_gains, judged = tuned_over_beds(case, gains, known[hardware])
        except InputError:
            continue
        ends.append((judged.merit, {**values, **of_gains}, as_cut))
    if not ends:
        return None
    _, values, as_cut = min(ends, key=lambda end: end[0])
    case = apply(tuned, values)
    return TunedOverBeds(case, values, as_cut, verify(case, untuned, beds=count, seed=seed))


def _middle(move: Move) -> float:
    """Evenly in the logarithm where the bounds have one."""
    if move.lower > 0:
        return float(move.lower * (move.upper / move.lower) ** MIDDLE)
    return move.lower + MIDDLE * (move.upper - move.lower)


# --- Robust limits


def of_beds(robust: Verification) -> BedsCheck:
    """The fresh beds of a verification that has them."""
    assert robust.beds is not None, "beds were drawn"
    return robust.beds


def not_kept(case: Case, robust: Verification) -> list[str]:
    """Sentences on what makes a match limited.

    An observer has to keep everything. A feedback law has to be stable and damped on every drawn bed and to keep the
    error to measured torques; the rest is only :func:`noted`.
    """
    sentences = [
        *_unstable(robust),
        *_error("measured torques", robust.errors.after, case.tolerance),
    ]
    sentences += _damped_too_little(robust)
    if case.loop.structure.is_observer:
        sentences += [*_unstable_worst_bed(robust), *_loop(case, robust)]
    return sentences


def noted(case: Case, robust: Verification) -> list[str]:
    """Sentences on what does not limit a match: a worst bed that is damped too little, the loop of a feedback law."""
    sentences, worst, required = [], of_beds(robust).worst, robust.required.damping_ratio
    if not case.loop.structure.is_observer:
        sentences += [*_unstable_worst_bed(robust), *_loop(case, robust)]
    if worst is not None and 0 < worst.damping_ratio < required:
        sentences.append(
            f"the worst bed within [uncertainty] is stable; its least damping ratio is {worst.damping_ratio:.4f}, "
            f"{worst.damping_ratio / required:.0%} of the {required:.4f} that drawn beds need; it depends most on "
            f"{', '.join(worst.named)}"
        )
    if case.loop.structure.is_observer:
        sentences += _opened(robust)
    return sentences


def _unstable(robust: Verification) -> list[str]:
    beds = of_beds(robust)
    if beds.stable == beds.drawn:
        return []
    return [f"{beds.drawn - beds.stable} of {beds.drawn} beds drawn within [uncertainty] are not stable"]


def _damped_too_little(robust: Verification) -> list[str]:
    beds = of_beds(robust)
    if beds.stable < beds.drawn or beds.damped == beds.drawn:
        return []
    return [
        f"{beds.drawn - beds.damped} of {beds.drawn} beds drawn within [uncertainty] have a mode damped by less "
        f"than {robust.required.damping_ratio:.4f}, a third of the least damping of the target modes; the least is "
        f"{beds.smallest_damping_ratio:.4f}"
    ]


def _unstable_worst_bed(robust: Verification) -> list[str]:
    worst = of_beds(robust).worst
    if worst is None or worst.damping_ratio > 0:
        return []
    return [
        f"the worst bed within [uncertainty] is not stable (damping ratio {worst.damping_ratio:.4f}); it depends most "
        f"on {', '.join(worst.named)}"
    ]


def _opened(robust: Verification) -> list[str]:
    beds = of_beds(robust)
    sentences = _unstable_opened(beds.opened, "its cut shafts")
    if len(beds.opened_alone) > 1:
        for shaft, opened in beds.opened_alone.items():
            sentences += _unstable_opened(opened, f"the cut shaft {shaft} alone")
    return sentences


def _unstable_opened(opened: Mapping[float, float], shafts: str) -> list[str]:
    unstable = [f"{share:.3g}" for share, ratio in opened.items() if ratio <= 0]
    if not unstable:
        return []
    return [
        f"the bed as planned is not stable with {', '.join(unstable)} times the stiffness and damping of {shafts}, as "
        "a lash that opens there lets it appear: it may swing on there"
    ]


def _error(what: str, value: float | None, allowed: float) -> list[str]:
    if value is None or value <= allowed:
        return []
    return [f"the response error to {what} is {value:.3f}, {allowed:g} is allowed"]


def _loop(case: Case, robust: Verification) -> list[str]:
    """Unmeasured torques, roll-off and noise."""
    loop, required = robust.loop, robust.required
    sentences = _error("unmeasured torques", robust.errors.unmeasured, case.unmeasured_tolerance)
    if loop.largest_rolled_off > LARGEST_ROLLED_OFF:
        sentences.append(
            f"the loop has not rolled off at {required.rolled_off_from:g} Hz: |T| is {loop.largest_rolled_off:.2f} "
            f"there, {LARGEST_ROLLED_OFF:g} is allowed"
        )
    noise = max(loop.command_noise.values())
    if required.command_noise is not None and noise > required.command_noise:
        sentences.append(
            f"sensor noise makes {noise:.1f} N·m rms of command, {required.command_noise:g} N·m is allowed"
        )
    return sentences
