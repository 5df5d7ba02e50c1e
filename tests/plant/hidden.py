"""What can be hidden in a recording: one entry a kind, its places, its parameters by size.

`size` s is a plain number: s = 0 is no effect, s about 1 is a strong one; calibration finds the s that is worth so many
times the noise. The laws are those of the specification's effect table, hard ones left hard.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from plant.engine import Motion
from plant.systems import Drive


@dataclass
class Hidden:
    """An effect: kind, place (`shafts.link`) and parameters in SI, as the specification's table names them."""

    kind: str
    at: str
    parameters: dict[str, float] = field(default_factory=dict)
    draw: int = 0  # seed of what was drawn besides the size: sign, order, ratios

    @property
    def name(self) -> str:
        return self.at.split("+")[0].split(".")[1]

    def in_recording(self, number: int) -> Hidden:
        """As it is in a recording: friction that differs between recordings is plain friction in each."""
        if self.kind != "recording_friction":
            return self
        return Hidden("coulomb_friction", self.at, {"torque": self.parameters[f"torque_{number}"]}, self.draw)

    @property
    def members(self) -> list[str]:
        """Names of all that share it."""
        return [place.split(".")[1] for place in self.at.split("+")]


@dataclass
class Scales:
    """Typical sizes in the motion without effects: what `size` is relative to."""

    twist: dict[str, float]
    shaft_torque: dict[str, float]
    speed: dict[str, float]
    drive_torque: dict[str, float]  # inertia -> the inputs' torque felt there
    sensor: dict[str, float]
    input_peak: dict[str, float]
    noise: dict[str, float]
    duration: float
    crest: dict[str, float]  # shaft -> peak / rms of the twist
    swing: dict[str, float]  # inertia -> range of its angle
    middle: dict[str, float]  # inertia -> middle of that range


def scales(drive: Drive, motion: Motion, readings: dict[str, np.ndarray], noise: dict[str, float]) -> Scales:
    torque = {name: float(np.std(motion.torque[:, j])) for j, name in enumerate(drive.shafts)}
    felt = [drive.speed_ratio(on) for on in drive.inputs.values()]
    total = float(np.sqrt(np.sum(np.var(motion.input * felt, axis=0))))
    peak = {name: float(np.abs(motion.torque[:, j]).max()) for j, name in enumerate(drive.shafts)}
    stiff = {name: drive.values[f"shafts.{name}.stiffness"] for name in drive.shafts}
    return Scales(
        {name: torque[name] / stiff[name] for name in drive.shafts},
        torque,
        {name: float(np.std(motion.speed[:, i])) for i, name in enumerate(drive.inertias)},
        {name: total / drive.speed_ratio(name) for name in drive.inertias},
        {name: float(np.std(value)) for name, value in readings.items()},
        {name: float(np.abs(motion.input[:, j]).max()) for j, name in enumerate(drive.inputs)},
        noise,
        float(motion.time[-1]),
        {name: peak[name] / torque[name] for name in drive.shafts},
        {name: float(np.ptp(motion.angle[:, i])) for i, name in enumerate(drive.inertias)},
        {
            name: float(np.ptp(motion.angle[:, i]) / 2 + motion.angle[:, i].min())
            for i, name in enumerate(drive.inertias)
        },
    )


@dataclass
class Kind:
    """`places` of a drive, `parameters(rng, drive, scales, name)` -> (s -> parameters), largest meaningful s."""

    group: str  # shafts | inertias | inputs | sensors | values
    parameters: Callable[..., Callable[[float], dict[str, float]]]
    largest: float = 20.0
    inside: bool = True


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _hardening(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    stiff, twist = d.values[f"shafts.{name}.stiffness"], c.twist[name]
    if rng.random() < 0.25:  # softening, kept so weak that the shaft still resists more at more twist
        most = 0.2 / c.crest[name] ** 2
        return lambda s: {"cubic": -stiff / twist**2 * most * (1 - np.exp(-s))}
    return lambda s: {"cubic": s * stiff / twist**2}


def _coulomb(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    other = rng.uniform(0.5, 0.8) ** _sign(rng) if rng.random() < 0.4 else 0.0
    torque = c.drive_torque[name]
    return lambda s: {"torque": s * torque} | ({"torque_reverse": other * s * torque} if other else {})


def _recording(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    less = rng.uniform(0.2, 0.6)
    return lambda s: {"torque_1": s * c.drive_torque[name], "torque_2": less * s * c.drive_torque[name]}


def _stribeck(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    more, speed = rng.uniform(1.5, 2.5), rng.uniform(0.08, 0.3) * c.speed[name]
    return lambda s: {"torque": s * c.drive_torque[name], "breakaway": more * s * c.drive_torque[name], "speed": speed}


def _ripple(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    least = 2 * 2 * np.pi / min(c.swing.values())  # twice within what every inertia turns: else it is no ripple yet
    order = float(rng.choice([each for each in (1, 2, 3, 4, 6) if each > least] or [np.ceil(least)]))
    phase = rng.uniform(-np.pi, np.pi)
    return lambda s: {"order": order, "amplitude": s * c.drive_torque[name], "phase": phase}


def _compliance(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    stiff = d.values[f"shafts.{name}.stiffness"]
    first, second = (d.values[f"inertias.{end}.J"] for end in d.shafts[name])
    inertia = rng.uniform(0.2, 0.5) * min(first * d.values.get(f"shafts.{name}.ratio", 1.0) ** 2, second)
    return lambda s: {"stiffness": 2 * stiff / s, "J": s * inertia}


def _hysteresis(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    angle = rng.uniform(0.3, 1.0) * c.twist[name]
    return lambda s: {"torque": s * c.shaft_torque[name], "angle": angle}


def _constant(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    sign = _sign(rng)
    return lambda s: {"torque": sign * s * c.drive_torque[name]}


def _factor(strength: float) -> Any:
    def make(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
        sign = _sign(rng)
        return lambda s: {"factor": float(np.exp(sign * strength * s))}

    return make


def _wrong(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    sign = _sign(rng)
    return lambda s: {"value": d.values[name] * float(np.exp(0.2 * sign * s))}


def _offset(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    sign = _sign(rng)
    return lambda s: {"offset": sign * s * c.sensor[name]}


def _drift(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    sign = _sign(rng)
    return lambda s: {"rate": sign * s * c.sensor[name] / c.duration}


def _late(key: str) -> Any:
    return lambda rng, d, c, name: lambda s: {key: 0.005 * s}


def _jump_clock(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    when = rng.uniform(0.35, 0.65) * c.duration
    return lambda s: {"jump": 0.005 * s, "time": when}


def _jump_value(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    when, sign = rng.uniform(0.4, 0.6) * c.duration, _sign(rng)
    return lambda s: {"value": d.values[name] * float(np.exp(0.3 * sign * s)), "time": when}


def _input_offset(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    sign = _sign(rng)
    return lambda s: {"offset": sign * 0.1 * s * c.input_peak[name]}


def _gear_loss(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    more = rng.uniform(1.2, 2.0) if rng.random() < 0.4 else 0.0

    def parameters(s: float) -> dict[str, float]:
        lost = 0.5 * (1 - np.exp(-0.2 * s))  # never more than half
        return {"efficiency": 1 - lost} | ({"efficiency_reverse": max(1 - more * lost, 0.05)} if more else {})

    return parameters


def _position(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    period, phase = rng.uniform(0.4, 1.2) * c.swing[name], rng.uniform(-np.pi, np.pi)
    return lambda s: {"period": period, "amplitude": s * c.drive_torque[name], "phase": phase}


def _table(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    """A bump of torque at a speed, an angle or a twist, which no law of the vocabulary has."""
    if name in d.shafts:
        axis, low, high, torque = "twist", -2 * c.twist[name], 2 * c.twist[name], c.shaft_torque[name]
    elif rng.random() < 0.5:
        axis, low, high, torque = "speed", -2 * c.speed[name], 2 * c.speed[name], c.drive_torque[name]
    else:
        axis, low, torque = "angle", c.middle[name] - c.swing[name] / 2, c.drive_torque[name]
        high = low + c.swing[name]
    points = np.linspace(low, high, 17)
    centre, width = rng.uniform(0.35, 0.65), rng.uniform(0.06, 0.12)
    bump = _sign(rng) * np.exp(-((((points - low) / (high - low) - centre) / width) ** 2))
    return lambda s: (
        {f"{axis}_{i}": float(x) for i, x in enumerate(points, 1)}
        | {f"torque_{i}": float(s * torque * y) for i, y in enumerate(bump, 1)}
    )


def _clock(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    sign = _sign(rng)
    return lambda s: {"offset": 0.005 * sign * s}


def _warming(strength: float) -> Any:
    def make(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
        sign = _sign(rng)
        constant = c.duration * (rng.uniform(0.15, 0.5) if rng.random() < 0.7 else 3.0)  # the latter nearly linear
        return lambda s: {"change": float(np.expm1(sign * strength * s)), "time_constant": constant}

    return make


def _seven_hertz(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    phase = rng.uniform(-np.pi, np.pi)
    return lambda s: {"amplitude": s * c.drive_torque[name], "frequency": 7.0, "phase": phase}


def _crosstalk(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    strangers = [other for other, (what, _) in d.sensors.items() if what != d.sensors[name][0]]
    other = str(rng.choice(strangers)) if strangers else name
    return lambda s: {"from": other, "share": 0.1 * s * c.sensor[name] / c.sensor[other]}


def _wave(rng: np.random.Generator, d: Drive, c: Scales, name: str) -> Any:
    order = float(rng.choice([1, 2, 3]))
    return lambda s: {"share": 0.2 * s, "order": order}


KINDS: dict[str, Kind] = {
    "backlash": Kind("shafts", lambda rng, d, c, name: lambda s: {"gap": s * c.twist[name]}),
    "hardening": Kind("shafts", _hardening),
    "hysteresis": Kind("shafts", _hysteresis),
    "slip": Kind(
        "shafts", lambda rng, d, c, name: lambda s: {"coefficient": d.values[f"shafts.{name}.stiffness"] / (5.0 * s)}
    ),
    "compliance": Kind("shafts", _compliance, 5.0),
    "coulomb_friction": Kind("inertias", _coulomb, 1.5),
    "stribeck_friction": Kind("inertias", _stribeck, 1.0),
    "quadratic_drag": Kind(
        "inertias", lambda rng, d, c, name: lambda s: {"coefficient": s * c.drive_torque[name] / c.speed[name] ** 2}
    ),
    "constant_torque": Kind("inertias", _constant, 2.0),
    "torque_ripple": Kind("inertias", _ripple, 5.0),
    "dead_time": Kind("inputs", _late("delay"), 40.0),
    "input_lag": Kind("inputs", _late("time_constant"), 40.0),
    "input_gain": Kind("inputs", _factor(0.1), 10.0),
    "sensor_offset": Kind("sensors", _offset),
    "sensor_gain": Kind("sensors", _factor(0.05)),
    "sensor_drift": Kind("sensors", _drift),
    "sensor_delay": Kind("sensors", _late("delay"), 40.0),
    "sensor_lag": Kind("sensors", _late("time_constant"), 40.0),
    "wrong_parameter": Kind("values", _wrong, 6.0),
    "input_offset": Kind("inputs", _input_offset, 10.0),
    "gear_loss": Kind("shafts", _gear_loss),
    "geared_ripple": Kind("inertias", _ripple, 5.0),
    "recording_friction": Kind("inertias", _recording, 1.5),
    "position_torque": Kind("inertias", _position, 5.0, inside=False),
    "parameter_drift": Kind("values", _warming(0.3), 6.0),
    "input_gain_drift": Kind("inputs", _warming(0.1), 10.0),
    "sensor_gain_drift": Kind("sensors", _warming(0.05)),
    "table": Kind("inertias", _table, 5.0, inside=False),
    "clock_offset": Kind("sensors", _clock, 40.0),
    "clock_jump": Kind("sensors", _jump_clock, 40.0, inside=False),
    "saturating_actuator": Kind(
        "inputs",
        lambda rng, d, c, name: lambda s: {"limit": c.input_peak[name] * float(np.exp(-0.2 * s))},
        15.0,
        inside=False,
    ),
    "angle_stiffness": Kind("shafts", _wave, 4.5, inside=False),
    "parameter_jump": Kind("values", _jump_value, 4.0, inside=False),
    "disturbance": Kind("inertias", _seven_hertz, 5.0, inside=False),
    "quantisation": Kind(
        "sensors", lambda rng, d, c, name: lambda s: {"step": 10 * s * c.noise[name]}, 1e4, inside=False
    ),
    "crosstalk": Kind("sensors", _crosstalk, 50.0, inside=False),
}
# two entries that the specification calls by one kind, apart here because they differ in place
SPOKEN = {
    "input_lag": "lag",
    "sensor_lag": "lag",
    "input_gain_drift": "gain_drift",
    "sensor_gain_drift": "gain_drift",
}
INSIDE = tuple(kind for kind, entry in KINDS.items() if entry.inside)
OUTSIDE = tuple(kind for kind, entry in KINDS.items() if not entry.inside)


def places(drive: Drive, kind: str) -> list[str]:
    """Where a kind may sit in a drive."""
    group = KINDS[kind].group
    if group == "values":
        ends = ("drag", "stiffness", "damping") if kind == "parameter_drift" else ("J", "stiffness")
        if kind == "parameter_drift":
            return [name for name in drive.values if name.rsplit(".", 1)[1] in ends and drive.values[name]]
        return [name for name in drive.values if name.rsplit(".", 1)[1] in ends]
    if kind == "clock_jump":
        return ["sensors.all"]
    if kind == "clock_offset":
        what = [measures for measures, _ in drive.sensors.values()]
        groups = {one: [name for name, (measures, _) in drive.sensors.items() if measures == one] for one in what}
        return [
            "+".join(f"sensors.{name}" for name in group) for group in groups.values() if 1 < len(group) < len(what)
        ]
    found = [f"{group}.{name}" for name in getattr(drive, group)]
    if kind == "table":
        return found + [f"shafts.{name}" for name in drive.shafts]
    if kind == "geared_ripple":
        return [f"{first}+{second}" for first in found for second in found if first != second]
    if kind == "crosstalk" and len({what for what, _ in drive.sensors.values()}) < 2:
        return []
    return found


def known(effects: list[Hidden]) -> set[str]:
    """Places whose value the model file does not give a range; one that drifts keeps it."""
    return {e.at for e in effects if e.kind != "parameter_drift"}
