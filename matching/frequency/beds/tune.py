"""Tuning of an observer's weights over drawn beds: the beds' mean square error, with what every one has to keep."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import scipy

from matching.frequency.beds.closed_loop import BedSet, ahead_states, bed_set
from matching.frequency.beds.figures import BED_POINTS, Planned, bed_figures, loop_figures, planned
from matching.frequency.beds.requirements import LARGEST_ROLLED_OFF, Requirements, requirements
from matching.frequency.case.case import Case
from modelling.bed.observer_design import Ahead, assembled, correction, runs_ahead, state_feedback
from modelling.bed.observer_model import ObserverModel, observer_model
from modelling.bed.residual_vehicle import cut
from modelling.bed.sampled_controller import SampledController
from modelling.common.errors import InputError

RESERVE = 0.03  # relative, by which requirements are drawn in: figures of the search are a little coarse
DAMPING_RESERVE = 0.1  # the same for the least damping, whose tail over beds is long
PLANNED = 0.1  # weight of the bed as planned beside the mean of the drawn ones
MERIT = 10.0  # cost of a requirement missed by all of it, where ends are compared
STEP = 0.02  # decades, of finite differences
FURTHEST = 0.3  # decades that a round may go: linear constraints are no good guide beyond
WORTH_A_ROUND = 0.02  # relative gain of a round below which no other follows
SETTLED = 1e-3  # change of the cost at which the search ends
WORST = 1e3  # cost of a design that has no solution
REGULATOR = ("command_weight", "command_change_weight")


@dataclass(frozen=True)
class TuningEffort:
    """Beds that the weights are tuned over, rounds and steps of each at most, and fresh beds that judge the result."""

    drawn: int = 24
    rounds: int = 6
    steps: int = 5
    fresh: int = 200


@dataclass
class Tuner:
    """Cost of an observer's weights on a set of beds, and what is left of the requirements.

    Attributes
    ----------
    names : tuple of str
        Of the weights, in the order of the search's variables (w,), which are their decimal logarithms.
    """

    case: Case
    model: ObserverModel
    required: Requirements
    plan: Planned
    beds: BedSet
    names: tuple[str, ...]
    ahead: Ahead
    _feedback: dict[tuple[float, ...], np.ndarray] = field(default_factory=dict)
    _corrected: dict[tuple[float, ...], np.ndarray] = field(default_factory=dict)
    known: dict[tuple[float, ...], Judged] = field(default_factory=dict)
    _states_ahead: dict[int, np.ndarray] = field(default_factory=dict)

    def controller(self, logarithms: np.ndarray) -> SampledController:
        """The controller at a point of the search, decimal logarithms (w,) of the weights; recent gains are kept."""
        weights = dict(zip(self.names, 10.0**logarithms, strict=True))
        of_regulator = tuple(weights[name] for name in REGULATOR)
        of_filter = tuple(weight for name, weight in weights.items() if name not in REGULATOR)
        F = _kept(self._feedback, of_regulator, lambda: state_feedback(self.model, *of_regulator))
        L = _kept(self._corrected, of_filter, lambda: correction(self.model, weights))
        return assembled(self.model, self.ahead, F, L)

    def _ahead(self, controller: SampledController, beds: BedSet) -> np.ndarray:
        """States of the model that runs ahead at the frequencies of a set of beds; the weights do not reach it."""
        if id(beds) not in self._states_ahead:
            self._states_ahead[id(beds)] = ahead_states(controller, beds.frequencies)
        return self._states_ahead[id(beds)]

    def judged(self, logarithms: np.ndarray) -> Judged:
        """Cost and requirements at a point of the search, decimal logarithms (w,) of the weights; results are kept."""
        key = tuple(logarithms.tolist())
        if key not in self.known:
            self.known[key] = self._judged(logarithms)
        return self.known[key]

    @property
    def best(self) -> Judged:
        """The best point that was judged."""
        return min(self.known.values(), key=lambda one: one.merit)

    def _judged(self, logarithms: np.ndarray) -> Judged:
        required, count = self.required, len(self.beds.A)
        try:
            controller = self.controller(logarithms)
        except InputError:
            return Judged(WORST, np.full(count + 3, -1.0))
        told, tolerance = self.case.loop.measured, self.case.unmeasured_tolerance
        loop = loop_figures(self.plan, controller, required, self._ahead(controller, self.plan.every))
        drawn = bed_figures(self.beds, controller, told, self._ahead(controller, self.beds))
        plan = bed_figures(self.plan.band, controller, told, self._ahead(controller, self.plan.band))
        squares = (np.minimum(np.r_[drawn.unmeasured, plan.unmeasured] / tolerance, WORST)) ** 2
        damping = np.minimum(drawn.damping_ratio, 1 - drawn.largest_pole + required.damping_ratio * 2)
        noise = required.command_noise
        room = [
            *(damping / (required.damping_ratio * (1 + DAMPING_RESERVE)) - 1),
            1.0 if noise is None else 1 - (1 + RESERVE) * max(loop.command_noise) / noise,
            1 - (1 + RESERVE) * loop.largest_rolled_off / LARGEST_ROLLED_OFF,
            loop.modulus_margin / (required.modulus_margin * (1 + RESERVE)) - 1,
        ]
        return Judged(float(squares[:-1].mean() + PLANNED * squares[-1]), np.clip(room, -1e2, 1.0))


@dataclass(frozen=True)
class Judged:
    """Cost of a point of the search, and how much of each requirement is left (r,), relative; negative if missed."""

    cost: float
    room: np.ndarray

    @property
    def merit(self) -> float:
        """By which points are compared: the cost, and much for what is missed."""
        return self.cost + MERIT * float(np.maximum(-self.room, 0.0).sum())


def _kept(
    store: dict[tuple[float, ...], np.ndarray], key: tuple[float, ...], make: Callable[[], np.ndarray]
) -> np.ndarray:
    if key not in store:
        if len(store) > 20:
            store.clear()
        store[key] = make()
    return store[key]


def tuner(case: Case, seed: int = 0, drawn: int = TuningEffort.drawn) -> Tuner:
    """Prepare the search over beds drawn from the case's box."""
    model = observer_model(case.rig, cut(case.vehicle, case.rig), case.loop)
    required = requirements(case)
    values = [case.uncertainty.at(position) for position in case.uncertainty.draw(drawn, seed)]
    beds = bed_set(case, values, np.geomspace(*case.band, BED_POINTS))
    return Tuner(
        case, model, required, planned(case, model.readings.noise), beds,
        tuple(case.loop.structure.quantities), runs_ahead(model),
    )  # fmt: skip


def tuned_weights(search: Tuner, effort: TuningEffort | None = None) -> tuple[dict[str, float], float]:
    """Weights by name, and their cost: sequential quadratic programming, and the best point that it came by.

    The cost is the mean square of the drawn beds' response errors to unmeasured torques, over the tolerance. The search
    begins at the better one of the case's weights and the structure's further starts, and at the next one where it ends
    with a requirement missed.
    """
    effort, structure = effort or TuningEffort(), search.case.loop.structure
    starts = [
        np.log10([values[name] for name in search.names])
        for values in (search.case.loop.values, *structure.further_starts)
    ]
    for begin in sorted(starts, key=lambda start: search.judged(start).merit):
        _rounds(search, begin, effort)
        if search.best.room.min() >= 0:
            break
    best = min(search.known, key=lambda key: search.known[key].merit)
    return dict(zip(search.names, (10.0 ** np.array(best)).tolist(), strict=True)), search.best.cost


def _rounds(search: Tuner, begin: np.ndarray, effort: TuningEffort) -> None:
    """Rounds of the search, each from the best point of those before that began here."""
    quantities = search.case.loop.structure.quantities
    ends = [np.log10([getattr(quantities[name], side) for name in search.names]) for side in ("lower", "upper")]
    for _ in range(effort.rounds):
        before = set(search.known) - {tuple(begin.tolist())}
        within = list(zip(np.maximum(ends[0], begin - FURTHEST), np.minimum(ends[1], begin + FURTHEST), strict=True))
        _improve(search, begin, within, effort.steps)
        best = np.array(min(set(search.known) - before, key=lambda key: search.known[key].merit))
        worth = search.judged(best).merit <= (1 - WORTH_A_ROUND) * search.judged(begin).merit
        begin = best
        if not worth:
            break


def _improve(search: Tuner, begin: np.ndarray, within: list[tuple[float, float]], steps: int) -> None:
    scipy.optimize.minimize(
        lambda at: search.judged(at).cost, begin, bounds=within, method="SLSQP",
        jac=lambda at: _slopes(lambda own: np.array([own.cost]), search, at)[0],
        constraints={
            "type": "ineq", "fun": lambda at: search.judged(at).room,
            "jac": lambda at: _slopes(lambda own: own.room, search, at),
        },
        options={"maxiter": steps, "ftol": SETTLED},
    )  # fmt: skip


def _slopes(of: Callable[[Judged], np.ndarray], search: Tuner, at: np.ndarray) -> np.ndarray:
    """Forward differences (values, weights)."""
    here = of(search.judged(at))
    return np.stack([(of(search.judged(at + STEP * unit)) - here) / STEP for unit in np.eye(len(at))], axis=1)
