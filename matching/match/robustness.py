"""What beds and loop of a match do not keep: sentences that limit it, and sentences that are only noted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matching.match.beds import BedsCheck, quantile
from matching.match.case import Case
from matching.match.free_play import OpenLash
from matching.match.opened import WAIVED
from matching.match.verify import Verification


def of_beds(robust: Verification) -> BedsCheck:
    """The fresh beds of a verification that has them."""
    assert robust.beds is not None, "beds were drawn"
    return robust.beds


def not_kept(case: Case, robust: Verification, play: OpenLash | None = None) -> list[str]:
    """Sentences on what makes a match limited; the requirements are the same for every control structure.

    ``play`` is what beds with free play do in time, None where it was not simulated: then a bed that is not stable with
    softer cut shafts counts as one that may swing on.
    """
    return [
        *_unstable(robust),
        *_error("measured torques", robust.errors.after, case.tolerance),
        *_error("unmeasured torques", robust.errors.unmeasured, case.unmeasured_tolerance),
        *_damped_too_little(robust),
        *_slow_feed_forward(robust),
        *_unstable_worst_bed(robust),
        *_loop(robust),
        *(_swings_on(robust, play) if robust.required.opened_shafts else []),
    ]


def noted(case: Case, robust: Verification, play: OpenLash | None = None) -> list[str]:
    """Sentences on what does not limit a match: errors of drawn beds, a worst bed that is damped too little, free play
    that does not swing on in time."""
    sentences, beds = [], of_beds(robust)
    for what, errors, allowed in (
        ("measured", beds.measured, case.tolerance), ("unmeasured", beds.unmeasured, case.unmeasured_tolerance),
    ):  # fmt: skip
        median = quantile(errors, 0.5)
        if median is not None and median > allowed:
            sentences.append(
                f"half of the drawn beds have a response error to {what} torques of {median:.3f} or more, {allowed:g} "
                "is allowed of the bed as planned"
            )
    worst = beds.worst
    if worst is not None and worst.mode is not None and 0 < worst.damping_ratio < worst.mode.asked:
        sentences.append(
            f"the worst bed within [uncertainty] is stable; its mode at {worst.mode.words()} has a damping ratio of "
            f"{worst.damping_ratio:.4f}, {100 * worst.damping_ratio / worst.mode.asked:.0f} % of the "
            f"{worst.mode.asked:.4f} that this mode needs on drawn beds; it depends most on {', '.join(worst.named)}"
        )
    if not robust.required.opened_shafts:
        sentences += _swings_on(robust, play) if case.loop.structure.is_observer or play is not None else []
    elif play is not None and not play.limit_cycles:
        sentences += [f"{softer}; in time {play.words()}" for softer in _opened(robust)]
    return sentences


def _unstable(robust: Verification) -> list[str]:
    beds = of_beds(robust)
    if beds.stable == beds.drawn:
        return []
    return [f"{beds.drawn - beds.stable} of {beds.drawn} beds drawn within [uncertainty] are not stable"]


def _damped_too_little(robust: Verification) -> list[str]:
    """A sentence for every mode that is damped too little on stable beds: where, whose, on how many."""
    beds = of_beds(robust)
    return [
        f"{fault.beds} of {beds.drawn} beds drawn within [uncertainty] damp the mode at {fault.mode.words()} too "
        f"little: its damping ratio is {fault.mode.damping_ratio:.4f} at worst, {fault.mode.asked:.4f} is asked of it"
        for fault in beds.faults
    ]


def _slow_feed_forward(robust: Verification) -> list[str]:
    """That the model which runs on known torques rings on longer than the vehicle; it is the same on every bed."""
    slowest, asked = robust.slowest_own, robust.required.decay_rate
    if slowest is None or slowest.rate >= asked:
        return []
    return [
        f"the controller's model that runs on known torques has a mode at {slowest.frequency:.3g} Hz that decays with "
        f"{slowest.rate:.3g} 1/s, {asked:.3g} 1/s is asked of it; it is the same on every bed"
    ]


def _unstable_worst_bed(robust: Verification) -> list[str]:
    worst = of_beds(robust).worst
    if worst is None or worst.damping_ratio > 0:
        return []
    return [
        f"the worst bed within [uncertainty] is not stable (damping ratio {worst.damping_ratio:.4f}); it depends most "
        f"on {', '.join(worst.named)}"
    ]


# Whether free play makes a bed swing on is decided in time, on nonlinear beds with play. That the bed as planned is
# stable with every share of its cut shafts' stiffness is what a search can ask for (describing function). It is not
# necessary, since a swing passes through the shares at which it would grow faster than it grows there; and it is not
# sufficient, since drawn beds have other shares, and a command at its limit of torque is less gain than the share says.


def swings_on(robust: Verification, play: OpenLash | None) -> bool:
    """Whether free play limits a match."""
    return robust.required.opened_shafts and bool(_swings_on(robust, play))


def _swings_on(robust: Verification, play: OpenLash | None) -> list[str]:
    """That free play in the cut shafts makes beds swing on; that it may, where it was not simulated."""
    waived = WAIVED if robust.required.opened_shafts else ""
    softer = _opened(robust)
    if play is None:
        return [
            f"{each}, as free play that opens lets a shaft appear: it may swing on there{waived}" for each in softer
        ]
    if not play.limit_cycles:
        return []
    return [f"{play.words()}{''.join(f'; {each}' for each in softer)}{waived}"]


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


def _error(what: str, value: float | None, allowed: float) -> list[str]:
    if value is None or value <= allowed:
        return []
    return [f"the response error to {what} is {value:.3f}, {allowed:g} is allowed"]


def _loop(robust: Verification) -> list[str]:
    """Roll-off and noise."""
    loop, required = robust.loop, robust.required
    sentences = []
    if loop.largest_rolled_off > required.rolled_off:
        sentences.append(
            f"the loop has not rolled off at {required.rolled_off_from:g} Hz: |T| is {loop.largest_rolled_off:.2f} "
            f"there, {required.rolled_off:g} is allowed"
        )
    if worst := _worst_share(loop.command_noise, required.command_noise):
        name, noise, allowed = worst
        sentences.append(
            f"sensor noise makes {noise:.1f} N·m rms of command at dynamometer {name}, {allowed:g} N·m is allowed"
        )
    if worst := _worst_share(loop.unexpected_torque, required.sensor_offset):
        name, torque, allowed = worst
        sentences.append(
            f"a minute after every sensor is off by its uncertainty, the flange torque of dynamometer {name} is "
            f"{torque:.1f} N·m from what the observer expects, {allowed:g} N·m is allowed"
        )
    return sentences


def _worst_share(figures: Mapping[str, float], allowed: Sequence[float]) -> tuple[str, float, float] | None:
    """The dynamometer whose figure is most above what is allowed of it, with both; None where none is above."""
    above = [(value / most, name, value, most) for (name, value), most in zip(figures.items(), allowed)]
    share, name, value, most = max(above, default=(0.0, "", 0.0, 0.0))
    return (name, value, most) if share > 1 else None
