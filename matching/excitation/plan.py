"""Plans an identification recording: what matters for the match, within the bed's limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from matching.excitation.information import PRIOR, information, line_information, optimal_powers
from matching.excitation.limits import ExcitationLimits, check_demanded, demanded_limits
from matching.excitation.motion import ExcitedBeds, SpeedHold
from matching.excitation.recorded_bed import RecordedBed, recorded_bed
from matching.excitation.result import ExcitationPlan, Expected, Part
from matching.excitation.sensitivity import error_weights
from matching.excitation.signals import chirp, multisine, steps
from matching.excitation.worst_beds import scale_on_worst_beds
from matching.fmu.controller import exported_controller
from matching.frequency.case.case import Case
from modelling.common.errors import InputError

FITTED = 0.7  # of the recording: the rest is what a diagnosis holds out
SHARES = (("multisine", 0.42), ("chirp", 0.16), ("steps", 0.12), ("multisine", 0.30))  # of the duration
LINES = 90  # of the multisine, over the frequencies excited
HIGHEST_TIMES_BAND, HIGHEST_TIMES_SAMPLING = 2.0, 0.06  # highest frequency, the lower of the two: a sample is short
EVEN = 0.3  # share of each input's power that is spread evenly, for what no quantity of the model stands for
REST = 0.5  # s without excitation at the beginning
SPEED_SHARE = 0.25  # of the largest speed: where the bed turns unless the case or the caller says otherwise
SHORTEST = 6.0  # s
SHAPING_BEDS = 4  # of those simulated, that each part is made as large as possible on
SECOND_SEED = 1  # of the multisine that is held out


@dataclass(frozen=True)
class ExcitationOrder:
    """What is wanted of a plan: duration (s), share of every limit that stays free, steady speed of the rotors (rad/s;
    None: from the case), largest torques of inputs that are no dynamometer's (N·m), beds to simulate, seed."""

    duration: float = 20.0
    margin: float = 0.2
    speed: float | None = None
    largest: Mapping[str, float] = field(default_factory=dict)
    beds: int = 20
    seed: int = 0


def plan_excitation(case: Case, order: ExcitationOrder | None = None) -> ExcitationPlan:
    """Plan the recording that tells most of what the match depends on.

    Raises
    ------
    InputError
        If the case has no limits of torque and speed, nothing is uncertain, or a wish cannot be met.
    """
    order = order or ExcitationOrder()
    case = replace(case, uncertainty=case.uncertainty.without("vehicle."))  # no recording of the bed tells these
    bed = recorded_bed(case)
    check_order(case, order)
    speed = steady_speed(case) if order.speed is None else order.speed
    limits = ExcitationLimits(bed, speed, demanded_limits(bed, order.largest))
    box = case.uncertainty
    hold = SpeedHold.of(exported_controller(case).settings)
    drawn = [
        box.at(position) for position in np.vstack([np.zeros(len(box.uncertain)), box.draw(order.beds, order.seed)])
    ]
    beds = ExcitedBeds(bed, drawn, hold)
    steady = beds.steady(speed)
    limits.check_steady(steady, 1 - order.margin)
    weights = error_weights(case)
    torques, parts = _signals(bed, ExcitedBeds(bed, drawn[:SHAPING_BEDS], hold), limits, weights, order)
    motion = beds.run(torques)
    # parts run into each other, and some beds answer more than those that the parts were shaped on
    together = min(limits.largest_scale(steady, motion, torques, 1 - order.margin), 1.0)
    within = scale_on_worst_beds(limits, box, hold, together * torques)
    together *= within
    torques, motion = together * torques, motion.scaled(together)
    parts = tuple(replace(part, amplitude=together * part.amplitude) for part in parts)
    used = limits.used(steady, motion, torques)
    step = case.loop["sample_time"]
    recorded = np.hstack([motion.commands[:, 0], torques[:, motion.commands.shape[2] :]])
    until = round(FITTED * len(torques))
    total = information(bed, box, recorded[:until], step, _lowest(case, order))
    names = [dynamometer.name for dynamometer in case.loop.dynamometers]
    covariance = np.linalg.inv(total + PRIOR * np.eye(len(total)))
    return ExcitationPlan(
        case.title, speed,
        {name: (float(p), float(i)) for name, p, i in zip(names, hold.proportional, hold.integral, strict=True)},
        bed.inputs, np.arange(len(torques)) * step, torques, parts, until * step,
        _expected(case, weights, covariance), float(np.sqrt(np.trace(weights) / PRIOR)),
        float(np.sqrt(np.trace(weights @ covariance))), used, order.margin, order.beds + 1, _notes(bed, limits, within),
    )  # fmt: skip


def check_order(case: Case, order: ExcitationOrder) -> None:
    """Whether a case holds what a plan needs, and an order can be met.

    Raises
    ------
    InputError
        If the case has no limits of torque and speed, nothing is uncertain, or a wish cannot be met.
    """
    check_demanded(case, order.largest)
    for name in ("dynamometer_torque", "dynamometer_speed"):
        if name not in case.limits:
            raise InputError(
                f"{case.path}: limits.{name}", "is missing", "an excitation is planned within the bed's limits"
            )
    if not case.uncertainty.uncertain:
        right = "state under [uncertainty] what is not known exactly"
        raise InputError(f"{case.path}: uncertainty", "nothing is uncertain", right)
    if order.duration < SHORTEST:
        raise InputError("--duration", f"{order.duration:g} s are too short", f"{SHORTEST:g} s or more are needed")
    if not 0 <= order.margin < 1:
        raise InputError("--margin", f"{order.margin:g} is no share", "0 ≤ margin < 1 is needed")


def steady_speed(case: Case) -> float:
    """Steady speed of the rotors, rad/s: the operating point's if it states one, else a share of the largest.

    Raises
    ------
    InputError
        If the case has neither.
    """
    point = case.rig.operating_point
    rotors = {part.on for part in case.rig.inputs if part.name in {d.torque_input for d in case.loop.dynamometers}}
    if point is not None:
        for name, value in point.speeds:
            if name in rotors and value > 0:
                return float(value)
    if "dynamometer_speed" not in case.limits:
        raise InputError(
            f"{case.path}: limits.dynamometer_speed", "is missing", "a steady speed on the bed is chosen by it"
        )
    return SPEED_SHARE * case.limits["dynamometer_speed"]


def _lowest(case: Case, order: ExcitationOrder) -> float:
    return max(case.band[0] / 2, 3 / (SHARES[0][1] * order.duration))


def _signals(
    bed: RecordedBed, beds: ExcitedBeds, limits: ExcitationLimits, weights: np.ndarray, order: ExcitationOrder
) -> tuple[np.ndarray, tuple[Part, ...]]:
    """Torques (t, u) and parts, each part as large as the limits leave it: what a plan is made of."""
    case = bed.case
    steady, step, count = beds.steady(limits.speed), case.loop["sample_time"], len(bed.inputs)
    low = _lowest(case, order)
    high = min(HIGHEST_TIMES_BAND * case.band[1], HIGHEST_TIMES_SAMPLING / step)
    allowed = 1 - order.margin
    sizes = np.concatenate([np.full(len(case.loop.dynamometers), case.limits["dynamometer_torque"]), limits.demanded])
    usable = [j for j, size in enumerate(sizes) if size > 0]
    lasts = SHARES[0][1] * order.duration
    lines = np.unique(np.round(np.geomspace(low, high, LINES) * lasts)) / lasts
    of_input = np.array(usable)[np.arange(len(lines)) % len(usable)]
    each = line_information(bed, case.uncertainty, lines, of_input, round(lasts / step))
    scale = 0.1
    for _ in range(2):  # the best spectrum depends a little on how large it may be
        budget = (scale * sizes) ** 2
        powers = (1 - EVEN) * optimal_powers(each, of_input, weights, budget)
        for j in usable:
            powers[of_input == j] += EVEN * budget[j] / max(np.sum(of_input == j), 1)
        shape = multisine(lines, of_input, powers, count, round(lasts / step), step, order.seed)
        scale *= limits.largest_scale(steady, beds.run(shape), shape, allowed)
    pieces, parts, at = [np.zeros((round(REST / step), count))], [], REST
    for number, (kind, share) in enumerate(SHARES):
        samples = round((share * order.duration - (REST if number == 0 else 0.0)) / step)
        if kind == "multisine":
            shape = multisine(
                lines, of_input, powers, count, samples, step, order.seed + (SECOND_SEED if number else 0)
            )
        else:
            single = [
                chirp(low, case.band[1], j, count, samples // len(usable), step) * sizes[j] if kind == "chirp"
                else steps(j, count, samples // len(usable), step) * sizes[j]
                for j in usable
            ]  # fmt: skip
            shape = np.vstack(single)
        factor = limits.largest_scale(steady, beds.run(shape), shape, allowed)
        pieces.append(factor * shape)
        parts.append(Part(kind, at, at + len(shape) * step, factor))
        at += len(shape) * step
    return np.vstack(pieces), tuple(parts)


def _expected(case: Case, weights: np.ndarray, covariance: np.ndarray) -> tuple[Expected, ...]:
    """What matters most first."""
    expected = []
    for quantity, weight, variance in zip(
        case.uncertainty.uncertain, np.diag(weights), np.diag(covariance), strict=True
    ):
        before, after = 1 / np.sqrt(PRIOR), float(np.sqrt(variance))
        name = quantity.name
        unit = "1"
        if name.startswith("rig."):
            unit = case.rig.units[name.removeprefix("rig.")]
        elif name.startswith("loop."):
            unit = case.loop.quantities[name.removeprefix("loop.")].unit
        expected.append(
            Expected(
                name, quantity.value, unit, before * quantity.half_width, after * quantity.half_width,
                float(np.sqrt(weight) * before), float(np.sqrt(weight) * after),
            )
        )  # fmt: skip
    return tuple(sorted(expected, key=lambda quantity: -quantity.share_before))


def _notes(bed: RecordedBed, limits: ExcitationLimits, within: float) -> tuple[str, ...]:
    k = len(bed.case.loop.dynamometers)
    notes = [
        f"{1 - within:.0%} smaller than drawn beds allow: else the worst bed of [uncertainty] would exceed a limit"
    ]
    notes = notes if within < 0.995 else []
    notes += [
        f"{name} is not excited: the case's manoeuvre has none of it, and no limit is stated for it"
        for name, largest in zip(bed.inputs[k:], limits.demanded, strict=True)
        if largest == 0
    ]
    notes += [
        f"{part.name} states no uncertainty: its noise is taken as 1 {part.unit}"
        for part in bed.case.rig.sensors
        if part.uncertainty is None and part.name in bed.sensors
    ]
    return tuple(notes)
