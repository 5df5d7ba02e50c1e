"""What to order: which adapter quantities gain over the bed as planned, and how exactly they have to be met.

A quantity is ordered only if no answer that is as good within 2 % has it as planned, with everything else tuned for
that. Quantities are put back one after another, first the one that costs least (backward elimination), since two may
replace each other. What is left has used up the 2 %; where it then gains less than 2 % over what can still be put back,
that goes back as well.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from matching.match.attempt import Question, VerifiedSolution, target_results, task_of
from matching.match.case import Case, Move, apply, scaled, unscaled
from matching.match.loop import of_observer
from matching.match.programme import SLOTS, Problem
from matching.match.responses import (
    BandNodes,
    ComparedBed,
    ErrorFigures,
    error_figures,
    figures_of,
    log_squares,
    pooled,
)
from matching.match.result import AdapterTrade, Curves, ResponseError
from matching.match.solve import (
    AS_GOOD,
    SAME_ERROR,
    End,
    Solution,
    TuningTask,
    as_good_as,
    gentler,
    given_end,
    least_change,
    never_worse,
    stable_ends,
    vector_of,
    warm,
)
from matching.match.verify import verify
from modelling.bed.controllers import ModelBased
from modelling.bed.observer import FREE_COMMAND_WEIGHT, Observer, design, observer_model
from modelling.bed.vehicle import cut
from modelling.errors import InputError

# --- The response error over one adapter quantity, all that may move beside it tuned for each value.

PLACES = np.linspace(0, 1, 5)  # of the range between the bounds, at which the error is worked out
MARGIN_ROUNDS, AROUND = 4, 0.015  # of asking for a margin missed between the grid, and how far about it, relative
JUMP = 1.1  # times a neighbour's objective, above which a value is taken to lie at a poorer optimum than that
FOLLOWING_STEPS = 5  # in which a neighbour's optimum is followed to such a value
HALVINGS = 2  # of the way between a value that is as good and one that is not, in looking for the end of the range


def feedback_error(tuned: Case, nodes: BandNodes) -> float:
    """Response error of the feedback alone, over the band."""
    bed = ComparedBed(tuned).at(nodes.frequencies)
    return pooled(nodes.root_mean(log_squares(bed.unmeasured, bed.vehicle)))


@dataclass
class Retuning:
    """The answer about one adapter quantity, number ``moved`` of the task's, with others ``held`` at scaled values.

    ``ends`` are the best settings by the quantity's scaled value; None where no loop was found that keeps the limits.
    """

    task: TuningTask
    solution: Solution
    moved: int
    held: Mapping[int, float]
    ends: dict[float, End | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.problem: Problem = self.task.build(slots=SLOTS)
        self.begin = vector_of(self.task, self.solution)
        self.ordered = float(self.begin[self.moved])

    def survey(self, *more: float) -> None:
        """Work out the error at :data:`PLACES`, at the ordered and at more values, from the ordered one outwards."""
        places = sorted({*PLACES.tolist(), *more, self.ordered})
        at = places.index(self.ordered)
        for way in (places[at:], places[:at][::-1]):
            for place in way:
                self.as_good(place)

    def follow_neighbours(self) -> None:
        """Where the error jumps between neighbouring values, follow the better optimum to the other, in small steps.

        Each value is tuned from one neighbour. A large step may leave that optimum for a poorer one, or for none.
        """
        places = sorted(self.ends)
        for way in (places, places[::-1]):
            for near, place in pairwise(way):
                better, end = self.ends[near], self.ends[place]
                if better is None or (end is not None and end.objective <= JUMP * better.objective):
                    continue
                followed = self._followed(better, near, place)
                if followed is not None and (end is None or followed.objective < end.objective):
                    self.ends[place] = followed

    def as_good(self, place: float) -> bool:
        """Whether a value is as good as the best, all else tuned for it."""
        if place not in self.ends:
            self.ends[place] = self._tuned(place)
        end = self.ends[place]
        return end is not None and end.objective <= self.solution.as_good_to

    def as_good_between(self) -> tuple[float, float]:
        """Ends of the range about the ordered value in which every value tried is as good; each is one that is."""
        places = sorted(self.ends)
        at = places.index(self.ordered)
        lower, upper = (self._last_good(way) for way in (places[: at + 1][::-1], places[at:]))
        return lower, upper

    def curve(self, nodes: BandNodes) -> list[tuple[float, float]]:
        """Values, SI, and the response error there; what keeps no limits is left out."""
        move, points = self.task.moves[self.moved], []
        for place, end in sorted(self.ends.items()):
            if end is not None:
                tuned = apply(self.task.case, self.problem.values(end.v))
                points.append((float(unscaled(place, move)), feedback_error(tuned, nodes)))
        return points

    def _last_good(self, way: list[float]) -> float:
        good = way[0]
        for place in way[1:]:
            if self.as_good(place):
                good = place
                continue
            for _ in range(HALVINGS):
                middle = (good + place) / 2
                good, place = (middle, place) if self.as_good(middle) else (good, middle)
            break
        return float(np.clip(good, 0, 1))

    def _tuned(self, place: float) -> End | None:
        """From the nearest value that was solved, and from the answer itself where that is not as good.

        A neighbour may lie at another local optimum, which every value after it would inherit.
        """
        known = {other: end.v for other, end in self.ends.items() if end is not None}
        near = known[min(known, key=lambda other: abs(other - place))] if known else self.begin
        best = self._tuned_from(near, place)
        if near is self.begin or (best is not None and best.objective <= self.solution.as_good_to):
            return best
        ends = (end for end in (best, self._tuned_from(self.begin, place)) if end is not None)
        return min(ends, key=lambda end: end.objective, default=None)

    def _followed(self, end: End, near: float, place: float) -> End | None:
        """The end at one value, followed to another; None where it is lost on the way."""
        followed: End | None = end
        for step in np.linspace(near, place, FOLLOWING_STEPS + 1)[1:]:
            followed = None if followed is None else self._tuned_from(followed.v, float(step))
        return followed

    def _tuned_from(self, start: np.ndarray, place: float) -> End | None:
        lower, upper = self.problem.lower.copy(), self.problem.upper.copy()
        v = start.copy()
        for i, value in {**self.held, self.moved: place}.items():
            v[i] = lower[i] = upper[i] = value
        problem = replace(self.problem, lower=lower, upper=upper)
        least, extra = (1 - AS_GOOD) * self.task.case.limits["modulus_margin"], list(self.solution.added)
        for _ in range(MARGIN_ROUNDS):
            end = next(stable_ends(problem, [v, *gentler(problem, v)], np.array(extra)), None)
            if end is None or end.margin >= least:
                return end
            v = end.v
            extra += [end.margin_frequency * part for part in (1 - AROUND, 1 + AROUND, 1.0)]
        return None


def some_as_planned(task: TuningTask, solution: Solution, planned: Sequence[Move]) -> Solution | None:
    """The answer with some quantities held as planned, from the answer that moves them; None where no limits are kept.

    Parameters
    ----------
    planned : sequence of Move
        At least one of the task's.
    """
    held = {task.moves.index(move): scaled(move.planned, move) for move in planned}
    moved = next(iter(held))
    retuning = Retuning(task, solution, moved, held)
    retuning.as_good(held[moved])
    end = retuning.ends[held[moved]]
    if end is None:
        return None
    pairs = tuple(end.v[len(task.moves) :].tolist())
    return Solution(retuning.problem.values(end.v), end.objective, (), True, pairs=pairs)


# --- Adapters

ADAPTERS = "rig."  # the names they begin with
SAME_OBJECTIVE = 1e-3  # relative: what reruns differ by


def settle_adapters(
    question: Question, verified: VerifiedSolution
) -> tuple[VerifiedSolution, tuple[AdapterTrade, ...]]:
    """The match with nothing ordered that gains nothing, and the trade of every adapter quantity that may move.

    Where targets or limits are missed there is nothing to order yet, and no trade.
    """
    adapters = [move for move in verified.task.moves if move.name.startswith(ADAPTERS)]
    solution = verified.solution
    if not adapters or verified.beyond or not solution.feasible or not solution.holds or not _met(question, verified):
        return verified, ()
    everything = _as_planned(question, verified, adapters)
    settled = _settled(question, verified, adapters, everything)
    nodes = settled.checked.errors.nodes
    planned = None if everything is None else feedback_error(apply(question.case, everything.values), nodes)
    return settled, _of_one_bed(tuple(_trade(settled, move, adapters, planned, nodes) for move in adapters))


def _of_one_bed(trades: tuple[AdapterTrade, ...]) -> tuple[AdapterTrade, ...]:
    """The bed as planned with one error: of two searches for it, where one quantity is ordered, the better counts."""
    ordered = [trade for trade in trades if trade.ordered != trade.planned]
    if len(ordered) != 1 or ordered[0].error_as_planned is None or ordered[0].error_all_as_planned is None:
        return trades
    least = min(ordered[0].error_as_planned, ordered[0].error_all_as_planned)
    both = replace(ordered[0], error_as_planned=least)
    return tuple(replace(both if trade is ordered[0] else trade, error_all_as_planned=least) for trade in trades)


def _met(question: Question, verified: VerifiedSolution) -> bool:
    checked = verified.checked
    return checked.stable and not checked.violations and all(row.met for row in target_results(question, checked))


def _settled(
    question: Question, verified: VerifiedSolution, adapters: Sequence[Move], everything: Solution | None
) -> VerifiedSolution:
    """The match with as many adapters as planned as answers allow that are as good: as the best, then as the order."""
    limit = verified.solution.as_good_to
    back, best = _put_back(question, verified, adapters, everything, [], limit)
    settled = _with_some_as_planned(question, verified, back, best or verified.solution)
    ordered, limit = len(adapters) - len(back), as_good_as(settled.solution.objective, AS_GOOD)
    if not ordered or settled is verified:
        return settled
    more, best = _put_back(question, verified, adapters, everything, back, limit)
    if best is None:
        return settled
    solution = replace(verified.solution, as_good_to=max(verified.solution.as_good_to, best.objective))
    fewer = _with_some_as_planned(question, replace(verified, solution=solution), more, best)
    return settled if fewer.solution is solution else fewer


def _put_back(
    question: Question, verified: VerifiedSolution, adapters: Sequence[Move], everything: Solution | None,
    back: list[Move], limit: float,
) -> tuple[list[Move], Solution | None]:  # fmt: skip
    """Adapters as planned, beside those that are, up to a limit of the objective, and the answer; None if no more."""
    back, best = list(back), None
    if everything is not None and everything.objective <= limit:
        return list(adapters), everything
    while len(back) < len(adapters) - 1:  # all together were tried at first
        tried = []
        for move in adapters:
            if move not in back:
                solution = _as_planned(question, verified, [*back, move])
                if solution is not None and solution.objective <= limit:
                    tried.append((solution.objective, move, solution))
        if not tried:
            break
        _, move, best = min(tried, key=lambda trial: trial[0])
        back.append(move)
    return back, best


def _with_some_as_planned(
    question: Question, verified: VerifiedSolution, back: list[Move], best: Solution
) -> VerifiedSolution:
    """The match with some adapters as planned, the others changed least and all else tuned for them.

    As it was where that does not pass the verification; as it was given where that is better.
    """
    values = _with_least_order(question, verified, back, best)
    point = given_end(verified.task.build())
    if values is None:
        return verified
    solution = replace(values, starts=verified.solution.starts, as_good_to=verified.solution.as_good_to)
    if point is not None and point.objective < (1 - SAME_OBJECTIVE) * solution.objective:
        solution = never_worse(verified.task, solution, point)
    tuned = apply(question.case, solution.values)
    settled = replace(verified, solution=solution, tuned=tuned, checked=verify(tuned, question.case.rig))
    return settled if _met(question, settled) else verified


def _with_least_order(
    question: Question, verified: VerifiedSolution, back: list[Move], best: Solution
) -> Solution | None:
    task = _task_as_planned(question, verified, back)
    adapters = [move for move in verified.task.moves if move.name.startswith(ADAPTERS)]
    weights = np.array([weight * (move in adapters) for move, weight in zip(task.moves, task.weights, strict=True)])
    if weights.any():
        best = least_change(replace(task, weights=weights), best, verified.solution.as_good_to)
    held = {name: move.planned for move in back for name in move.together}
    held |= {name: best.values[name] for move in adapters if move not in back for name in move.together}
    rest = task_of(question, [move for move in verified.task.moves if move not in adapters])
    if not rest.moves:
        return replace(best, values=held | best.values)
    rest = replace(rest, case=apply(question.case, held))
    tuned = warm(rest, best)
    if tuned is None or not tuned.holds:
        return None
    tuned = least_change(rest, tuned, as_good_as(tuned.objective, SAME_ERROR))
    return replace(tuned, values=held | tuned.values)


def _task_as_planned(question: Question, verified: VerifiedSolution, back: Sequence[Move]) -> TuningTask:
    """The programme in which some adapters are as planned and do not move."""
    values = {name: move.planned for move in back for name in move.together}
    left = [move for move in verified.task.moves if move not in back]
    return replace(task_of(question, left), case=apply(question.case, values))


def _as_planned(question: Question, verified: VerifiedSolution, back: Sequence[Move]) -> Solution | None:
    """The best answer with some adapters as planned; None where no loop keeps its limits.

    Searched for in the programme without them, and from the answer with them held: one alone may end in a worse place.
    """
    task = _task_as_planned(question, verified, back)
    answers = [some_as_planned(verified.task, verified.solution, back)]
    if task.moves:
        answers.append(warm(task, verified.solution))
    held = [answer for answer in answers if answer is not None and answer.holds]
    if not held:
        return None
    planned = {name: move.planned for move in back for name in move.together}
    best = min(held, key=lambda answer: answer.objective)
    return replace(best, values=planned | best.values)


def _trade(
    settled: VerifiedSolution, move: Move, adapters: Sequence[Move], planned: float | None, nodes: BandNodes
) -> AdapterTrade:
    """What an adapter quantity gains, the others ordered or as planned as they are, everything else tuned for it."""
    task, values = settled.task, settled.solution.values
    number = task.moves.index(move)
    others = [other for other in adapters if other is not move and values[other.name] == other.planned]
    held = {task.moves.index(other): scaled(other.planned, other) for other in others}
    retuning = Retuning(task, settled.solution, number, held)
    as_planned = scaled(move.planned, move)
    retuning.survey(*([as_planned] if 0 <= as_planned <= 1 else []))
    retuning.follow_neighbours()
    low, high = retuning.as_good_between()
    curve = retuning.curve(nodes)
    error = next((error for value, error in curve if abs(value - move.planned) <= 1e-9 * abs(move.planned)), None)
    ends = [float(unscaled(place, move)) for place in (low, high)]
    return AdapterTrade(
        name=move.name, unit=move.unit, planned=move.planned, ordered=values[move.name], acceptable=(ends[0], ends[1]),
        error_as_planned=error, error_all_as_planned=planned, error_as_ordered=settled.checked.errors.unmeasured,
        curve=tuple(curve),
    )  # fmt: skip


# --- The response errors of a match with the lower bounds that the dead time sets, and its curves for drawing.

CURVE_POINTS = 400
UNSAMPLED_REFINEMENT = 8  # samples in place of one, where sampling is to cost next to nothing


def errors_with_bounds(tuned: Case, figures: ErrorFigures) -> ResponseError:
    """Response errors of a tuned case, with the lower bounds set by its dead time; these emulate the whole vehicle."""
    whole = emulating_the_whole(tuned)
    return ResponseError(
        band=figures.band,
        before=figures.before,
        after=figures.after,
        after_same_functions=figures.after_same_functions,
        unmeasured=figures.unmeasured,
        bound=lower_bound(whole, 1),
        bound_unsampled=lower_bound(whole, UNSAMPLED_REFINEMENT),
        unmeasured_bound=estimator_bound(whole),
        functions=figures.functions,
    )


def emulating_the_whole(case: Case) -> Case:
    """The case with the residual vehicle that is cut from the vehicle, in place of the user's own."""
    if case.simple_vehicle is None:
        return case
    return dataclasses.replace(case, simple_vehicle=None, residual_vehicle=cut(case.vehicle, case.rig))


def lower_bound(case: Case, refinement: int) -> float:
    """Response error of the H2-optimal controller at a sample time that is so many times shorter.

    Every torque is measured and every state known, so whatever a controller does with less, it responds later or
    worse. It is the optimum for torques that step at unforeseeable moments, over all frequencies; over a finite band
    a controller may do a little better, at the cost of what lies outside.
    """
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    on_rig = tuple(part.name for part in case.rig.inputs if part.name not in driven)
    structure = ModelBased()
    start = {name: quantity.start for name, quantity in structure.quantities.items()}
    values = {**start, **case.loop.values, "sample_time": case.loop["sample_time"] / refinement}
    finer = dataclasses.replace(case.loop, structure=structure, measured=on_rig, values=values)
    return error_figures(dataclasses.replace(case, loop=finer)).after


def estimator_bound(case: Case) -> float | None:
    """Response error to unmeasured torques of the optimal causal estimator, with the bed's sensors and their noise.

    A Kalman filter for torques that may change by as much as the manoeuvre does within half a period of the band's
    upper edge, with the noise that the sensors' uncertainties state, dynamometers that do exactly what they are told,
    and commands that cost nothing; no bed but the one as planned counts. None where the design has no solution.
    """
    on_rig = {part.name for part in case.rig.inputs}
    ranges = [np.ptp(torque.torque(torque.time())) for torque in case.manoeuvre.values()]
    driving = [np.ptp(torque.torque(torque.time())) for name, torque in case.manoeuvre.items() if name in on_rig]
    structure, size = Observer(), float(max(driving or ranges))
    weights = {name: quantity.lower for name, quantity in structure.quantities.items()}
    weights |= {name: 1.0 for name in weights if name.endswith(("sensor_noise", "speed_noise"))}
    weights |= {"torque_drift": size * np.sqrt(2 * case.band[1]), "command_weight": FREE_COMMAND_WEIGHT}
    loop = dataclasses.replace(case.loop, structure=structure, values={**case.loop.values, **weights})
    ideal = dataclasses.replace(case, loop=loop)
    try:
        controller = design(observer_model(case.rig, cut(case.emulated_vehicle, case.rig), loop), weights)
        return figures_of(ComparedBed(ideal, controller=of_observer(controller))).unmeasured
    except InputError:
        return None


def curves_of(bed: ComparedBed) -> Curves:
    """Responses for drawing, from half the lower to three times the upper edge of the band."""
    case = bed.case
    top = min(3 * case.band[1], 0.45 / case.loop["sample_time"])
    f = np.geomspace(case.band[0] / 2, max(top, case.band[1]), CURVE_POINTS)
    compared = bed.at(f)
    return Curves(f, compared.vehicle, compared.rig, compared.matched, compared.unmeasured)
