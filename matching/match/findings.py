"""What limits a match, and what else is to be known of it: data first, its sentence last, one template a cause.

Status, terminal, page, ``result.json`` and the explorer are made from findings; no text is read again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from matching.match.case import limit_of_all
from matching.match.requirements import OPENED_SHAFTS, STRESSES, TORQUE_OVER_SPEED

# --- A finding


@dataclass(frozen=True)
class Finding:
    """One thing that limits a match or is to be known of it.

    Attributes
    ----------
    cause : str
        A key of :data:`CAUSES`.
    size, allowed : float or None
        What it is and what is allowed, in ``unit``; None where it has no size.
    unit : str
        SI; empty for ratios.
    where : str
        Component, dynamometer, mode or kind of torque.
    beds : (int, int) or None
        On how many of how many drawn beds; None where it is said of the bed as planned.
    limits : bool
        Whether it stands in the way; else it is a note.
    data : mapping
        What its sentence says in addition.
    """

    cause: str
    size: float | None = None
    allowed: float | None = None
    unit: str = ""
    where: str = ""
    beds: tuple[int, int] | None = None
    limits: bool = True
    data: Mapping[str, Any] = field(default_factory=dict)

    @property
    def place(self) -> str:
        """Title of the part of the page that holds its evidence; empty where there is none."""
        return CAUSES[self.cause].place

    def sentence(self) -> str:
        """In an engineer's words."""
        return CAUSES[self.cause].words(self)

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        finite = {key: None if value is None or not np.isfinite(value) else value
                  for key, value in (("size", self.size), ("allowed", self.allowed))}  # fmt: skip
        return {
            "cause": self.cause, **finite, "unit": self.unit, "where": self.where,
            "beds": None if self.beds is None else list(self.beds), "limits": self.limits, "place": self.place,
            "sentence": self.sentence(),
        }  # fmt: skip


@dataclass(frozen=True)
class Cause:
    """The sentence of a cause, and the part of the page that holds its evidence."""

    words: Callable[[Finding], str]
    place: str = ""


def sentences(findings: Sequence[Finding]) -> list[str]:
    """Sentences of findings."""
    return [one.sentence() for one in findings]


# --- Quantities in words

LIMIT_WORDS = {
    "dynamometer_torque": ("torque", "N·m"),
    "dynamometer_speed": ("speed", "rad/s"),
    "dynamometer_power": ("power", "W"),
    TORQUE_OVER_SPEED: ("share of the torque at its speed", ""),
}


def limited_quantity(limit: str, dynamometer: str) -> str:
    """What a limit of a case limits."""
    if limit_of_all(limit) in LIMIT_WORDS:
        return f"a {LIMIT_WORDS[limit_of_all(limit)][0]} at dynamometer {dynamometer}"
    shaft, _, what = limit.removeprefix("shafts.").rpartition(".")
    words = {"shear_stress": "a shear stress", "shear_stress_amplitude": "an amplitude of the shear stress"}
    return f"{words.get(what, f'a {what}')} in {shaft}"


def with_unit(limit: str, value: float) -> str:
    """A value (SI) of a limit of a case with its unit."""
    if limit_of_all(limit) in LIMIT_WORDS:
        return f"{value:.4g} {LIMIT_WORDS[limit_of_all(limit)][1]}".rstrip()
    if limit.rpartition(".")[2] in STRESSES:
        return f"{value / 1e6:.4g} MPa"
    return f"{value:.4g} N·m" if limit.endswith("torque") else f"{np.degrees(value):.3g}°"


def asks(dynamometer: str, limit: str, demand: float, allowed: float) -> str:
    """A sentence on a limit that the manoeuvre takes more of than is allowed
    (:class:`matching.match.demands.ExceededLimit`)."""
    return (
        f"to move as the vehicle does, the manoeuvre takes {limited_quantity(limit, dynamometer)} of "
        f"{with_unit(limit, demand)}, {with_unit(limit, allowed)} is the limit"
    )


# --- One template a cause


def _torque_limit(one: Finding) -> str:
    """A demand of the manoeuvre, whether any setting keeps it, and with which limit the targets were met."""
    limit, size, allowed = one.data["limit"], _number(one.size), _number(one.allowed)
    said = asks(one.where, limit, size, allowed)
    if one.data.get("no_setting"):
        said += "; no setting within the bounds needs less"
    if (value := one.data.get("solved_with")) is not None:
        said += f"; solved with {with_unit(limit, value)}, {value / allowed:.2f} times as large, every target is met"
    return said + (" (all of these together)" if one.data.get("together") else "")


def _violated(one: Finding) -> str:
    limit, size, allowed = one.data["limit"], _number(one.size), _number(one.allowed)
    if limit == "modulus_margin":
        return f"the modulus margin is {size:.2f}, {allowed:.2f} is wanted"
    if limit == "damping_ratio":
        return f"the least damped {one.where} has a damping ratio of {size:.4f}, {allowed:g} is wanted"
    known = LIMIT_WORDS.get(limit_of_all(limit))
    what = f"{known[0]} " if known else ""
    return (
        f"{one.where}: the simulated manoeuvre takes {what}{with_unit(limit, size)}, {size / allowed:.2f} times the "
        f"limit of {with_unit(limit, allowed)}"
    )


def _not_stable(one: Finding) -> str:
    starts = one.data["starts"]
    no_start = f": none of {starts} starts ended in a stable loop within the bounds" if starts else ""
    return f"the closed loop is not stable ({one.where}){no_start}"


def _target(one: Finding) -> str:
    data = one.data
    wanted = (
        f"mode {one.where} ({data['vehicle']:.3f} Hz, damping ratio {data['vehicle_damping']:.3f}, {data['symmetry']})"
    )
    if data["matched"] is None:
        alone = data["rig"]
        shown = "the rig without control has none either" if alone is None else (
            f"the rig without control has it at {alone:.2f} Hz"
        )  # fmt: skip
        return f"{wanted}: the closed loop has no such mode; {shown}"
    words = f"{wanted} is reached at {data['matched']:.3f} Hz with damping ratio {data['matched_damping']:.3f}"
    if data["identified"] is None:
        return words + (
            ", and cannot be read off the simulation: it is moved too little, or dies away before it can be told apart"
        )
    return words + f"; the simulation shows {data['identified']:.3f} Hz with {data['identified_damping']:.3f}"


def _beds_not_stable(one: Finding) -> str:
    return f"{_share(one)} beds drawn within [uncertainty] are not stable"


def _damping(one: Finding) -> str:
    return (
        f"{_share(one)} beds drawn within [uncertainty] damp the mode at {one.where} too little: its damping ratio is "
        f"{_number(one.size):.4f} at worst, {_number(one.allowed):.4f} is asked of it"
    )


def _slow_feed_forward(one: Finding) -> str:
    return (
        f"the controller's model that runs on known torques has a mode at {one.where} that decays with "
        f"{_number(one.size):.3g} 1/s, {_number(one.allowed):.3g} 1/s is asked of it; it is the same on every bed"
    )


def _worst_bed(one: Finding) -> str:
    most, size = f"it depends most on {one.data['depends_on']}", _number(one.size)
    if size <= 0:
        return f"the worst bed within [uncertainty] is not stable (damping ratio {size:.4f}); {most}"
    asked = _number(one.allowed)
    return (
        f"the worst bed within [uncertainty] is stable; its mode at {one.where} has a damping ratio of {size:.4f}, "
        f"{100 * size / asked:.0f} % of the {asked:.4f} that this mode needs on drawn beds; {most}"
    )


def _roll_off(one: Finding) -> str:
    return (
        f"the loop has not rolled off at {one.where}: |T| is {_number(one.size):.2f} there, {_number(one.allowed):g} "
        "is allowed"
    )


def _free_play(one: Finding) -> str:
    waived = f"; if these shafts have no play, limits.{OPENED_SHAFTS} = false waives this" if one.data["asked"] else ""
    softer = one.data["not_stable"]
    if not one.data["in_time"]:
        return f"{softer}, as free play that opens lets a shaft appear: it may swing on there{waived}"
    if not one.beds or not one.beds[0]:
        return f"{softer}; in time {one.data['words']}"
    return f"{one.data['words']}{f'; {softer}' if softer else ''}{waived}"


def _play_costs(one: Finding) -> str:
    kept, without = ("{:.3g} and {:.3g}".format(*one.data[way]) for way in ("kept", "without"))
    return (
        "free play in the cut shafts costs accuracy: controllers that bring beds with free play to rest reach response "
        f"errors of {kept} (measured, unmeasured torques), without this requirement {without}"
    )


def counts_of(noise: float, sample_time: float) -> int:
    """Counts a turn, a power of two, of an encoder whose speed has no more noise, rad/s, at a sample time, s."""
    least = 2 * np.pi / sample_time / np.sqrt(6.0) / noise
    return int(2 ** np.ceil(np.log2(least) - NEARLY_SO_MANY))


NEARLY_SO_MANY = 0.05  # of a power of two: 2048 counts where 2100 are needed


def _standstill(one: Finding) -> str:
    """A standing vehicle whose bed turns: by how much, what causes it, and the value that would do."""
    said = (
        f"a standing bed does not stand: within {one.data['seconds']:g} s a wheel turns up to {_number(one.size):.3g} "
        f"rad/s {one.where}, {_number(one.allowed):.2g} rad/s is allowed"
    )
    of_encoders, remedy = one.data["cause_is"] == "speed", one.data["remedy"]
    if not one.data["cause_is"]:
        return said
    said += (
        f"; the cause is the {'noise of the rotor speeds (encoders)' if of_encoders else 'zero of the flange torques'}"
    )
    if remedy is None:
        return said
    if not of_encoders:
        return f"{said}: with an uncertainty of {remedy:.2g} N·m the bed stands"
    counts = counts_of(remedy, one.data["step"])
    return f"{said}: with {remedy:.2g} rad/s, an encoder of {counts} counts a turn, the bed stands"


def _emulation_left(one: Finding) -> str:
    return (
        f"the exported controller leaves emulation after {_number(one.size):.3g} s of {_number(one.allowed):g} s in "
        f"{_share(one)} runs ({one.where}), with nothing but the stated noise, a drift of each sensor by its "
        "uncertainty and a gain error of each encoder"
    )


def _beds_error(one: Finding) -> str:
    """Drawn beds beyond the error that the case allows of the bed as planned."""
    return (
        f"the response error to {one.where} is beyond {_number(one.allowed):g} on {_share(one)} drawn beds (95 % stay "
        f"below {_number(one.size):.2g}); the case asks it of the bed as planned"
    )


CAUSES: dict[str, Cause] = {}  # filled below, where each template stands
_ERRORS = "Response error, and what the dead time allows"
_BEDS = "Beds that may stand there"
_CHECKS = "Checks of stability and targets"
_NEEDS = "What the manoeuvre needs, and the limits"
_ADAPTERS = "Adapters and what else moved"
_IN_TIME = "In time, on beds that are not the model"

CAUSES |= {
    "components_differ": Cause(lambda one: one.data["words"]),
    "torque_limit": Cause(_torque_limit, _NEEDS),
    "limit_exceeded": Cause(_violated, _NEEDS),
    "not_stable": Cause(_not_stable, _CHECKS),
    "methods_disagree": Cause(
        lambda one: (
            "verification failed: the motion that the loop's matrices foretell and the simulated one differ by "
            f"more than {_number(one.allowed):.1%} of their range, so neither is believed"
        ),
        _CHECKS,
    ),
    "target_missed": Cause(_target, _CHECKS),
    "no_adapter": Cause(
        lambda one: (
            f"no adapter within the bounds does it: {_number(one.size):.3f} Hz would take "
            f"{one.data['parts']}; a residual vehicle model has to supply the inertia"
        ),
        _ADAPTERS,
    ),
    "bounds": Cause(
        lambda one: f"bounds under [move] stand in the way: solved with {one.where}, every target is met", _ADAPTERS
    ),
    "dead_time": Cause(lambda one: one.data["words"], _ERRORS),
    "structure": Cause(
        lambda one: (
            f'with structure = "{one.where}" and every torque on the rig measured, the values shown meet '
            f"{one.data['targets']} of {one.data['targets']} targets (verified)"
        ),
        _CHECKS,
    ),
    "dead_time_alone": Cause(
        lambda one: (
            "with every torque measured, dead time and sampling alone leave a response error of "
            f"{_number(one.size):.2g}, {_number(one.allowed):g} is allowed"
        ),
        _ERRORS,
    ),
    "other_specimen": Cause(
        lambda one: (
            "the specimen on the rig is not the vehicle's (see the notes); with every torque measured and a bed that "
            f"answers at once a response error of {_number(one.size):.2g} stays, {_number(one.allowed):g} is allowed"
        ),
        _ERRORS,
    ),
    "response_error": Cause(
        lambda one: (
            f"the response error to {one.where} is {_number(one.size):.3f}, {_number(one.allowed):g} is allowed"
        ),
        _ERRORS,
    ),
    "residual_vehicle": Cause(lambda one: one.data["words"], _ERRORS),
    "beds_not_stable": Cause(_beds_not_stable, _BEDS),
    "beds_damping": Cause(_damping, _BEDS),
    "beds_error": Cause(_beds_error, _BEDS),
    "slow_feed_forward": Cause(_slow_feed_forward, _BEDS),
    "worst_bed": Cause(_worst_bed, _BEDS),
    "roll_off": Cause(_roll_off, _BEDS),
    "command_noise": Cause(
        lambda one: (
            f"sensor noise makes {_number(one.size):.1f} N·m rms of command at dynamometer {one.where}, "
            f"{_number(one.allowed):g} N·m is allowed"
        ),
        _BEDS,
    ),
    "sensor_offset": Cause(
        lambda one: (
            "a minute after every sensor is off by its uncertainty, the flange torque of dynamometer "
            f"{one.where} is {_number(one.size):.1f} N·m from what the observer expects, "
            f"{_number(one.allowed):g} N·m is allowed"
        ),
        _BEDS,
    ),
    "free_play": Cause(_free_play, _IN_TIME),
    "play_costs": Cause(_play_costs, _IN_TIME),
    "open_lash": Cause(lambda one: one.data["words"]),
    "standstill": Cause(_standstill, _IN_TIME),
    "emulation_left": Cause(_emulation_left, _IN_TIME),
    "drive": Cause(lambda one: one.data["words"], "Over the range of speeds"),
}


def stated(cause: str, words: Sequence[str]) -> list[Finding]:
    """Findings whose words are made where their numbers are: of a range of speeds, of runs with supervision."""
    return [Finding(cause, data={"words": each}) for each in words]


def _share(one: Finding) -> str:
    assert one.beds is not None, "said of drawn beds"
    return f"{one.beds[0]} of {one.beds[1]}"


def _number(value: float | None) -> float:
    """The size of a finding that has one."""
    assert value is not None, "this cause has a size"
    return value
