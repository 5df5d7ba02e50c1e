"""A small bed drawn for the campaign of beds: every quantity off by up to 10 %, two effects hidden in it."""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from plant.hidden import Hidden
from small_bed import CASE, RIG, VEHICLE
from virtual_bed.bed import Actuator, Reader, VirtualBed, drawn, drive_of

SPREAD = 0.1  # relative, of every inertia, stiffness, delay, lag and torque gain
NOISE = {"speed": 0.01, "torque": 0.2}  # rad/s, N·m: standard uncertainty that the model states, and the bed's noise
HELD = 5e-4  # s: the half sample of hold that the loop's dead time counts
NOMINAL = {"dead_time": 0.0023, "inverter_lag": 0.002, "torque_sensor_lag": 0.0005}  # s, of the case
LIMITS = """
[response]
band = [2, 30]
compare = [
    { input = "motor_torque", sensor = "motor_speed" },
    { input = "motor_torque", sensor = "side_torque" },
    { input = "road", sensor = "side_torque" },
]
[manoeuvre.motor_torque]
kind = "tip_in"
amplitude = 50
duration = 2
[limits]
dynamometer_torque = 1500
dynamometer_speed = 120
[uncertainty]
"rig.inertias.*.J" = 0.1
"rig.shafts.*.stiffness" = 0.1
"rig.shafts.*.damping" = 0.3
"loop.dead_time" = "0.25 ms"
"loop.inverter_lag" = 0.1
"loop.torque_sensor_lag" = 0.1
"loop.torque_gain" = 0.1
"""


@dataclass
class Disturbing:
    """A hidden effect: kind and place as a diagnosis would name them, and its size in SI (in words for the table)."""

    kind: str
    at: str
    size: float


@dataclass
class DrawnBed:
    """A bed as it is: true values by name, gain of its dynamometer, what is hidden in it."""

    bed: VirtualBed
    gain: float
    loop: dict[str, float]
    hidden: list[Disturbing] = field(default_factory=list)

    def without(self, one: Disturbing) -> VirtualBed:
        """The same bed, one effect less."""
        return build(self, [other for other in self.hidden if other is not one])


def write_case(folder: Path) -> Path:
    """Model files and case file of the first model; the case file."""
    folder.mkdir(parents=True, exist_ok=True)
    sensor = re.compile(r'(\[sensors\.\w+\]\nmeasures = "(\w+)"\nof = "\w+"\n)')
    for name, text in (("vehicle.toml", VEHICLE), ("rig.toml", RIG)):
        noisy = sensor.sub(lambda found: f"{found[1]}uncertainty = {NOISE[found[2]]}\n", text)
        (folder / name).write_text(noisy, encoding="utf-8")
    path = folder / "case.toml"
    path.write_text(CASE[: CASE.index("[response]")] + LIMITS, encoding="utf-8")
    return path


def draw_bed(seed: int, number: int, folder: Path) -> DrawnBed:
    """Bed ``number`` of a campaign, of the models in ``folder``."""
    rng = np.random.default_rng((seed, number))
    drive = drawn(drive_of(folder / "rig.toml", title="small"), SPREAD, rng)
    off = {name: value * (1 + rng.uniform(-SPREAD, SPREAD)) for name, value in NOMINAL.items()}
    gain = 1 + rng.uniform(-SPREAD, SPREAD)
    kinds = {
        "backlash": lambda: Disturbing("backlash", "shafts.side", rng.uniform(0.001, 0.006)),
        "coulomb_friction": lambda: Disturbing("coulomb_friction", "inertias.rotor", rng.uniform(1, 5)),
        "hysteresis": lambda: Disturbing("hysteresis", "shafts.side", rng.uniform(2, 8)),
        "torque_ripple": lambda: Disturbing("torque_ripple", "inertias.motor", rng.uniform(1, 4)),
        "sensor_gain": lambda: Disturbing("sensor_gain", "sensors.flange_torque", 1 + rng.choice([-1, 1]) * 0.03),
        "sensor_delay": lambda: Disturbing("sensor_delay", "sensors.motor_speed", rng.uniform(1e-3, 3e-3)),
        "jitter": lambda: Disturbing("jitter", "inputs.dyno", rng.uniform(1e-4, 3e-4)),
    }
    hidden = [kinds[name]() for name in rng.choice(list(kinds), 2, replace=False)]
    base = VirtualBed(
        drive, [], {"dyno": Actuator(off["dead_time"] - HELD, off["inverter_lag"], gain)},
        {name: Reader(noise=NOISE[what]) for name, (what, _) in drive.sensors.items()}, seed=number + 1,
    )  # fmt: skip
    base.readers["flange_torque"].lag = off["torque_sensor_lag"]
    found = DrawnBed(base, gain, off, hidden)
    return replace(found, bed=build(found, hidden))


def build(drawn_bed: DrawnBed, hidden: list[Disturbing]) -> VirtualBed:
    """The bed with these effects."""
    base = drawn_bed.bed
    readers = {name: replace(one, gain=1.0, delay=0.0) for name, one in base.readers.items()}
    bed = replace(base, effects=[], readers=readers, command_jitter=0.0)
    for one in hidden:
        name = one.at.split(".")[1]
        match one.kind:
            case "sensor_gain":
                readers[name].gain = one.size
            case "sensor_delay":
                readers[name].delay = one.size
            case "jitter":
                bed.command_jitter = one.size
            case _:
                bed.effects.append(Hidden(one.kind, one.at, _parameters(one)))
    return bed


def _parameters(one: Disturbing) -> dict[str, float]:
    if one.kind == "backlash":
        return {"gap": one.size}
    if one.kind == "hysteresis":
        return {"torque": one.size, "angle": 0.002}
    if one.kind == "torque_ripple":
        return {"order": 6.0, "amplitude": one.size, "phase": 0.5}
    return {"torque": one.size}
