"""The search: controller, residual vehicle and adapters tuned together over a set of beds, for every structure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy

from matching.match.damping import stable_loops
from matching.match.loop import bed_of, closed_poles, side_by_side
from matching.match.objective import OF_ERRORS, Search, SpeedSearch
from matching.match.opened import OPENED
from matching.match.rounds import SearchEnd, end_at, judged_again, keeps_all, misses, rounds, within_errors
from matching.match.variables import CONTROLLER
from matching.match.worst import add_scenarios

NEARLY_AS_CHEAP = 1.5  # times the cost of the cheapest start, up to which the requirements decide between starts
SPREAD_GAINS = 8  # starts of a feedback law's gains, spread over their bounds (Sobol 1967)
MIDDLE = 0.6  # of every gain's range, where a feedback law is searched from as well
GENTLE = 0.02  # the same: a loop that does little is stable where a bed without control is


@dataclass(frozen=True)
class Found:
    """What a search found.

    Attributes
    ----------
    values : dict of str to float
        SI, by name.
    end : SearchEnd
    starts : tuple of float
        Costs where the starts ended.
    controller_alone : SearchEnd
        Where only the weights of an observer moved; of a feedback law where everything did.
    keeps_all : bool
        Whether every requirement is met.
    gains_alone : SearchEnd or None
        The best end of a feedback law's gains alone.
    failures : mapping of str to int
        Settings that were tried and have no controller, by the reason.
    play : BothWays or None
        Where beds with free play cost the errors of a controller: both ways.
    """

    values: dict[str, float]
    end: SearchEnd
    starts: tuple[float, ...]
    controller_alone: SearchEnd
    keeps_all: bool
    gains_alone: SearchEnd | None = None
    failures: Mapping[str, int] = field(default_factory=dict)
    play: BothWays | None = None


def solve(
    search: Search, tell: Callable[[str], None] = lambda _: None, begins: Sequence[Mapping[str, float]] = ()
) -> Found:  # fmt: skip
    """The best point that was found.

    An observer's search begins at the case's weights, where it states any, else at weights that are scaled by the bed,
    and at the next ones where it ends with a requirement missed or with errors beyond their tolerances; where all do,
    at the best of settings scattered about the best end. Only then do residual vehicle and adapters move as well: its
    weights alone come near the end. The cost of a feedback law has several valleys: its gains are tuned alone from
    several starts, then everything from the best end, and from the case's own gains where no end keeps every
    requirement. No answer is worse than the case as given.
    With ``begins``, values by name (SI), an observer's search begins at these first, that of a feedback law at these
    alone.
    """
    settings, of_observer = search.settings, search.case.loop.tunes_observer
    given = end_at(search, search.begin())
    of_controller = np.array([one.name.startswith(CONTROLLER) for one in search.variables])
    everything = np.ones(len(search.variables), bool)
    search.free = of_controller if of_observer else everything
    begin_at = [search.begin(values) for values in begins]
    ends, gains = _from_starts(search, begin_at)
    play = None
    if search.sees_opened and not _holds(search, ends[0]):
        ends = [*_from_less_noise(search, begin_at), *ends]
        if not _holds(search, ends[0]) and not settings.decides:  # without the play it would be no match
            ends, play = _both_ways(search, ends, begin_at)
    tell("controller")
    left = settings.most_steps - sum(end.steps for end in ends)
    alone = best = _with_scenarios(search, ends[0], left, 1 if of_observer else settings.joint_rounds)
    if not of_observer:
        best, more = _restarted(search, best)
        gains = min((one for one in (gains, more) if one is not None), key=lambda one: one.penalised_cost, default=None)
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
    best = min(zip(stable, ends_now, strict=True), key=lambda one: (not one[0], one[1].penalised_cost))[1]
    return Found(
        search.values(best.x), best, tuple(end.judged.cost for end in ends), alone,
        keeps_all(search, best), gains, dict(search.failures), play,
    )  # fmt: skip


class BothWays(NamedTuple):
    """Values by name, SI, of the best controller that keeps beds with free play at rest, and of the best one without.

    ``kept`` is None where no controller was found that keeps them.
    """

    kept: dict[str, float] | None
    without: dict[str, float]


def _both_ways(
    search: Search, kept: list[SearchEnd], begins: list[np.ndarray]
) -> tuple[list[SearchEnd], BothWays | None]:  # fmt: skip
    """Where free play stands in the way of the errors: ends with and without beds that free play opens.

    Each way is begun at the end of the other one, so that the easier requirement never ends worse. What is delivered
    keeps the play, unless no controller does, or the errors without it are smaller by more than it is worth.
    """
    pools = search.leave_out_opened()
    without = [_followed(search, kept[0].x)]
    if not _is_good(search, without[0]):
        without += _from_starts(search, begins)[0]
    without = _best_first(search, without)
    unseen = search.see_again(pools)
    kept = _best_first(search, [*kept, _followed(search, without[0].x)])
    holds = not misses(search, kept[0])
    missed = _error_missed(kept[0]) if holds else np.inf
    if missed == 0:
        return kept, None
    ways = BothWays(search.values(kept[0].x) if holds else None, search.values(without[0].x))
    if (1 + missed) <= (1 + search.settings.play_is_worth) * (1 + _error_missed(without[0])):
        return kept, ways
    search.see_again(unseen)
    return without, ways


def _holds(search: Search, end: SearchEnd) -> bool:
    """Whether no requirement is missed, the errors included."""
    return not misses(search, end) and within_errors(search, end)


def _from_less_noise(search: Search, begins: list[np.ndarray]) -> list[SearchEnd]:
    """An end that keeps beds with free play, reached by homotopy in the noise of the sensors; none where it is not.

    The valley of controllers that keep them is wide where sensors are accurate and narrows with their noise. A search
    from afar misses it; one that begins in it, and goes on with more noise step by step, stays in it. So more accurate
    sensors never make an answer worse.
    """
    factor, settings = search.settings.less_noise, search.settings
    quiet = search.with_less_noise(factor)
    end = _from_starts(quiet, begins)[0][0]
    while _holds(quiet, end):
        if factor == 1:
            return [end]
        factor = max(1.0, factor / settings.noise_step)
        quiet = search.with_less_noise(factor)
        end = _followed(quiet, end.x)
    return []


def _followed(search: Search, x: np.ndarray) -> SearchEnd:
    """Where a search of an observer from a point (m,) ends, begun with the beds as planned alone."""
    search.see_planned_beds()
    return rounds(search, end_at(search, x), search.settings.rounds, search.settings.most_steps // 4)


def _best_first(search: Search, ends: Sequence[SearchEnd]) -> list[SearchEnd]:
    """The ends by what the search asks now, the best one first."""
    return sorted((judged_again(search, end) for end in ends), key=lambda end: end.penalised_cost)


def _error_missed(end: SearchEnd) -> float:
    """By how much, as a share of what is allowed, an error of the bed as planned is too large; 0 where none is."""
    return max(0.0, -float(end.judged.least_margins[-OF_ERRORS:].min()))


def _is_good(search: Search, end: SearchEnd) -> bool:
    """Whether an observer's search may end here."""
    return keeps_all(search, end) and within_errors(search, end) and end.judged.cost <= 1


def _restarted(search: Search, best: SearchEnd) -> tuple[SearchEnd, SearchEnd | None]:
    """The end of a feedback law's search, begun again from itself until that gains less than a round is worth.

    The gains are searched from several starts again, now with everything else as tuned: an end in a valley of the gains
    that belongs to the values as given is left that way. The second answer is the best end of gains alone.
    """
    settings, gains = search.settings, None
    for _ in range(settings.restarts if not _decided(search, best) else 0):
        begin = best
        points, gains = _with_gains(search, _starts(search, best.x))
        ends = [rounds(search, end_at(search, x), settings.joint_rounds, settings.most_steps // 4) for x in points]
        best = min((judged_again(search, one) for one in (begin, *ends)), key=lambda one: one.penalised_cost)
        before = judged_again(search, begin).penalised_cost
        if before - best.penalised_cost < max(settings.worth_a_round * before, settings.worth_at_all):
            break
    return best, gains


def _decided(search: Search, end: SearchEnd) -> bool:
    """Whether the search may end here, as only that there is such an end counts."""
    return search.settings.decides and keeps_all(search, end) and within_errors(search, end)


def is_stable(search: Search, x: np.ndarray) -> bool:
    """Whether the bed as planned and every bed of the pool are stable at a point (m,), also where they creep away."""
    return all(_is_stable(one, x) for one in search.members)


def _is_stable(search: SpeedSearch, x: np.ndarray) -> bool:
    _, poles = search.pool_poles(x)
    closed = [number for number in range(len(search.positions)) if number not in search.opened]
    planned = closed_poles(side_by_side([bed_of(search.hardware(x).case, {})]), search.controller(x))
    return all(stable_loops(z, search.neutral).all() for z in (planned, poles[closed]))


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
        best = min((judged_again(search, one) for one in (best, end)), key=lambda one: one.penalised_cost)
    return best


def _from_starts(search: Search, given: list[np.ndarray]) -> tuple[list[SearchEnd], SearchEnd | None]:
    """Where the starts ended, the best one first, and the best end of a feedback law's gains alone."""
    settings, of_observer = search.settings, search.case.loop.tunes_observer
    starts = [*given, *_starts(search)] if of_observer or not given else given
    ends: list[SearchEnd] = []
    most_rounds, most_steps, gains = settings.rounds, settings.most_steps // 4, None
    if not of_observer:
        (starts, gains), most_rounds = _with_gains(search, starts), settings.joint_rounds
    begins = [_anew(search, x) for x in starts]
    begins = _ranked(begins) if of_observer else begins
    search.see_planned_beds()
    for begin in begins[: min(settings.starts, OPENED.starts) if search.sees_opened else settings.starts]:
        ends.append(rounds(search, end_at(search, begin.x), most_rounds, most_steps))
        if of_observer and _is_good(search, ends[-1]):
            break
    # where play is seen, what stands in the way may be the play: that is tried before other starts are
    scatter = of_observer and settings.blind and not search.sees_opened
    if scatter and not any(keeps_all(search, end) and within_errors(search, end) for end in ends):
        for x in _scattered(search, _best_first(search, ends)[0].x)[: settings.followed]:
            ends.append(_followed(search, x))
            if _is_good(search, ends[-1]):
                break
    return _best_first(search, ends), gains


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
        if _decided(search, ends[-1]):
            break
    search.free = free
    best = min(ends, key=lambda end: end.penalised_cost)
    return ([best.x] if keeps_all(search, best) else [best.x, starts[0]]), best


def _starts(search: Search, about: np.ndarray | None = None) -> list[np.ndarray]:
    """Points (m,): the case's own, or one that is given, and others of the controller's quantities."""
    low, high = search.bounds()
    loop = search.case.loop
    begin = np.clip(search.begin() if about is None else about, low, high)
    if search.case.loop.tunes_observer:
        further = [
            {f"{CONTROLLER}{name}": value for name, value in values.items()}
            for values in loop.structure.starts(search.case.rig, loop)
        ]
        stated = [begin] if loop.states_weights or about is not None else []
        return [*stated, *(np.clip(search.begin(values), low, high) for values in further)]
    gains = np.array([one.name.startswith(CONTROLLER) for one in search.variables])
    if not gains.any():
        return [begin]
    return [begin, *(np.where(gains, low + part * (high - low), begin) for part in (MIDDLE, GENTLE))]


def _anew(search: Search, x: np.ndarray) -> SearchEnd:
    """A start judged with the beds alone that are least damped there."""
    search.see_planned_beds()
    return end_at(search, x)


def _ranked(begins: list[SearchEnd]) -> list[SearchEnd]:
    """First those that the search may end near, in their order; what a start misses says little of where it ends."""
    cheap = NEARLY_AS_CHEAP * min(begin.judged.cost for begin in begins)
    return sorted(begins, key=lambda begin: begin.judged.cost > max(cheap, 1.0))


def _scattered(search: Search, about: np.ndarray) -> list[np.ndarray]:
    """Settings scattered about an end (m,), by as much as a round may go, the best first.

    The requirements on drawn and opened beds leave several valleys, and a search from afar ends in one of them by
    chance; next to its end there may be a lower one, behind beds that are not stable.
    """
    low, high = search.bounds()
    parts = 2 * scipy.stats.qmc.Sobol(len(low), seed=0).random(search.settings.blind) - 1
    tried = np.clip(np.where(search.free, about + search.settings.furthest * parts, about), low, high)
    return sorted(tried, key=lambda x: search.judged(x).penalised_cost)
