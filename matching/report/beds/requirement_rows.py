"""What is asked of a match with an observer beyond its targets, and what drawn beds, loop and sensors made of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from matching.frequency.beds.requirements import LARGEST_ROLLED_OFF
from matching.frequency.independent.beds_check import quantile
from matching.frequency.verification.observed import RobustVerification
from matching.report.common.wording import number


@dataclass(frozen=True)
class RequirementRow:
    """One requirement: what, its value, what is asked, and whether it holds."""

    what: str
    value: str
    asked: str
    holds: bool


def requirement_rows(robust: RobustVerification) -> list[RequirementRow]:
    """Requirements on beds, margin, roll-off and noise; without the beds where the method does not cover the case."""
    beds, loop, required = robust.beds, robust.loop, robust.required
    rows = []
    eased = beds.damped == beds.drawn and beds.smallest_damping_ratio < required.damping_ratio
    less = "; less is a mode of the bed's own beyond the roll-off" if eased else ""
    if beds.drawn:
        rows = [
            RequirementRow("beds stable", f"{beds.stable} of {beds.drawn}", "all", beds.stable == beds.drawn),
            RequirementRow(
                "least damping ratio of any mode on any bed", number(beds.smallest_damping_ratio, 3),
                f"at least {number(required.damping_ratio, 3)}{less}", beds.damped == beds.drawn,
            ),
        ]  # fmt: skip
    if beds.drawn and beds.worst is not None:
        least = beds.worst.damping_ratio
        rows.append(
            RequirementRow(
                f"least damping ratio of the worst bed of the box (most by {', '.join(beds.worst.named[:2])})",
                number(least, 3), f"at least {number(required.damping_ratio, 3)}", least >= required.damping_ratio,
            )
        )  # fmt: skip
    if math.isnan(loop.modulus_margin):  # of a feedback law, which the same method judges
        return rows
    rows += [
        RequirementRow(
            f"modulus margin from {number(required.margin_from)} Hz", number(loop.modulus_margin, 3),
            f"at least {number(required.modulus_margin)}", loop.modulus_margin >= required.modulus_margin,
        ),
        RequirementRow(
            f"roll-off: |T| from {number(required.rolled_off_from)} Hz", number(loop.largest_rolled_off, 3),
            f"at most {number(LARGEST_ROLLED_OFF)}", loop.largest_rolled_off <= LARGEST_ROLLED_OFF,
        ),
    ]  # fmt: skip
    for name, noise in zip(robust.dynamometers, loop.command_noise, strict=True):
        allowed = required.command_noise
        rows.append(
            RequirementRow(
                f"command of dynamometer {name} from sensor noise", f"{number(noise, 3)} N·m rms",
                "no limit" if allowed is None else f"at most {number(allowed)} N·m rms",
                allowed is None or noise <= allowed,
            )
        )  # fmt: skip
    return rows


class ErrorRow(NamedTuple):
    """Kind of torque, median and 95 % quantile of the response error over the stable beds; None without any."""

    torques: str
    median: float | None
    upper: float | None


def error_rows(robust: RobustVerification) -> list[ErrorRow]:
    """The response error over the stable beds, a row for each kind of torque."""
    beds = robust.beds
    return [
        ErrorRow(kind, quantile(errors, 0.5), quantile(errors, 0.95))
        for kind, errors in (("measured", beds.measured), ("unmeasured", beds.unmeasured))
        if errors
    ]
