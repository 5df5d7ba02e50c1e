"""Car with engine and clutch, and the axle bed, of ``own_clutch.c``: values from files, drawn beds, drives by parts."""

import ctypes
import subprocess
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from needs import compiler

HERE = Path(__file__).parent
CASE = HERE / "clutch" / "case.toml"
ONE, THREE = ctypes.c_double, ctypes.c_double * 3
STEP, HELD, RADIUS, LONGEST = 1e-3, 1500, 0.3, 64  # s, samples of speed hold, m, samples of dead time at most
NOISE = np.array([0.2, 0.35, 0.35, 0.05, 0.05, 0.05])  # N·m, rad/s of the machines
IDLE, HOLD, EMULATION = 0, 1, 2
NAMES = (
    *("J_engine", "drag_engine", "J_hub", "J_gear", "J_diff", "ratio", "k_in", "c_in", "k_out", "c_out"),
    *("k_side", "c_side", "J_wheel", "J_body", "drag_body", "k_car", "c_car", "slip", "peak"),
    *("idle_full", "idle_none", "idle_torque", "top", "top_drag"),
    *("J_in", "drag_in", "J_adapter", "J_rotor", "drag_rotor", "k_flange", "c_flange"),
)


class Plant(ctypes.Structure):
    """As in the C."""

    _fields_ = [*((name, ONE) for name in NAMES), ("inverter", THREE), ("gain", THREE), ("lag", THREE), ("delay", ONE)]


def plant(draw=None, dead_time=0.003, **changed) -> Plant:
    """Car and bed of the case's files; ``draw`` (a generator) makes bed and specimen one within the case's box."""
    car, bed = (tomllib.loads((CASE.parent / name).read_text()) for name in ("vehicle.toml", "rig.toml"))
    effects = {one["kind"]: one for one in car["effects"]}

    def off(most):
        return 1.0 if draw is None else 1.0 + most * draw.uniform(-1, 1)

    def J(data, name):
        return data["inertias"][name]["J"] * (off(0.05) if data is bed else 1.0)

    def shaft(data, name):
        one, drawn = data["shafts"][name], data is bed
        return one["stiffness"] * (off(0.05) if drawn else 1.0), one["damping"] * (off(0.3) if drawn else 1.0)

    made = Plant()
    values = {
        "J_engine": J(car, "engine"), "drag_engine": car["inertias"]["engine"]["drag"], "J_hub": J(car, "hub"),
        "J_gear": J(bed, "gearbox"), "J_diff": J(bed, "differential"), "ratio": bed["shafts"]["output"]["ratio"],
        "J_wheel": J(car, "wheel_left"), "J_body": J(car, "body_left"),
        "drag_body": car["inertias"]["body_left"]["drag"],
        "slip": effects["tyre_slip"]["slip_stiffness"], "peak": effects["tyre_slip"]["peak"],
        "idle_full": effects["table"]["speed"][1], "idle_none": effects["table"]["speed"][2],
        "idle_torque": effects["table"]["torque"][1], "top": effects["table"]["speed"][3],
        "top_drag": -effects["table"]["torque"][3], "J_in": J(bed, "rotor_in"),
        "drag_in": bed["inertias"]["rotor_in"]["drag"], "J_adapter": J(bed, "adapter_left"),
        "J_rotor": J(bed, "rotor_left"), "drag_rotor": bed["inertias"]["rotor_left"]["drag"],
        "inverter": THREE(*(0.002 * off(0.2) for _ in range(3))), "gain": THREE(*(off(0.03) for _ in range(3))),
        "lag": THREE(*(0.0005 * off(0.2) for _ in range(3))),
        # half a sample of the dead time is that of the hold
        "delay": dead_time - STEP / 2 + (0.0 if draw is None else 0.0005 * draw.uniform(-1, 1)),
    }  # fmt: skip
    for key, data, name in (
        ("in", bed, "input_shaft"), ("out", bed, "output"), ("side", bed, "side_left"), ("car", car, "tyre_left"),
        ("flange", bed, "flange_left"),
    ):  # fmt: skip
        values[f"k_{key}"], values[f"c_{key}"] = shaft(data, name)
    for name, value in (values | changed).items():
        setattr(made, name, value)
    return made


def governed(of: Plant, speed: float) -> float:
    """As in the C, N·m."""
    points = of.idle_full, of.idle_none, of.top
    return float(np.interp(speed, points, (of.idle_torque, 0.0, -of.top_drag)))


def held(of: Plant, speed: float, road: float = 0.0) -> float:
    """Torque of the engine, N·m, that holds a speed (m/s), the clutch locked; ``road`` (N·m) pushes each body."""
    wheel = speed / RADIUS
    engine = wheel * of.ratio
    return 2 * (of.drag_body * wheel - road) / of.ratio + of.drag_engine * engine - governed(of, engine)


def ramp(time, begin, rise):
    """0 to 1 as a smooth step."""
    part = np.clip((time - begin) / rise, 0, 1)
    return part**2 * (3 - 2 * part)


def _at(array):
    return array.ctypes.data_as(ctypes.c_void_p)


@dataclass
class Driven:
    """Car (t, 7) as in the C; bed (t, 4): rotor of the input, input shaft, left side shaft, left rotor; faults (t,)."""

    car: np.ndarray
    bed: np.ndarray
    sent: np.ndarray
    faults: np.ndarray

    OF_CAR = (0, 2, 3, 4)  # hub, input shaft, left side shaft, left wheel: what the bed has to show

    def errors(self, first=0, last=None) -> np.ndarray:
        """rms of what is off over the range of the car's signal in a part (4,)."""
        car, bed = self.car[first:last, list(self.OF_CAR)], self.bed[first:last]
        return np.sqrt(np.mean((bed - car) ** 2, axis=0)) / np.maximum(np.ptp(car, axis=0), 1e-9)

    def largest(self, first=0, last=None) -> np.ndarray:
        """The largest deviation (4,), N·m or rad/s."""
        return np.abs(self.bed[first:last] - self.car[first:last, list(self.OF_CAR)]).max(axis=0)


class Clutched:
    """Cars and beds, stepped sample by sample with any controller."""

    def __init__(self, folder: Path):
        library = Path(folder) / "own_clutch.so"
        command = [compiler(), "-O2", "-shared", "-fPIC", str(HERE / "own_clutch.c"), "-lm", "-o", str(library)]
        subprocess.run(command, check=True)
        self._library = ctypes.CDLL(str(library))

    def drive(self, controller, step, of: Plant, speed: float, u: np.ndarray, draw, road: float = 0.0) -> Driven:
        """From a steady speed (m/s), the clutch locked; u (n, 4): torques of engine and bodies beside those that hold
        the speed, and what the clutch can carry. ``step`` (readings, known, mode, speeds, life) gives commands, mode
        and fault."""
        wheel, n = speed / RADIUS, len(u)
        load, engine, demand = 2 * (of.drag_body * wheel - road), wheel * of.ratio, held(of, speed, road)
        u = np.array(u, float)
        u[:, 0] += demand
        u[:, 1:3] += road
        s, seconds = np.zeros(14), ctypes.c_double(STEP)
        s[[0, 6, 13]], s[[1, 7, 8, 9, 10]] = engine, wheel
        s[2], s[3], s[4:6] = load / of.ratio / of.k_in, load / of.k_out, load / 2 / of.k_side
        s[11:13] = load / 2 / of.k_car
        car = np.zeros((n, 7))
        self._library.run_car(ctypes.byref(of), _at(s), n, seconds, _at(u), _at(car))
        b = np.zeros(19)
        b[[0, 6]], b[[1, 7, 8, 9, 10]] = engine, wheel
        names = list(controller.law.known)
        known = np.zeros((HELD + n, len(names)))
        for column, name in enumerate(("engine_torque", "road_left", "road_right", "clutch_torque")):
            if name in names:
                known[:, names.index(name)] = np.r_[np.full(HELD, u[0, column]), u[:, column]]
        known[:HELD, names.index("engine_torque")] = demand
        hold, noise = np.array([engine, wheel, wheel]), NOISE * draw.normal(size=(HELD + n, 6))
        sent, shown = np.zeros((LONGEST, 3)), np.zeros((HELD + n, 4))
        commands, faults = np.zeros((HELD + n, 3)), np.zeros(HELD + n, int)
        for at in range(HELD + n):
            self._library.show_bed(ctypes.byref(of), _at(b), _at(shown[at]))
            readings = np.r_[b[16:19], b[[6, 9, 10]]] + noise[at]
            commands[at], _, faults[at] = step(readings, known[at], HOLD if at < HELD else EMULATION, hold, at)
            sent[1:], sent[0] = sent[:-1].copy(), commands[at]
            self._library.step_bed(ctypes.byref(of), _at(b), seconds, _at(sent))
        return Driven(car, shown[HELD:], commands[HELD:], faults[HELD:])


def in_python(controller):
    """A step of the Python controller."""
    running = controller.running()

    def step(readings, known, mode, hold, life):
        found = running.step(readings, known, mode, hold, life)
        return found.commands, found.mode, found.fault

    return step


def in_c(batch):
    """A step of a :class:`ControllerBatch` of one row."""

    def step(readings, known, mode, hold, life):
        sent, modes, faults = batch.step(readings[:, None], known[:, None], mode, hold[:, None], life)
        return sent[:, 0], modes, int(faults[0])

    return step


LOCKED = 300.0  # N·m that a closed clutch can carry
SIGNALS = ("hub", "input shaft", "side shaft", "wheel")


def pull_away(random):
    """From standstill: the engine starts and idles, the clutch closes under load until it sticks, opens, and closes
    again under load. Inputs (t, 4), and parts."""
    torque, slipping = random.uniform(110, 160), random.uniform(120, 150)
    rise, opens = random.uniform(0.2, 0.6), random.uniform(0.03, 0.12)
    time = np.arange(9500) * STEP
    u = np.zeros((len(time), 4))
    u[:, 0] = 60 * ramp(time, 0.0, 0.01) + torque * (ramp(time, 1.0, 0.4) - ramp(time, 6.5, 0.05))
    u[:, 0] += random.uniform(80, 130) * ramp(time, 7.6, 0.2)
    again = random.uniform(70, 110)
    u[:, 3] = slipping * ramp(time, 1.0, rise) + (LOCKED - slipping) * ramp(time, 5.8, 0.1)
    u[:, 3] += again * ramp(time, 7.3, 0.15) + (LOCKED - again) * ramp(time, 8.3, 0.1) - LOCKED * ramp(time, 6.5, opens)
    parts = {"pull-away": (1000, 6000), "sticks": (5800, 6400), "opens": (6450, 7250), "closes": (7300, 9400)}
    return u, parts


def shifted(random, of: Plant):
    """From a steady speed, a tip-in, then as for a shift: the clutch opens, the engine's torque goes and comes, and the
    clutch closes, slipping first. Speed (m/s), inputs (t, 4), and parts."""
    time, speed = np.arange(3500) * STEP, random.uniform(20, 50) / 3.6
    tip, after, free = random.uniform(20, 120), random.uniform(20, 120), random.uniform(0, 30) - held(of, speed)
    opens, closes, wait = random.uniform(0.03, 0.2), random.uniform(0.05, 0.3), random.uniform(0.2, 0.6)
    slipping, back = random.uniform(60, 150), 1.0 + opens + wait
    u = np.zeros((len(time), 4))
    u[:, 0] = tip * ramp(time, 0.2, 0.1) + (free - tip) * ramp(time, 1.0, opens)
    u[:, 0] += (after - free) * ramp(time, back, closes + 0.1)
    u[:, 3] = LOCKED - LOCKED * ramp(time, 1.0, opens) + slipping * ramp(time, back, closes)
    u[:, 3] += (LOCKED - slipping) * ramp(time, back + closes + 0.4, 0.1)
    return speed, u, {"shift": (900, round((back + closes + 0.9) / STEP))}
