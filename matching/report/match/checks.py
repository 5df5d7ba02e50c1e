"""Results of the verification of a match, in the form that figures, page and text use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from matching.frequency.search.result import MatchResult, TargetResult
from matching.frequency.verification.verify import Verification
from matching.report.common.wording import hertz, number, practical, unit
from matching.report.match.robustness_figure import Wrong
from matching.report.match.trace_figure import Signal

IDENTIFIED_WITHIN_PERCENT = 2  # of the vehicle's frequency; the identification itself is good to about 0.1 %
ROUNDING = 1e-6  # relative, by which a solution at a limit may miss it
PEAK_UNITS = {"torque": "N*m", "speed": "rad/s", "power": "W", "twist": "rad", "torque_over_speed": "1"}


@dataclass(frozen=True)
class Need:
    """Peak of a quantity in the manoeuvre, SI; ``limit`` is None where the case sets none."""

    what: str
    peak: float
    limit: float | None
    unit: str


@dataclass(frozen=True)
class ResultCheck:
    """One check of the result: what was checked, the outcome, whether it passed."""

    what: str
    outcome: str
    holds: bool


def signals(result: MatchResult) -> list[Signal]:
    """The simulated manoeuvre: compared sensors, then the dynamometers; empty where the motion diverged."""
    traces = result.verification.traces
    if traces is None:
        return []
    by_name = {sensor.name: sensor for sensor in result.case.vehicle.sensors}
    drawn = []
    for name in dict.fromkeys(pair.sensor for pair in result.case.compared):
        sources: Mapping[str, Any] = {"vehicle": traces.vehicle, "rig": traces.rig, "matched": traces.matched}
        curves = {who: readings[name] for who, readings in sources.items() if name in readings}
        sensor = by_name[name]
        label = f"{sensor.measures.capitalize()} in {unit(sensor.unit)}"
        drawn.append(Signal(name.replace("_", " ").capitalize(), label, traces.time, curves))
    for dyno in result.case.loop.dynamometers:
        for what in ("torque", "speed"):
            limit = result.case.limits.get(f"dynamometer_{what}")
            curves = {"matched": traces.matched[f"dynamometers.{dyno.name}.{what}"]}
            label = f"{what.capitalize()} in {unit(PEAK_UNITS[what])}"
            drawn.append(Signal(f"Dynamometer {dyno.name}, {what}", label, traces.time, curves, limit))
    return drawn


def in_time_signals(result: MatchResult) -> list[Signal]:
    """The compared sensors of the worst bed with everything wrong, beside its vehicle."""
    traces = result.in_time.traces
    if traces is None:
        return []
    by_name = {sensor.name: sensor for sensor in result.case.vehicle.sensors}
    drawn = []
    for name in result.in_time.sensors:
        sensor = by_name[name]
        curves = {"vehicle": traces.vehicle[name], "matched": traces.measured[name]}
        curves["unmeasured"] = traces.unmeasured[name]
        label = f"{sensor.measures.capitalize()} in {unit(sensor.unit)}"
        drawn.append(Signal(name.replace("_", " ").capitalize(), label, traces.time, curves))
    return drawn


def wrong_values(result: MatchResult) -> list[Wrong]:
    """The effect of single wrong values."""
    return [
        Wrong(wrong.name, _deviation(wrong), wrong.response_error, wrong.stable, wrong.modulus_margin)
        for wrong in result.verification.robustness
    ]


def needs(result: MatchResult) -> list[Need]:
    """Peaks of the manoeuvre: dynamometers, and shafts with a limit."""
    limits, peaks = result.case.limits, []
    for name, peak in result.verification.peaks.items():
        what = name.rsplit(".", 1)[1]
        is_dyno = name.startswith("dynamometers.")
        limit = limits.get(f"dynamometer_{what}" if is_dyno else name)
        if is_dyno or limit is not None:
            peaks.append(Need(name, peak, limit, PEAK_UNITS[what]))
    return peaks


def margin_counted_from(verification: Verification) -> str:
    """From where on the modulus margin counts, and what it is below; nothing where it counts everywhere."""
    if not verification.margin_from > 0:
        return ""
    winding, below = verification.winding, ""
    if winding is not None and winding.margin_frequency < verification.margin_from:
        least, at = number(winding.modulus_margin, 2), number(winding.margin_frequency, 3)
        below = f", where the loop follows the emulated modes: {least} at {at} Hz"
    return f" from {number(verification.margin_from, 3)} Hz on{below}"


def checks(result: MatchResult) -> list[ResultCheck]:
    """Every check with its outcome, stability first."""
    verification = result.verification
    rows = [ResultCheck(*_in_words(name, verification), holds) for name, holds in verification.checks.items()]
    limits = result.case.limits
    margin, (least, at) = verification.modulus_margin, verification.least_damping
    rows.append(
        ResultCheck(
            "Modulus margin of the feedback loop, exact dead time",
            f"{number(margin, 3)} at {number(verification.margin_frequency, 3)} Hz, "
            f"at least {number(limits['modulus_margin'])} required{margin_counted_from(verification)}",
            margin >= limits["modulus_margin"] * (1 - ROUNDING),
        )
    )
    rows.append(
        ResultCheck(
            "Smallest damping ratio of any mode of the loop",
            f"{number(least, 3)} at {number(at, 3)} Hz, at least {number(limits['damping_ratio'])} required",
            least >= limits["damping_ratio"] * (1 - ROUNDING),
        )
    )
    for target in result.targets:
        rows.append(
            ResultCheck(f"Mode {target.vehicle_mode} identified from the simulated manoeuvre", *_identified(target))
        )
    exceeded = [row for row in verification.violations if row.limit not in ("modulus_margin", "damping_ratio")]
    for violation in exceeded:
        si = PEAK_UNITS[violation.where.rsplit(".", 1)[1]]
        outcome = f"{practical(violation.value, si)}, {practical(violation.allowed, si)} allowed"
        rows.append(ResultCheck(f"Limit of {violation.where}", outcome, False))
    if not exceeded:
        rows.append(ResultCheck("Torque, twist, speed and power limits over the manoeuvre", "kept", True))
    return rows


def _identified(target: TargetResult) -> tuple[str, bool]:
    """Outcome of a mode's identification from the simulation, and whether it lies near enough to the vehicle's."""
    if target.identified is None:
        return "not identified", False
    deviation = round(100 * (target.identified / target.vehicle - 1), 2) + 0.0
    return f"{hertz(target.identified)} Hz, {deviation:+.2f} % from the vehicle", abs(
        deviation
    ) <= IDENTIFIED_WITHIN_PERCENT


def _in_words(name: str, verification: Verification) -> tuple[str, str]:
    """A check of the verification in words, and its outcome."""
    if name.startswith("poles, order "):
        order = int(name.rsplit(" ", 1)[1])
        poles = next(row for row in verification.approximations if row.order == order)
        return f"Poles of the feedback loop, dead time by a Padé approximation of order {order}", (
            f"rightmost at {number(poles.abscissa, 3)} 1/s"
        )
    if name == "Nyquist criterion" and verification.winding is not None:
        count = verification.winding.unstable
        return "Nyquist criterion with the exact dead time", "met" if count == 0 else f"{number(count)} unstable poles"
    if name == "sampled loop":
        return (
            "Poles of the sampled loop",
            f"largest magnitude {number(max(abs(verification.sampled)), 5)}, below 1 is stable",
        )
    if name == "feed-forward poles":
        return "Poles of the model-based feed-forward", (
            f"rightmost at {number(max(verification.feed_forward_poles.real), 3)} 1/s"
        )
    if name == "simulation":
        outcome = "diverges" if verification.traces is None else "stays bounded"
        return "Simulated manoeuvre with delay line and sampled controller", outcome
    if name == "dynamic stiffness":
        return "Nyquist criterion by a second method, from the dynamic stiffness", (
            f"{number(verification.independent.unstable_poles)} unstable poles"
            if verification.independent.unstable_poles
            else "met"
        )
    return name.capitalize(), ""


def _deviation(wrong: Any) -> str:
    """The wrong value's deviation: relative, of the dead time in ms."""
    is_time = wrong.name == "loop.dead_time"
    text = practical(wrong.change, "s", 2) if is_time else f"{number(100 * wrong.change, 2)} %"
    return f"+{text}" if wrong.change > 0 else text
