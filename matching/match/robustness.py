"""What beds and loop of a match do not keep: what limits it, and what is only noted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from matching.match.beds import BedsCheck, quantile
from matching.match.case import Case
from matching.match.findings import Finding
from matching.match.free_play import OpenLash
from matching.match.verify import Verification


def of_beds(robust: Verification) -> BedsCheck:
    """The fresh beds of a verification that has them."""
    assert robust.beds is not None, "beds were drawn"
    return robust.beds


def not_kept(case: Case, robust: Verification, play: OpenLash | None = None) -> list[Finding]:
    """What makes a match limited; the requirements are the same for every control structure.

    ``play`` is what beds with free play do in time, None where it was not simulated: then a bed that is not stable with
    softer cut shafts counts as one that may swing on.
    """
    return [
        *_unstable(robust),
        *_error("measured torques", robust.errors.after, case.tolerance),
        *_error("unmeasured torques", robust.errors.unmeasured, case.unmeasured_tolerance),
        *_damped_too_little(robust),
        *_slow_feed_forward(robust),
        *_worst_bed(robust, stable=False),
        *_loop(robust),
        *(_free_play(robust, play) if robust.required.opened_shafts else []),
    ]


@dataclass(frozen=True)
class DrawnBedsSettings:
    """When drawn beds are worth a sentence though they limit nothing.

    Attributes
    ----------
    few : float
        Share of the drawn beds beyond an error that is asked of the bed as planned, up to which nothing is said: one
        bed in twenty.
    """

    few: float = 0.05


DRAWN_BEDS = DrawnBedsSettings()


def noted(
    case: Case, robust: Verification, play: OpenLash | None = None, settings: DrawnBedsSettings = DRAWN_BEDS
) -> list[Finding]:
    """What does not limit a match: errors of drawn beds, a worst bed that is damped too little, free play that does not
    swing on in time."""
    found, beds = [], of_beds(robust)
    for what, errors, allowed in (
        ("measured torques", beds.measured, case.tolerance),
        ("unmeasured torques", beds.unmeasured, case.unmeasured_tolerance),
    ):
        beyond = beds.drawn - int(np.searchsorted(errors, allowed, side="right"))
        most = quantile(errors, 0.95)
        if most is not None and beyond > settings.few * beds.drawn:
            found.append(Finding("beds_error", most, allowed, where=what, beds=(beyond, beds.drawn), limits=False))
    found += _worst_bed(robust, stable=True)
    if not robust.required.opened_shafts:
        if case.loop.structure.is_observer or play is not None:
            found += [replace(one, limits=False) for one in _free_play(robust, play)]
    elif play is not None and not play.limit_cycles and _opened(robust):
        found.append(replace(_played(robust, play), limits=False))
    return found


def _unstable(robust: Verification) -> list[Finding]:
    beds = of_beds(robust)
    if beds.stable == beds.drawn:
        return []
    return [Finding("beds_not_stable", beds=(beds.drawn - beds.stable, beds.drawn))]


def _damped_too_little(robust: Verification) -> list[Finding]:
    """Every mode that is damped too little on stable beds: where, whose, on how many."""
    beds = of_beds(robust)
    return [
        Finding(
            "beds_damping", fault.mode.damping_ratio, fault.mode.asked, where=fault.mode.words(),
            beds=(fault.beds, beds.drawn),
        )
        for fault in beds.faults
    ]  # fmt: skip


def _slow_feed_forward(robust: Verification) -> list[Finding]:
    """That the model which runs on known torques rings on longer than the vehicle; it is the same on every bed."""
    slowest, asked = robust.slowest_own, robust.required.decay_rate
    if slowest is None or slowest.rate >= asked:
        return []
    return [Finding("slow_feed_forward", slowest.rate, asked, "1/s", f"{slowest.frequency:.3g} Hz")]


def _worst_bed(robust: Verification, *, stable: bool) -> list[Finding]:
    """The worst bed of the box where it is not stable, or is stable and damped too little."""
    worst = of_beds(robust).worst
    if worst is None:
        return []
    data, mode = {"depends_on": ", ".join(worst.named)}, worst.mode
    if not stable:
        return [Finding("worst_bed", worst.damping_ratio, data=data)] if worst.damping_ratio <= 0 else []
    if mode is None or not 0 < worst.damping_ratio < mode.asked:
        return []
    return [Finding("worst_bed", worst.damping_ratio, mode.asked, where=mode.words(), limits=False, data=data)]


# Whether free play makes a bed swing on is decided in time, on nonlinear beds with play. That the bed as planned is
# stable with every share of its cut shafts' stiffness is what a search can ask for (describing function). It is not
# necessary, since a swing passes through the shares at which it would grow faster than it grows there; and it is not
# sufficient, since drawn beds have other shares, and a command at its limit of torque is less gain than the share says.


def _free_play(robust: Verification, play: OpenLash | None) -> list[Finding]:
    """That free play in the cut shafts makes beds swing on; that it may, where it was not simulated."""
    if play is None:
        return [_played(robust, play)] if _opened(robust) else []
    return [_played(robust, play)] if play.limit_cycles else []


def _played(robust: Verification, play: OpenLash | None) -> Finding:
    asked, softer = robust.required.opened_shafts, "; ".join(_opened(robust))
    if play is None:
        return Finding("free_play", data={"in_time": False, "not_stable": softer, "asked": asked})
    return Finding(
        "free_play", play.largest_swing, play.vehicle_swing, "N·m", beds=(play.limit_cycles, play.drawn),
        data={"in_time": True, "not_stable": softer, "asked": asked, "words": play.words()},
    )  # fmt: skip


def _opened(robust: Verification) -> list[str]:
    """At which shares of the cut shafts' stiffness the bed as planned is not stable; empty where at none."""
    beds = of_beds(robust)
    ways = {"its cut shafts": beds.opened}
    if len(beds.opened_alone) > 1:
        ways |= {f"the cut shaft {shaft} alone": opened for shaft, opened in beds.opened_alone.items()}
    for shafts, opened in ways.items():
        unstable = [share for share, ratio in opened.items() if ratio <= 0]
        if unstable:
            few = ", ".join(f"{share:.3g}" for share in unstable)
            shares = few if len(unstable) < 3 else f"{min(unstable):.3g} to {max(unstable):.3g}"
            return [f"the bed as planned is not stable with {shares} times the stiffness and damping of {shafts}"]
    return []


def _error(what: str, value: float | None, allowed: float) -> list[Finding]:
    if value is None or value <= allowed:
        return []
    return [Finding("response_error", value, allowed, where=what)]


def _loop(robust: Verification) -> list[Finding]:
    """Roll-off, noise and offsets."""
    loop, required = robust.loop, robust.required
    found = []
    if loop.largest_rolled_off > required.rolled_off:
        where = f"{required.rolled_off_from:g} Hz"
        found.append(Finding("roll_off", loop.largest_rolled_off, required.rolled_off, where=where))
    for cause, figures, allowed in (
        ("command_noise", loop.command_noise, required.command_noise),
        ("sensor_offset", loop.unexpected_torque, required.sensor_offset),
    ):
        if worst := _worst_share(figures, allowed):
            found.append(Finding(cause, worst[1], worst[2], "N·m", worst[0]))
    return found


def _worst_share(figures: Mapping[str, float], allowed: Sequence[float]) -> tuple[str, float, float] | None:
    """The dynamometer whose figure is most above what is allowed of it, with both; None where none is above."""
    above = [(value / most, name, value, most) for (name, value), most in zip(figures.items(), allowed)]
    share, name, value, most = max(above, default=(0.0, "", 0.0, 0.0))
    return (name, value, most) if share > 1 else None
