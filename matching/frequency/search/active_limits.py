"""Which fixed quantities are released because a limit is active; the targets alone are too insensitive to them."""

from __future__ import annotations

from collections.abc import Sequence

from matching.frequency.case.case import Case, Move
from matching.frequency.case.demands import Demands
from matching.frequency.search.infeasible_limits import unkept

ACTIVE_FROM = 0.999  # of a limit: from this demand on it shapes the solution


def needed_to_keep(case: Case, free: Sequence[Move], asked: Demands) -> dict[str, str]:
    """Names of fixed moves, each with a limit on it that no setting of the free ones keeps."""
    out_of_reach = {limit for _, limit, _, _ in unkept(case, free, asked)}
    names = {name for move in free for name in move.together}
    for limit in [exceeded.limit for exceeded in asked.broken(_of_rig(case))]:
        if not names & asked.quantities(limit):
            out_of_reach.add(limit)
    return _fixed_behind(case, free, asked, out_of_reach)


def needed_for_more(case: Case, free: Sequence[Move], asked: Demands, tuned: Case) -> dict[str, str]:
    """Names of fixed moves, each with a limit on it that shapes the solution."""
    binding = {exceeded.limit for exceeded in asked.broken(_of_rig(tuned), ACTIVE_FROM)}
    return _fixed_behind(case, free, asked, binding)


def _of_rig(case: Case) -> dict[str, float]:
    return {f"rig.{name}": quantity.value for name, quantity in case.rig.parameters.items()}


def _fixed_behind(case: Case, free: Sequence[Move], asked: Demands, limits: set[str]) -> dict[str, str]:
    released: dict[str, str] = {}
    for limit in sorted(limits):
        behind = asked.quantities(limit)
        for move in case.moves:
            if move not in free and behind & set(move.together):
                released.setdefault(move.name, limit)
    return released
