"""What a report begins with: what to order, to enter and to watch, each with its reason."""

from __future__ import annotations

from matching.frequency.search.result import MatchResult, ParameterResult
from matching.report.common.screen_point import ScreenPoint
from matching.report.common.wording import amount, component, number, percent, sentence, spaced
from matching.report.match.checks import checks, needs, wrong_values

SAME_RELATIVE = 1e-9  # values that differ by no more count as equal
MOST_POINTS = 4  # of a list on the first screen


def adapters_of(result: MatchResult) -> list[ParameterResult]:
    """Quantities of the rig that were allowed to move."""
    return [row for row in result.parameters if row.name.startswith("rig.")]


def traded_before_beds(result: MatchResult) -> bool:
    """Whether the gains were tuned over drawn beds after the adapters: errors of the trade are then not the match's."""
    after = result.response_error.unmeasured
    return any(abs(trade.error_as_ordered - after) > SAME_RELATIVE * after for trade in result.adapters)


def to_order(result: MatchResult) -> list[ScreenPoint]:
    """Adapters, and whether the dynamometers suffice."""
    adapters = adapters_of(result)
    changed = [row for row in adapters if abs(row.tuned - row.start) > SAME_RELATIVE * abs(row.start)]
    points = [
        ScreenPoint(
            f"{component(row.name)}: {amount(row.tuned, row.unit)} instead of {amount(row.start, row.unit)}",
            "at the bound that the case sets" if row.at_bound else "",
        )
        for row in changed[:MOST_POINTS]
    ]
    gain = next((trade for trade in result.adapters if trade.error_all_as_planned is not None), None)
    if changed and gain is not None and gain.error_all_as_planned is not None:
        before = ", before the gains were tuned over drawn beds" if traded_before_beds(result) else ""
        reason = (
            f"for unmeasured torques the response error is then {number(gain.error_as_ordered, 2)} instead of "
            f"{number(gain.error_all_as_planned, 2)} with the bed as planned{before}"
        )
        points[-1] = ScreenPoint(points[-1].text, "; ".join(filter(None, (points[-1].reason, reason))))
    if not points:
        helps = "no change of them helps" if adapters else "none was allowed to change"
        points = [ScreenPoint("adapters as planned", helps)]
    return [*points, *_dynamometers(result)]


def _dynamometers(result: MatchResult) -> list[ScreenPoint]:
    """Whether the dynamometers, where the case limits them, do what the manoeuvre needs."""
    shares = {
        need.what: need.peak / need.limit
        for need in needs(result)
        if need.limit and need.what.startswith("dynamometers.")
    }
    if not shares:
        return []
    most = max(shares, key=lambda what: shares[what])
    enough = "dynamometers as planned" if shares[most] <= 1 else "larger dynamometers"
    what = spaced(most.rpartition(".")[2])
    return [
        ScreenPoint(
            enough, f"the manoeuvre takes {percent(shares[most], 0)} of their {what}, the limit that it comes nearest"
        )
    ]


def to_enter(result: MatchResult) -> list[ScreenPoint]:
    """The controller's values, each with what it is."""
    loop = result.tuned.loop
    return [
        ScreenPoint(f"{spaced(name)} {amount(loop[name], known.unit, 5)}", known.meaning)
        for name, known in loop.structure.quantities.items()
    ]


def why_these_values(result: MatchResult) -> str:
    """What the values to enter are the best of."""
    limits, band = result.case.limits, result.response_error.band
    margin = f"the modulus margin stays above {number(limits['modulus_margin'], 3)}"
    if result.robust and result.case.loop.structure.is_observer:
        drawn = result.robust.beds.drawn
        return (
            f"Tuned for the least response error to unmeasured torques, {number(band[0])} to {number(band[1])} Hz, "
            f"over beds drawn within [uncertainty]; {margin} above the emulated band, the loop rolls off, and sensor "
            f"noise stays within its limit. Judged on {drawn} fresh beds."
        )
    counted_from = result.verification.margin_from
    counted = f" from {number(counted_from, 3)} Hz on" if counted_from > 0 else ""
    return f"Tuned for the least response error, {number(band[0])} to {number(band[1])} Hz, while {margin}{counted}."


def measured_inputs(result: MatchResult) -> list[str]:
    """Compared inputs whose torque the controller takes as measured."""
    loop = result.tuned.loop
    simulated = [source.name for part in result.tuned.residual_vehicle.parts for source in part.inputs]
    measured = loop.structure.measured_inputs(loop.measured, simulated)
    return [name for name in dict.fromkeys(pair.input for pair in result.case.compared) if name in measured]


def to_watch(result: MatchResult) -> list[ScreenPoint]:
    """What limits the match or may spoil it, most important first."""
    points = [ScreenPoint(limit) for limit in result.limits[1:]]
    points += [ScreenPoint(f"check failed: {check.what}", check.outcome) for check in checks(result) if not check.holds]
    points += _of_beds(result)
    error = result.response_error
    if measured_inputs(result):
        points.append(
            ScreenPoint(
                f"response error {number(error.after, 2)} for measured torques, {number(error.unmeasured, 2)} for "
                "unmeasured ones",
                "an unmeasured torque is known only by what it does"
                + (", as the observer estimates it" * result.case.loop.structure.is_observer),
            )
        )
    wrong = wrong_values(result)
    unstable = [f"{row.name} {row.off}" for row in wrong if not row.stable]
    if unstable:
        points.append(
            ScreenPoint(f"the loop becomes unstable with {sentence(unstable[:MOST_POINTS])}", "the rest as planned")
        )
    known = [row for row in wrong if row.stable and row.error is not None]
    worst = max(known, key=lambda row: row.error or 0.0, default=None)
    if worst is not None and (worst.error or 0.0) > error.after:
        reason = f"{worst.off} makes the response error {number(worst.error, 2)}, more than any other quantity does"
        points.append(ScreenPoint(f"{component(worst.name)} must be known best", reason))
    return points[:MOST_POINTS] or [ScreenPoint("nothing", "every check passed")]


def _of_beds(result: MatchResult) -> list[ScreenPoint]:
    """The worst bed of the box, where it is damped by less than is required."""
    beds = result.robust.beds if result.robust else None
    if beds is None or beds.worst is None or not 0 < beds.worst.damping_ratio < beds.required_damping:
        return []
    return [
        ScreenPoint(
            f"the worst bed within [uncertainty] is stable with a least damping ratio of "
            f"{number(beds.worst.damping_ratio, 2)}, {number(beds.required_damping, 2)} is required",
            f"it depends most on {sentence([component(name) for name in beds.worst.named])}",
        )
    ]
