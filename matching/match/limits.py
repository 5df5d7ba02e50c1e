"""What stands in the way of a match, most binding first, and relaxations that were solved."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy

from matching.match.bounds import emulating_the_whole, prompt_bound
from matching.match.case import Case, Move, apply, scaled
from matching.match.demands import ExceededLimit, rig_values
from matching.match.findings import Finding, stated
from matching.match.objective import search_for
from matching.match.problem import MatchProblem, differing_components, target_results
from matching.match.responses import ResponseError
from matching.match.result import TargetResult
from matching.match.rounds import end_at, rounds
from matching.match.search import BothWays, solve
from matching.match.variables import SearchSettings
from matching.match.verify import DISAGREEMENT, Verification, Violation, verify
from modelling.bed.controllers import ModelBased
from modelling.errors import NoDesign
from modelling.modal.modes import modes
from modelling.modal.result import Mode
from modelling.units import printed

# --- What a search found, and what would do: relaxations that were solved and verified.

LIMIT_RESERVE = 1.02  # on the least demand of a limit: the simulated manoeuvre takes a little more than the vehicle's
DEAD_TIMES_TRIED = 3  # halvings of the range of dead times, on a logarithmic scale
WHOLE_TRIALS = 2  # dead times that are tried by a whole search, the longest first
AT_BOUND = 1e-2  # of a quantity's range: what ends so near a bound may be held by it
FACTORS = (3.0, 30.0)  # by which bounds are moved out, in turn


@dataclass(frozen=True)
class Solution:
    """What a search found: values by name (SI), the tuned case, its cost and those of the starts.

    ``keeps_all`` is whether every requirement is met as the search sees it; ``beyond`` are limits that no setting
    keeps; ``failures`` are settings that have no controller, by the reason; ``checked`` is the verification once there
    is one.
    """

    values: Mapping[str, float]
    tuned: Case
    cost: float
    starts: tuple[float, ...]
    keeps_all: bool
    beyond: list[ExceededLimit]
    checked: Verification | None = None
    failures: Mapping[str, int] = field(default_factory=dict)
    play: BothWays | None = None


@dataclass(frozen=True)
class DeadTimeTrial:
    """Shorter dead times that were solved: the shortest, and the longest with which every target is met, s or None."""

    shortest: float
    sufficient: float | None


@dataclass(frozen=True)
class Relaxations:
    """Relaxations with which the case was solved again.

    Attributes
    ----------
    dead_time : DeadTimeTrial or None
        None where no shorter one was tried.
    limits : dict of str to float
        Values, SI, of the limits that no setting keeps, with all of which together every target is met.
    structure : str
        Control structure with which the values as tuned meet every target, all torques on the rig measured.
    bounds : tuple of (Move, float)
        Quantities at a bound, each with the value (SI) beyond it with all of which together every target is met.
    """

    dead_time: DeadTimeTrial | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    structure: str = ""
    bounds: tuple[tuple[Move, float], ...] = ()


@dataclass(frozen=True)
class SolvedAgain:
    """The same search with little effort on a case that is changed a little, begun at a solution."""

    problem: MatchProblem
    settings: SearchSettings

    def values(
        self, case: Case, moves: Sequence[Move], solution: Solution, most_rounds: int = 1
    ) -> dict[str, float] | None:
        """Values by name (SI) with which every target and limit of the changed case is met, or None."""
        settings = self.settings
        settings = replace(settings, drawn=min(8, settings.drawn), pool=min(32, settings.pool), scenarios=0)
        asked = replace(self.problem.demands, limits=case.limits)
        try:
            search = search_for(case, moves, self.problem.shares, asked, settings)
            end = rounds(
                search, end_at(search, search.begin(solution.values)), most_rounds, most_rounds * settings.steps
            )
            values = search.values(end.x)
            return values if self.meets_all(apply(case, values)) else None
        except NoDesign:
            return None

    def whole(self, case: Case, moves: Sequence[Move]) -> bool:
        """Whether the whole search meets every target and limit of the changed case, begun at its own values.

        It is the search that a match of the changed case makes.
        """
        settings = replace(self.settings, starts=SearchSettings().starts, decides=True)
        asked = replace(self.problem.demands, limits=case.limits)
        search = search_for(case, moves, self.problem.shares, asked, settings)
        return self.meets_all(apply(case, search.values(solve(search).end.x)))

    def meets_all(self, tuned: Case) -> bool:
        """Whether a tuned case meets every target and limit, verified."""
        try:
            checked = verify(tuned, self.problem.case.rig, deviations=False)
        except NoDesign:
            return False
        targets = target_results(replace(self.problem, case=tuned), checked)
        return checked.stable and not checked.violations and all(target.met for target in targets)


def relaxations(problem: MatchProblem, solution: Solution, again: SolvedAgain) -> Relaxations:
    """Try what may help: larger limits where no setting keeps them, wider bounds, less dead time."""
    case = problem.case
    larger = _larger_limits(problem, solution, again)
    structure = case.loop.structure
    if structure.has_feed_forward or structure.is_observer or case.loop.torqueless:
        return Relaxations(limits=larger)
    return Relaxations(
        _shorter_dead_time(problem, solution, again), larger, _with_feed_forward(problem, solution, again),
        _wider_bounds(problem, solution, again),
    )  # fmt: skip


def _larger_limits(problem: MatchProblem, solution: Solution, again: SolvedAgain) -> dict[str, float]:
    """Limits that no setting keeps, as large as their least demand; none where the targets are missed even so."""
    least: dict[str, float] = {}
    for exceeded in solution.beyond:
        least[exceeded.limit] = max(LIMIT_RESERVE * exceeded.demand, least.get(exceeded.limit, 0.0))
    if not least:
        return {}
    case = replace(problem.case, limits={**problem.case.limits, **least})
    return least if again.whole(case, problem.moves) else {}  # the solution lies where the limit drove it: no start


def _shorter_dead_time(problem: MatchProblem, solution: Solution, again: SolvedAgain) -> DeadTimeTrial | None:
    """Solve the case at shorter dead times; None where there is none to try, as it is one sample already."""
    shortest, longest = problem.case.loop["sample_time"], problem.case.loop["dead_time"]
    if longest <= shortest:
        return None

    def helps(dead_time: float) -> bool:
        return again.values(apply(problem.case, {"loop.dead_time": dead_time}), problem.moves, solution) is not None

    if not helps(shortest):
        return DeadTimeTrial(shortest, None)
    found = [shortest]
    for _ in range(DEAD_TIMES_TRIED):
        middle = float(f"{np.sqrt(found[-1] * longest):.2g}")  # as it is printed
        if not found[-1] < middle < longest:
            break
        if helps(middle):
            found.append(middle)
        else:
            longest = middle
    # a match of the case with that dead time has to meet the targets, not only a search from here
    for dead_time in found[::-1][:WHOLE_TRIALS]:
        if again.whole(apply(problem.case, {"loop.dead_time": dead_time}), problem.moves):
            return DeadTimeTrial(shortest, dead_time)
    return DeadTimeTrial(shortest, None) if len(found) <= WHOLE_TRIALS else None


def _wider_bounds(problem: MatchProblem, solution: Solution, again: SolvedAgain) -> tuple[tuple[Move, float], ...]:
    """Quantities at a bound, each with the value (SI) beyond it with which every target is met.

    One of them where that does alone, else all that went beyond their bounds together; empty where none of it helps.
    """
    stuck = [move for move in problem.moves if _out_of(move, solution.values[move.name], 1.0) is not None]

    def beyond(some: Sequence[Move], factor: float) -> tuple[tuple[Move, float], ...]:
        moved = {move.name: _out_of(move, solution.values[move.name], factor) or move for move in some}
        wider = tuple(moved.get(move.name, move) for move in problem.moves)
        values = again.values(problem.case, wider, solution)
        ends = [(move, values[move.name]) for move in some] if values is not None else []
        return tuple((move, value) for move, value in ends if not move.lower <= value <= move.upper)

    for factor in FACTORS if stuck else ():
        together = beyond(stuck, factor)
        if together:
            alone = (beyond([move], factor) for move, _ in together) if len(together) > 1 else ()
            return next((sufficient for sufficient in alone if sufficient), together)
    return ()


def _out_of(move: Move, value: float, factor: float) -> Move | None:
    """A move with the bound that a value is at moved out; None where it is at none, or at one that is physical: at 0,
    or towards the wall of a tube."""
    part = scaled(value, move)
    if part >= 1 - AT_BOUND and not move.name.endswith(".inner_diameter"):
        return replace(move, upper=factor * move.upper)
    if part <= AT_BOUND and move.lower > 0 and not move.name.endswith(".diameter"):
        return replace(move, lower=move.lower / factor)
    return None


def _with_feed_forward(problem: MatchProblem, solution: Solution, again: SolvedAgain) -> str:
    """The structure with a feed-forward, if the same values meet the targets with it; its feedback has to take them."""
    if not ModelBased.quantities.keys() <= solution.tuned.loop.values.keys():
        return ""
    driven = {dynamometer.torque_input for dynamometer in problem.case.loop.dynamometers}
    measured = tuple(part.name for part in problem.case.rig.inputs if part.name not in driven)
    loop = replace(solution.tuned.loop, structure=ModelBased(), measured=measured)
    return ModelBased.name if again.meets_all(replace(solution.tuned, loop=loop)) else ""


# --- What stands in the way


def limits(
    problem: MatchProblem, solution: Solution, targets: Sequence[TargetResult], relaxed: Relaxations
) -> list[Finding]:
    """What stands in the way, most binding first; nothing if the match is good.

    What is said to help is what ``relaxed`` holds, which was solved.
    """
    case, checked, asked = problem.case, solution.checked, problem.demands
    assert checked is not None, "a solution is verified before it is judged"
    shared = stated("components_differ", differing_components(case))
    found = [*shared, *_beyond(solution.beyond, relaxed)]
    found += _loop(solution, checked)
    missed = [target for target in targets if not target.met]
    found += [_missed(target) for target in missed]
    if missed:
        found += _mechanics(problem, missed)
        found += [*_bounds(relaxed), *_delay(problem, missed, relaxed)]
    mentioned = {exceeded.limit for exceeded in solution.beyond}
    found += [_violation(violation) for violation in checked.violations if violation.limit not in mentioned]
    mentioned |= {violation.limit for violation in checked.violations}
    asking = asked.broken(rig_values(solution.tuned))
    found += [_asks(demand) for demand in _worst(asking) if demand.limit not in mentioned]
    return found if len(found) > len(shared) else []


def led_by_bound(stands: list[Finding], case: Case, error: ResponseError) -> list[Finding]:
    """The findings, led by what no controller does better with every torque measured, where that is too much.

    Dead time and sampling leave it, or a specimen on the rig that is not the vehicle's.
    """
    if not stands or min(error.bound, error.after) <= case.tolerance:
        return stands
    prompt = 0.0
    with contextlib.suppress(NoDesign):
        prompt = prompt_bound(emulating_the_whole(case))
    if prompt > case.tolerance:
        return [Finding("other_specimen", prompt, case.tolerance), *stands]
    return [Finding("dead_time_alone", error.bound, case.tolerance), *stands]


def _loop(solution: Solution, checked: Verification) -> list[Finding]:
    """What is wrong with the loop as a whole."""
    if checked.stable:
        return []
    if not checked.checks.get("loop and simulation agree", True):
        return [Finding("methods_disagree", allowed=DISAGREEMENT)]
    failed = ", ".join(name for name, good in checked.checks.items() if not good)
    return [Finding("not_stable", where=failed, data={"starts": 0 if solution.keeps_all else len(solution.starts)})]


def _worst(broken: Sequence[ExceededLimit]) -> list[ExceededLimit]:
    """One of each limit, the worst, which comes first."""
    return list({exceeded.limit: exceeded for exceeded in reversed(broken)}.values())[::-1]


def _asks(exceeded: ExceededLimit, **data: Any) -> Finding:
    dynamometer, limit, demand, allowed = exceeded
    return Finding("torque_limit", demand, allowed, where=dynamometer, data={"limit": limit, **data})


def _beyond(broken: Sequence[ExceededLimit], relaxed: Relaxations) -> list[Finding]:
    """Limits that no setting keeps, and the values with which the targets are met, if they are."""
    worst = _worst(broken)
    return [
        _asks(
            one, no_setting=True, solved_with=relaxed.limits.get(one.limit),
            together=len(relaxed.limits) > 1 and one is worst[-1],
        )
        for one in worst
    ]  # fmt: skip


def _missed(target: TargetResult) -> Finding:
    return Finding(
        "target_missed", target.matched, target.vehicle, "Hz", str(target.vehicle_mode), data=target.to_dict()
        | {"identified": target.identified},
    )  # fmt: skip


def _violation(violation: Violation) -> Finding:
    return Finding(
        "limit_exceeded", violation.value, violation.allowed, where=violation.where, data={"limit": violation.limit}
    )


def _mechanics(problem: MatchProblem, missed: Sequence[TargetResult]) -> list[Finding]:
    """What adapters or inertias alone would have to be, where adapters are what may move."""
    case, on_rig, asked = problem.case, problem.on_rig, problem.demands
    others = any(move.name.startswith(("loop.", "residual_vehicle.")) for move in case.moves)
    if not case.moves or others or case.loop.tunes_observer:
        return []
    number = {target.mode: i for i, target in enumerate(case.targets)}
    found = []
    for target in missed:
        mode = on_rig[number[target.vehicle_mode]]
        if mode is None:
            continue
        parts = []
        peak = max((float(np.abs(cut.torque).max()) for part in asked.behind for cut in part.cuts), default=0.0)
        limit = max(
            (value for key, value in case.limits.items() if key.startswith("shafts.") and key.endswith(".torque")),
            default=peak,
        )
        behind = [part for part in asked.behind if any(part.ways.values())]
        shafts = sorted({name for part in behind for way in part.ways.values() for name in way[-1:]})
        if stiffness := _needed(case, [f"shafts.{name}.stiffness" for name in shafts], mode, target.vehicle, 1e-6, 1.0):
            value = stiffness * case.rig.parameters[f"shafts.{shafts[0]}.stiffness"].value
            twist = limit / value
            turned = f"{np.degrees(twist):.0f}° ({twist / (2 * np.pi):.1f} turns) at {limit:.0f} N·m"
            parts.append(f"{_plain(value)} N·m/rad in {' and '.join(shafts)}, which twists {turned}")
        masses = sorted({name for part in behind for name in part.inertias})
        if inertia := _needed(case, [f"inertias.{name}.J" for name in masses], mode, target.vehicle, 1.0, 1e5):
            planned = behind[0].reflected_inertia(rig_values(case))
            instead = f"{_plain(inertia * planned)} kg·m² instead of {_plain(planned)}"
            parts.append(f"{inertia:.0f} times the inertia behind each cut, {instead}")
        elif parts:
            parts[-1] += ", and no inertia behind the cuts, however large, does it alone"
        if parts:
            found.append(Finding("no_adapter", target.vehicle, unit="Hz", data={"parts": ", or ".join(parts)}))
    return found


def _plain(value: float) -> str:
    """Three digits without a power of ten."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _needed(case: Case, names: list[str], mode: Mode, wanted: float, low: float, high: float) -> float | None:
    """Common factor on quantities of the rig that brings its lowest elastic mode of one symmetry to a frequency."""
    inertias = {name: case.rig.parameters[name].value for name in names}

    def off(exponent: float) -> float:
        with_change = modes(case.rig, {name: value * 10**exponent for name, value in inertias.items()})
        lowest = next(each.frequency for each in with_change if each.frequency > 0 and each.symmetry == mode.symmetry)
        return lowest - wanted

    ends = np.log10(low), np.log10(high)
    if not inertias or off(ends[0]) * off(ends[1]) > 0:
        return None
    return float(10 ** scipy.optimize.brentq(off, *ends, xtol=1e-6))


def _bounds(relaxed: Relaxations) -> list[Finding]:
    """Bounds of the case beyond which the targets were met."""
    if not relaxed.bounds:
        return []
    values = []
    for move, value in relaxed.bounds:
        bound = f"{move.upper:.4g} is the largest" if value > move.upper else f"{move.lower:.4g} is the smallest"
        unit = "" if move.unit == "1" else f" {printed(move.unit)}"
        values.append(f"{move.name} at {value:.4g}{unit} ({bound} allowed)")
    return [Finding("bounds", where=" and ".join(values))]


def _delay(problem: MatchProblem, missed: Sequence[TargetResult], relaxed: Relaxations) -> list[Finding]:
    """Dead time and lags where a shorter dead time meets the targets, else what else was seen to meet them."""
    loop, trial, said = problem.case.loop, relaxed.dead_time, []
    if trial is not None and trial.sufficient is not None:
        for target in missed:
            omega = 2 * np.pi * target.vehicle
            late = np.degrees(omega * loop["dead_time"])
            lags = np.degrees(np.arctan(omega * loop["inverter_lag"]) + np.arctan(omega * loop["torque_sensor_lag"]))
            delay = f"dead time {1e3 * loop['dead_time']:.3g} ms"
            said.append(f"{delay} leaves {late:.0f}° at {target.vehicle:.2f} Hz and the lags {lags:.0f}°")
        said[-1] += f"; solved with {1e3 * trial.sufficient:.2g} ms, every target is met"
    elif trial is not None:
        said.append(
            f"a shorter dead time alone does not help: solved with one sample, {1e3 * trial.shortest:.3g} ms, the "
            "targets are not met either"
        )
    found = stated("dead_time", said)
    if relaxed.structure:
        found.append(Finding("structure", where=relaxed.structure, data={"targets": len(problem.case.targets)}))
    return found
