"""The car and the bed of ``own_bed.c``: values from model files, drawn beds, drives, and errors part by part."""

import ctypes
import subprocess
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from needs import compiler
from scipy.optimize import brentq

from modelling.controller.c_source import c_sources

HERE = Path(__file__).parent
SIDES = ("left", "right")
PIECES = 32  # fine steps a sample of 1 ms
SHAPE, STILL = 1.65, 0.02  # as in the C
NOISE = (0.3, 0.05, 0.05)  # N·m, rad/s of a rotor, rad/s of the motor
MU, MASS, ROAD = 3, 5, 6  # rows of the car's inputs after motor and brakes
COLUMNS = ("motor", "side_left", "side_right", "wheel_left", "wheel_right", "body_left", "body_right")
GRAVITY = 9.81


ONE, TWO = ctypes.c_double, ctypes.c_double * 2


def each(kind, *names):
    """Fields of one kind."""
    return [(name, kind) for name in names]


class Plant(ctypes.Structure):
    """As in the C, all doubles."""

    _fields_ = [
        *each(ONE, "ratio", "J_motor", "drag_motor", "J_gear", "drag_gear", "J_diff", "k_mesh", "c_mesh"),
        *each(ONE, "k_out", "c_out"), *each(TWO, "k_side", "c_side", "J_wheel", "J_tyre", "J_body", "drag_body"),
        *each(TWO, "k_belt", "c_belt", "k_car", "c_car", "slip", "peak"), ("brush", ONE),
        *each(TWO, "air", "roll", "pad", "J_adapter", "J_rotor", "drag_rotor", "k_flange", "c_flange"),
        *each(TWO, "inverter", "gain", "flange_lag", "flange_gain"),
        *each(ONE, "delay", "noise_torque", "noise_speed", "noise_motor"),
        ("gear", TWO), *each(ONE, "J_out", "give"),
    ]  # fmt: skip


class Wrong(ctypes.Structure):
    """A channel (0, 1 flanges; 2, 3 rotors; 4 motor) that is wrong from a sample on, for so many."""

    _fields_ = [(name, ctypes.c_int) for name in ("channel", "kind", "first", "samples")] + [("size", ctypes.c_double)]


class Outside(ctypes.Structure):
    """A car beyond the cuts: samples in one of its steps, by which it is late, and the speed at which it begins."""

    _fields_ = [("steps", ctypes.c_int), ("late", ctypes.c_int), ("speed", ctypes.c_double)]


def plant(vehicle: Path, rig: Path, dead_time: float, draw=None, brush=False, extra=None) -> Plant:
    """Car and bed of these files; ``draw`` (a generator) makes the bed and its specimen one within the case's box."""
    car, bed = (tomllib.loads(path.read_text()) for path in (vehicle, rig))
    sides = {
        key: [f"{key}_{side}" for side in SIDES]
        for key in ("side", "wheel", "tyre", "body", "wheel_tyre", "tyre_body", "adapter", "rotor", "flange")
    }

    def off(most):
        return 1.0 if draw is None else 1.0 + most * draw.uniform(-1, 1)

    factors: dict[str, float] = {}

    def factor(name, most):  # what both have under one name is one specimen
        return factors.setdefault(name, off(most))

    def J(data, name, most=0.05):
        return data["inertias"][name]["J"] * (factor(name, most) if name in bed["inertias"] else 1.0)

    def drag(data, name):
        return data["inertias"][name].get("drag", 0.0)

    def stiff(data, name):
        return data["shafts"][name]["stiffness"] * (factor("k " + name, 0.05) if name in bed["shafts"] else 1.0)

    def damp(data, name):
        return data["shafts"][name]["damping"] * (factor("c " + name, 0.3) if name in bed["shafts"] else 1.0)

    effects = {(one["kind"], one["at"]): one for one in car.get("effects", [])}

    def of(kind, places, key):
        return tuple(effects[kind, place][key] for place in places)

    made = Plant()
    values = {
        "ratio": bed["shafts"]["gear_output"]["ratio"], "J_motor": J(bed, "motor"), "drag_motor": drag(bed, "motor"),
        "J_gear": J(bed, "gearbox"), "drag_gear": drag(bed, "gearbox"), "J_diff": J(bed, "differential"),
        "k_mesh": stiff(bed, "gear_mesh"), "c_mesh": damp(bed, "gear_mesh"),
        "k_out": stiff(bed, "gear_output"), "c_out": damp(bed, "gear_output"), "brush": float(brush),
        "delay": dead_time + 0.0 if draw is None else dead_time + 0.0005 * draw.uniform(-1, 1),
        "noise_torque": NOISE[0], "noise_speed": NOISE[1], "noise_motor": NOISE[2],
    }  # fmt: skip
    for key, data, names in (
        ("side", bed, "side"), ("belt", car, "wheel_tyre"), ("car", car, "tyre_body"), ("flange", bed, "flange")
    ):  # fmt: skip
        values[f"k_{key}"] = tuple(stiff(data, name) for name in sides[names])
        values[f"c_{key}"] = tuple(damp(data, name) for name in sides[names])
    for key, data in (("wheel", car), ("tyre", car), ("body", car), ("adapter", bed), ("rotor", bed)):
        values[f"J_{key}"] = tuple(J(data, name) for name in sides[key])
    values["drag_body"] = tuple(drag(car, name) for name in sides["body"])
    values["drag_rotor"] = tuple(drag(bed, name) for name in sides["rotor"])
    carcass = [f"shafts.{name}" for name in sides["tyre_body"]]
    bodies = [f"inertias.{name}" for name in sides["body"]]
    values |= {
        "slip": of("tyre_slip", carcass, "slip_stiffness"), "peak": of("tyre_slip", carcass, "peak"),
        "air": of("quadratic_drag", bodies, "coefficient"), "roll": of("coulomb_friction", bodies, "torque"),
        "pad": of("brake", [f"inputs.brake_{side}" for side in SIDES], "deflection"),
        "inverter": tuple(0.002 * off(0.2) for _ in SIDES), "gain": tuple(off(0.03) for _ in SIDES),
        "flange_lag": tuple(0.0005 * off(0.2) for _ in SIDES), "flange_gain": tuple(off(0.005) for _ in SIDES),
    }  # fmt: skip
    for name, value in (values | (extra or {})).items():
        if isinstance(value, tuple):
            setattr(made, name, (ctypes.c_double * 2)(*value))
        else:
            setattr(made, name, value)
    return made


def tyre_slip_torque(of: Plant, load: float) -> float:
    """The torque over slip, were it linear, at which a tyre carries a load."""
    if of.brush:
        P = of.peak[0]
        return float(brentq(lambda s: s - s * abs(s) / (3 * P) + s**3 / (27 * P**2) - load, 0, 3 * P))
    return float(SHAPE * of.peak[0] * np.tan(np.arcsin(load / of.peak[0]) / SHAPE))


def held_motor(of: Plant, speed: float, mass: float = 1.0) -> tuple[float, float]:
    """Motor torque that holds a speed of the bodies, rad/s, on the level; wheel speed there."""
    if speed == 0:
        return 0.0, 0.0
    load = of.air[0] * speed**2 + mass * of.roll[0] * np.tanh(speed / STILL) + of.drag_body[0] * speed
    wheel = speed * (1 + tyre_slip_torque(of, load) / of.slip[0])
    return 2 * load / of.ratio + (of.drag_motor + of.drag_gear) * wheel * of.ratio, wheel


@dataclass
class Run:
    """Traces: car (t, 7), bed (t, 24)."""

    car: np.ndarray
    bed: np.ndarray
    faults: np.ndarray = field(init=False)

    def __post_init__(self):
        self.faults = self.bed[:, 10].astype(int)

    def error(self, first=0, last=None):
        """Worst of motor speed and side shafts over a part: rms over the range of the car's signal in that part."""
        car, bed = self.car[first:last, :3], self.bed[first:last, :3]
        return float((np.sqrt(np.mean((bed - car) ** 2, axis=0)) / np.maximum(np.ptp(car, axis=0), 1e-9)).max())


class Beside:
    """An exported controller compiled with the car and the bed; one process-wide library a folder."""

    def __init__(self, controller, folder: Path):
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in c_sources(controller).items():
            (folder / name).write_text(text)
        library = folder / "all.so"
        command = [compiler(), "-std=c99", "-O2", "-shared", "-fPIC", "-I.", str(HERE / "own_bed.c"), "controller.c"]
        subprocess.run([*command, "-o", library.name, "-lm"], cwd=folder, check=True)
        self._library = ctypes.CDLL(str(library))
        assert self._library.plant_doubles() * 8 == ctypes.sizeof(Plant)
        self.law, self.step = controller.law, controller.law.sample_time
        names = list(self.law.sensors)
        wanted = ["flange_left_torque", "flange_right_torque", "rotor_left_speed", "rotor_right_speed", "motor_speed"]
        self.channel = (ctypes.c_int * 5)(*(names.index(one) if one in names else -1 for one in wanted))
        known = list(self.law.known)
        wanted = ["motor_torque", "brake_left", "brake_right", "road_left", "road_right"]
        self.known = (ctypes.c_int * 5)(*(known.index(one) if one in known else -1 for one in wanted))

    def run(
        self, of: Plant, speed: float, u: np.ndarray, hold=1.0, wrong=(), seed=1, bed: Plant | None = None,
        motor_share=1.0, missing=0.0, sent_share=(1e9, 1.0), outside=(1, 0), shift=(0, 0),
    ):  # fmt: skip
        """Car and bed under inputs u (t, 10), from a speed of the bodies, rad/s.

        With a law for a vehicle of others the car beyond the cuts is stepped outside: ``outside`` (steps, late).
        A shift is told from one sample to another, ``shift``.
        """
        u = np.ascontiguousarray(u)
        bed = of if bed is None else bed
        samples, before = len(u), round(hold / self.step)
        car, out = np.zeros((samples, 7)), np.zeros((samples, 24))
        double = ctypes.POINTER(ctypes.c_double)
        pieces = max(1, round(PIECES * self.step / 1e-3))
        self._library.run_car(
            ctypes.byref(of), ctypes.c_double(speed), u.ctypes.data_as(double), samples, before,
            ctypes.c_double(self.step), pieces, car.ctypes.data_as(double),
        )  # fmt: skip
        wheel = held_motor(of, speed)[1]
        faults = (Wrong * max(len(wrong), 1))(*wrong)
        self._library.run_bed(
            ctypes.byref(bed), ctypes.c_double(wheel), ctypes.c_double(0), u.ctypes.data_as(double), samples, before,
            ctypes.c_double(self.step), pieces, self.channel, self.known, faults, len(wrong), ctypes.c_ulonglong(seed),
            ctypes.c_double(motor_share), ctypes.c_double(missing), ctypes.c_double(sent_share[0]),
            ctypes.c_double(sent_share[1]), ctypes.byref(of), ctypes.byref(Outside(*outside, speed)),
            (ctypes.c_int * 2)(*shift), out.ctypes.data_as(double),
        )  # fmt: skip
        return Run(car, out)


def inputs(time: np.ndarray, motor, brakes=0.0, mu=(1.0, 1.0), mass=1.0, road=0.0) -> np.ndarray:
    """Inputs (t, 10); brakes and road a side alike; the last two are what the clutches carry, if there are any."""
    u = np.zeros((len(time), 10))
    u[:, 0], u[:, 1:3] = motor, np.broadcast_to(np.asarray(brakes, float).reshape(-1, 1), (len(time), 2))
    u[:, 3], u[:, 4], u[:, 5] = mu[0], mu[1], mass
    u[:, 6:8] = np.broadcast_to(np.asarray(road, float).reshape(-1, 1), (len(time), 2))
    return u


def ramp(time, begin, rise):
    """0 to 1 as a smooth step."""
    part = np.clip((time - begin) / rise, 0, 1)
    return part**2 * (3 - 2 * part)


def up_and_down(kmh: float, motor: float = 150.0, brake: float = 750.0, of: Plant | None = None, radius: float = 0.3):
    """From rest to a speed, overrun, tip-in, braked to standstill, held 5 s, and away again: inputs and parts.

    The times follow from a car that is one mass; they need not be exact.
    """
    J = sum(of.J_body) + sum(of.J_wheel) + sum(of.J_tyre) + (of.J_motor + of.J_gear) * of.ratio**2
    w, t, reach = 0.0, 0.0, kmh / 3.6 / radius
    while w < reach and t < 100:
        w += 0.01 * (motor * of.ratio - 2 * of.roll[0] - 2 * of.air[0] * w * w) / J
        t += 0.01
    up = t + 0.65
    over, tip = up + 0.8, up + 2.6
    end = tip + 1.5 + reach * J / (2 * brake) * 0.93  # of the evenly braked part
    stop = end + reach * J / (2 * brake) * 0.4 + 1.5
    away = stop + 5.0
    time = np.arange(round((away + 3.0) / 1e-3)) * 1e-3
    torque = motor * (ramp(time, 0.5, 0.3) - ramp(time, up, 0.1)) - 30 * (
        ramp(time, over, 0.1) - ramp(time, tip - 0.8, 0.1)
    )
    torque += 100 * (ramp(time, tip, 0.05) - ramp(time, tip + 1.2, 0.1)) + motor * ramp(time, away, 0.3)
    brakes = brake * (ramp(time, tip + 1.5, 0.2) - ramp(time, away - 0.3, 0.2))
    marks = {
        "drive away": (0, up), "overrun": (over - 0.1, tip), "tip-in": (tip, tip + 1.2),
        "braked": (tip + 1.5, end), "stopping": (tip + 1.5, stop), "held": (stop + 0.5, away - 0.4),
        "away again": (away, away + 3.0),
    }  # fmt: skip
    return inputs(time, torque, brakes), {name: (round(a * 1e3), round(b * 1e3)) for name, (a, b) in marks.items()}
