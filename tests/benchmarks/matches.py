"""What matches reach over dead times, drawn and neighbouring cases and seeds: `python -m tests.benchmarks.matches`.

Parts, of which any may be named: ``contributions`` (with dead times in ms, 1 3 5 8 12 unless given), ``orders``,
``neighbours``, ``seeds`` (with how many: 20, 12, 10 unless given). Each prints a row as
soon as it is there; all of them take about an hour of one core.
"""

import sys
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import rigmatch as rm
from matching.match.case import Case, apply
from matching.match.case_file import load_case
from matching.match.objective import Search, search_for
from matching.match.order import Delivered, Fresh, _held, _rank, ordered
from matching.match.problem import problem_of
from matching.match.rounds import end_at
from matching.match.search import Found, solve
from matching.match.variables import SearchSettings
from modelling.bed.controllers import STRUCTURES
from tests.match.drawn import draw

EXAMPLES = Path(__file__).parents[2] / "examples"
DEAD_TIMES_MS = (1.0, 3.0, 5.0, 8.0, 12.0)
FRESH = 2000  # beds that judge the rows which tests/evidence.md shows
COMPARED = 400  # beds that judge a comparison; none of them was seen by search or order
OTHER_SEED = 1000  # of these beds
PARTS = ("loop.", "residual_vehicle.", "rig.")
ROWS = PARTS[:1], PARTS, PARTS[:2], PARTS[::2], PARTS[1:2], PARTS[2:], PARTS[1:]  # what may move in each row


def reference(dead_time: float) -> Case:
    """The reference with ``observer`` at a dead time, s; everything under [move] of case.toml may move."""
    case = load_case(EXAMPLES / "road_to_rig" / "observer.toml")
    moves = load_case(EXAMPLES / "road_to_rig" / "case.toml").moves
    return apply(replace(case, moves=moves), {"loop.dead_time": dead_time})


@dataclass(frozen=True)
class Solved:
    """A search and where it ended."""

    search: Search
    found: Found


def solved(case: Case, parts: Sequence[str] = PARTS) -> Solved:
    """The search where only some parts may move; a controller that is none of them is fixed."""
    moves = tuple(move for move in case.moves if move.name.startswith(tuple(parts)))
    case = replace(case, moves=moves, loop=replace(case.loop, fixed="loop." not in parts))
    problem = problem_of(case)
    asked = problem.demands if not problem.beyond else replace(problem.demands, limits={})
    search = search_for(case, problem.moves, problem.shares, asked, SearchSettings())
    return Solved(search, solve(search))


def row(name: str, one: Delivered) -> str:
    """Errors as planned, medians and 95 % of the stable fresh beds, how many are stable and damped."""
    found = one.verdicts
    assert found is not None
    stable = found.stable[:-1]
    figures = [found.measured[-1], found.unmeasured[-1]]
    for errors in (found.measured, found.unmeasured):
        figures += np.quantile(errors[:-1][stable], (0.5, 0.95)).tolist() if stable.any() else [np.nan, np.nan]
    texts = " ".join(f"{value:8.4f}" for value in figures)
    damped = int((found.stable & found.damped)[:-1].sum())
    return (
        f"{name:44s} {texts}  stable {stable.sum()}, damped {damped} of {len(stable)}, "
        f"least damping {found.damping_ratio.min():.4f}, keeps all {one.keeps_all}"
    )


def moved(one: Solved) -> Iterator[str]:
    """What moved of residual vehicle and rig, by how much, the cost, and the share of a target mode's energy."""
    search, x = one.search, one.found.end.x
    shares = problem_of(search.case).shares
    for variable, place in zip(search.variables, x, strict=True):
        if not variable.name.startswith("loop."):
            value, planned = variable.value(place), variable.move.planned
            change = (place - variable.at(planned)) / variable.span
            cost = search.settings.weight_change * variable.weight * change**2
            yield (
                f"    {variable.name}: {planned:.4g} -> {value:.4g} ({value / planned - 1:+.1%}), cost {cost:.2g} of "
                f"{one.found.end.judged.cost:.3g}, energy {shares[variable.name]:.1%}"
            )
    stayed = (
        {move.name for move in search.case.moves} - set(search.names) - {f"loop.{n}" for n in search.case.loop.values}
    )
    if stayed:
        yield f"    stayed: {', '.join(sorted(stayed))}"


def contributions(dead_times: Sequence[float], rows: Sequence[Sequence[str]] = ROWS) -> None:
    """What controller, residual vehicle and adapters contribute at dead times in ms, alone and together."""
    for milliseconds in dead_times:
        for parts in rows:
            one = solved(reference(1e-3 * milliseconds), parts)
            count = FRESH if parts in (PARTS, PARTS[:1]) else COMPARED
            if parts == PARTS[1:2]:
                given = end_at(one.search, one.search.begin())
                print(row(f"{milliseconds:g} ms, nothing", Fresh(COMPARED, 0).delivered(one.search, given)), flush=True)
            name = f"{milliseconds:g} ms, {' '.join(part.rstrip('.') for part in parts)}"
            print(row(name, Fresh(count, 0).delivered(one.search, one.found.end)), flush=True)
            for text in moved(one):
                print(text, flush=True)


def orders(count: int = 20) -> None:
    """Planned against ordered over drawn cases, every structure, on beds that neither search nor order saw."""
    worse = 0
    for seed in range(count):
        with TemporaryDirectory() as place:
            case = load_case(draw(seed, Path(place)))
        if seed % 3 == 2:
            case = replace(case, loop=replace(case.loop, structure=STRUCTURES["observer"], values={
                **{name: known.start for name, known in STRUCTURES["observer"].quantities.items()}, **case.loop.values
            }))  # fmt: skip
        one, judges = solved(case), Fresh(COMPARED, OTHER_SEED)
        search, found, fresh = one.search, one.found, Fresh(SearchSettings().fresh, 0)
        planned = {
            i: variable.at(variable.move.planned)
            for i, variable in enumerate(search.variables) if variable.name.startswith("rig.")
        }  # fmt: skip
        if not planned:
            print(f"{seed}: no adapter quantity is released", flush=True)
            continue
        held = min((_held(search, fresh, end, planned) for end in (found.controller_alone, found.end)), key=_rank)
        worth = found.keeps_all and found.end.judged.cost <= search.settings.hopeless
        x = ordered(search, found, fresh).x if worth else found.end.x
        search.free = np.ones(len(search.variables), bool)
        as_planned, as_ordered = (judges.delivered(search, end_at(search, at)) for at in (held.end.x, x))
        both = np.isfinite(as_planned.errors) & np.isfinite(as_ordered.errors)
        gained = as_planned.errors[both] - as_ordered.errors[both]
        scatter = 2 * float(gained.std() / np.sqrt(max(len(gained), 1)))
        lost = int(np.isfinite(as_planned.errors).sum() - np.isfinite(as_ordered.errors).sum())
        bad = bool(lost > 0 or (len(gained) and gained.mean() < -scatter))
        worse += bad
        changed = [
            f"{search.variables[i].name} {search.variables[i].value(x[i]):.4g}" for i in planned if x[i] != planned[i]
        ]
        name = f"{seed} {case.loop.structure.name} {1e3 * case.loop['dead_time']:.1f} ms"
        gain = f"{gained.mean():.4f} ± {scatter:.4f}" if len(gained) else "none"
        print(
            f"{name}: planned {as_planned.error:.4f}, ordered {as_ordered.error:.4f}, gain {gain}, beds lost {lost}, "
            f"order {', '.join(changed) or 'nothing'}{' WORSE' if bad else ''}", flush=True,
        )  # fmt: skip
    print(f"worse: {worse}", flush=True)


def starter() -> Case:
    """The case that ``rigmatch new`` writes."""
    with TemporaryDirectory() as place:
        rm.new(Path(place) / "new")
        return load_case(Path(place) / "new" / "case.toml")


def neighbours(count: int = 12) -> None:
    """Delivered errors over flange stiffnesses of the starter case, against a parabola in logarithms."""
    case, stiffness, errors = starter(), np.geomspace(2e5, 8e5, count), []
    for value in stiffness:
        moves = tuple(move for move in case.moves if not move.name.startswith("rig."))
        one = solved(apply(replace(case, moves=moves), {"rig.shafts.flange.stiffness": float(value)}))
        judged = Fresh(COMPARED, OTHER_SEED).delivered(one.search, one.found.end)
        errors.append(judged.error)
        print(row(f"{value:.4g} N·m/rad, error {judged.error:.4f}", judged), flush=True)
    x, y = np.log(stiffness), np.log(errors)
    off = np.exp(y - np.polyval(np.polyfit(x, y, 2), x)) - 1
    print("off the curve:", ", ".join(f"{value:+.1%}" for value in off), flush=True)


def seeds(count: int = 10) -> None:
    """Seeds of the beds that decide on the order of the starter case; errors on the same other beds."""
    begun, errors = solved(starter()), []
    for seed in range(count):
        one = deepcopy(begun)  # an order has the search see further beds
        x = ordered(one.search, one.found, Fresh(SearchSettings().fresh, seed)).x
        judged = Fresh(FRESH, OTHER_SEED).delivered(one.search, end_at(one.search, x))
        errors.append(judged.error)
        print(f"seed {seed}: {judged.error:.5f}", flush=True)
    print(f"largest over smallest: {max(errors) / min(errors) - 1:.2%}", flush=True)


COMMANDS = {"orders": orders, "neighbours": neighbours, "seeds": seeds}

if __name__ == "__main__":
    names = sys.argv[1:] or ["contributions", *COMMANDS]
    given = tuple(float(name) for name in names if name.replace(".", "").isdigit())
    for name in names:
        if name == "contributions":
            contributions(given or DEAD_TIMES_MS)
        elif name in COMMANDS:
            COMMANDS[name](*(int(number) for number in given[:1]))
