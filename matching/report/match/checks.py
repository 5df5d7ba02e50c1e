"""What the verification of a match saw, in the form that figures, page and text use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from matching.frequency.search.result import MatchResult
from matching.report.common.wording import hertz, number, practical, unit
from matching.report.match.robustness_figure import Wrong
from matching.report.match.trace_figure import Signal

PEAK_UNITS = {"torque": "N*m", "speed": "rad/s", "power": "W", "twist": "rad"}


@dataclass(frozen=True)
class Need:
    """What the manoeuvre takes of something, SI; ``limit`` None where the case sets none."""

    what: str
    peak: float
    limit: float | None
    unit: str


@dataclass(frozen=True)
class Check:
    """One check of the result: what was looked at, what came out, whether it holds."""

    what: str
    outcome: str
    holds: bool


def signals(result: MatchResult) -> list[Signal]:
    """The simulated manoeuvre: compared sensors, then what the dynamometers do; empty where the motion ran away."""
    traces = result.verification.traces
    if traces is None:
        return []
    by_name = {sensor.name: sensor for sensor in result.case.vehicle.sensors}
    found = []
    for name in dict.fromkeys(pair.sensor for pair in result.case.compared):
        sources: Mapping[str, Any] = {"vehicle": traces.vehicle, "rig": traces.rig, "matched": traces.matched}
        curves = {who: own[name] for who, own in sources.items() if name in own}
        sensor = by_name[name]
        label = f"{sensor.measures.capitalize()} in {unit(sensor.unit)}"
        found.append(Signal(name.replace("_", " ").capitalize(), label, traces.time, curves))
    for dyno in result.case.loop.dynamometers:
        for what in ("torque", "speed"):
            limit = result.case.limits.get(f"dynamometer_{what}")
            curves = {"matched": traces.matched[f"dynamometers.{dyno.name}.{what}"]}
            label = f"{what.capitalize()} in {unit(PEAK_UNITS[what])}"
            found.append(Signal(f"Dynamometer {dyno.name}, {what}", label, traces.time, curves, limit))
    return found


def wrong_values(result: MatchResult) -> list[Wrong]:
    """What one wrong value does."""
    return [
        Wrong(own.name, _off(own), own.response_error, own.stable, own.modulus_margin)
        for own in result.verification.robustness
    ]


def needs(result: MatchResult) -> list[Need]:
    """Peaks of the manoeuvre: dynamometers, and shafts with a limit."""
    limits, found = result.case.limits, []
    for name, peak in result.verification.peaks.items():
        what = name.rsplit(".", 1)[1]
        is_dyno = name.startswith("dynamometers.")
        limit = limits.get(f"dynamometer_{what}" if is_dyno else name)
        if is_dyno or limit is not None:
            found.append(Need(name, peak, limit, PEAK_UNITS[what]))
    return found


def checks(result: MatchResult) -> list[Check]:
    """Every check with its outcome, stability first."""
    seen = result.verification
    found = [Check(*_said(name, seen), holds) for name, holds in seen.checks.items()]
    limits = result.case.limits
    margin, (least, at) = seen.modulus_margin, seen.least_damping
    found.append(
        Check(
            "Modulus margin of the feedback loop, exact dead time",
            f"{number(margin, 3)} at {number(seen.margin_frequency, 3)} Hz, "
            f"at least {number(limits['modulus_margin'])} asked",
            margin >= limits["modulus_margin"] * (1 - 1e-6),
        )
    )
    found.append(
        Check(
            "Smallest damping ratio of any mode of the loop",
            f"{number(least, 3)} at {number(at, 3)} Hz, at least {number(limits['damping_ratio'])} asked",
            least >= limits["damping_ratio"] * (1 - 1e-6),
        )
    )
    for target in result.targets:
        off = None if target.seen is None else round(100 * (target.seen / target.vehicle - 1), 2) + 0.0
        said = (
            "not seen in the simulation" if off is None else f"{hertz(target.seen)} Hz, {off:+.2f} % from the vehicle"
        )
        near = off is not None and abs(off) <= 2
        found.append(
            Check(f"Mode {target.vehicle_mode} read off the simulated manoeuvre", said.replace("-", "−"), near)
        )
    broken = [own for own in seen.violations if own.limit not in ("modulus_margin", "damping_ratio")]
    for own in broken:
        si = PEAK_UNITS[own.where.rsplit(".", 1)[1]]
        outcome = f"{practical(own.value, si)}, {practical(own.allowed, si)} allowed"
        found.append(Check(f"Limit of {own.where}", outcome, False))
    if not broken:
        found.append(Check("Torque, twist, speed and power limits over the manoeuvre", "kept", True))
    return found


def _said(name: str, seen: Any) -> tuple[str, str]:
    """A check in words, and its figure."""
    if name.startswith("poles, order "):
        order = int(name.rsplit(" ", 1)[1])
        own = next(one for one in seen.approximations if one.order == order)
        return f"Poles of the feedback loop, dead time by a Padé approximation of order {order}", (
            f"rightmost at {number(own.abscissa, 3)} 1/s"
        )
    if name == "encirclements":
        count = seen.winding.unstable
        return "Encirclements of −1 by the exact loop", (
            "none that should not be" if count == 0 else f"{number(count)} unstable poles"
        )
    if name == "sampled loop":
        return (
            "Poles of the loop as it is sampled",
            f"largest amount {number(max(abs(seen.sampled)), 5)}, below 1 is stable",
        )
    if name == "twin":
        return "Poles of the twin's own loop", f"rightmost at {number(max(seen.feed_forward_poles.real), 3)} 1/s"
    if name == "simulation":
        outcome = "runs away" if seen.traces is None else "stays bounded"
        return "Simulated manoeuvre, true delay line, sampled controller", outcome
    return name.capitalize(), ""


def _off(own: Any) -> str:
    shown = practical(own.change, "s", 2) if own.name == "loop.dead_time" else f"{number(100 * own.change, 2)} %"
    return f"+{shown}" if own.change > 0 else shown
