"""The car with an engine and the axle bed of ``own_engine.c``: values from files, drawn beds, amplitudes by order."""

import ctypes
import subprocess
import tomllib
from pathlib import Path

import numpy as np
from needs import compiler
from scipy.optimize import brentq

from modelling.controller.c_source import c_sources

HERE = Path(__file__).parent
CASE = HERE / "engine" / "case.toml"
ONE, THREE = ctypes.c_double, ctypes.c_double * 3
MOST = 8  # speeds, and pedals, of a torque map
STEP, HELD, RADIUS = 1e-3, 1500, 0.3  # s, samples of speed hold, m
SHAPE = 1.65  # of a tyre's curve, as in the C
NOISE = (0.2, 0.35, 0.35), (0.05, 0.05, 0.05)  # N·m, rad/s of the machines
NAMES = (
    *("J_engine", "drag_engine", "J_gear", "J_diff", "ratio", "k_in", "c_in", "k_out", "c_out", "k_side", "c_side"),
    *("J_wheel", "J_body", "drag_body", "k_car", "c_car", "slip", "peak", "order", "pulse", "phase"),
    *("idle_full", "idle_none", "idle_torque", "top", "top_drag"),
    *("J_in", "drag_in", "J_adapter", "J_rotor", "drag_rotor", "k_flange", "c_flange"),
)


class Plant(ctypes.Structure):
    """As in the C."""

    _fields_ = [
        *((name, ONE) for name in NAMES), ("inverter", THREE), ("gain", THREE), ("lag", THREE), ("delay", ONE),
        ("noise_torque", THREE), ("noise_speed", THREE), ("speeds", ONE), ("pedals", ONE),
        *((name, ctypes.c_double * MOST) for name in ("map_speed", "map_pedal")), ("map", ctypes.c_double * MOST**2),
    ]  # fmt: skip


def plant(draw=None, dead_time=0.003, **changed) -> Plant:
    """Car and bed of the case's files; ``draw`` (a generator) makes bed and specimen one within the case's box."""
    car, bed = (tomllib.loads((CASE.parent / name).read_text()) for name in ("vehicle.toml", "rig.toml"))
    effects = {one["kind"]: one for one in car["effects"]}

    def off(most):
        return 1.0 if draw is None else 1.0 + most * draw.uniform(-1, 1)

    def J(data, name, most=0.05):
        return data["inertias"][name]["J"] * (off(most) if data is bed else 1.0)

    def shaft(data, name):
        one, drawn = data["shafts"][name], data is bed
        return one["stiffness"] * (off(0.05) if drawn else 1.0), one["damping"] * (off(0.3) if drawn else 1.0)

    made = Plant()
    values = {
        "J_engine": J(car, "engine"), "drag_engine": car["inertias"]["engine"]["drag"], "J_gear": J(bed, "gearbox"),
        "J_diff": J(bed, "differential"), "ratio": bed["shafts"]["output"]["ratio"], "J_wheel": J(car, "wheel_left"),
        "J_body": J(car, "body_left"), "drag_body": car["inertias"]["body_left"]["drag"],
        "slip": effects["tyre_slip"]["slip_stiffness"], "peak": effects["tyre_slip"]["peak"],
        "order": effects["torque_ripple"]["order"], "pulse": effects["torque_ripple"]["amplitude"],
        "phase": effects["torque_ripple"]["phase"], "idle_full": effects["table"]["speed"][1],
        "idle_none": effects["table"]["speed"][2], "idle_torque": effects["table"]["torque"][1],
        "top": effects["table"]["speed"][3], "top_drag": -effects["table"]["torque"][3], "J_in": J(bed, "rotor_in"),
        "drag_in": bed["inertias"]["rotor_in"]["drag"], "J_adapter": J(bed, "adapter_left"),
        "J_rotor": J(bed, "rotor_left"), "drag_rotor": bed["inertias"]["rotor_left"]["drag"],
        "inverter": THREE(*(0.002 * off(0.2) for _ in range(3))), "gain": THREE(*(off(0.03) for _ in range(3))),
        "lag": THREE(*(0.0005 * off(0.2) for _ in range(3))),
        # half a sample of the dead time is that of the hold
        "delay": dead_time - STEP / 2 + (0.0 if draw is None else 0.0005 * draw.uniform(-1, 1)),
        "noise_torque": THREE(*NOISE[0]), "noise_speed": THREE(*NOISE[1]),
    }  # fmt: skip
    for key, data, name in (
        ("in", bed, "input_shaft"), ("out", bed, "output"), ("side", bed, "side_left"), ("car", car, "tyre_left"),
        ("flange", bed, "flange_left"),
    ):  # fmt: skip
        values[f"k_{key}"], values[f"c_{key}"] = shaft(data, name)
    for name, value in (values | changed).items():
        setattr(made, name, value)
    return made


def with_map(plant: Plant, speeds, pedals, torques) -> Plant:
    """The same with a torque map: speeds (n,) in rad/s, pedals (m,), torques (n, m) in N·m; nothing else governs it."""
    plant.speeds, plant.pedals = len(speeds), len(pedals)
    for field, values in (("map_speed", speeds), ("map_pedal", pedals), ("map", np.ravel(torques))):
        getattr(plant, field)[: len(values)] = [float(value) for value in values]
    for name in ("pulse", "idle_torque", "top_drag"):
        setattr(plant, name, 0.0)
    return plant


def pedal_for(plant: Plant, speed: float, torque: float) -> float:
    """The pedal with which the map gives a torque at a speed."""
    n, m = int(plant.speeds), int(plant.pedals)
    speeds, pedals, rows = plant.map_speed[:n], plant.map_pedal[:m], np.reshape(plant.map[: n * m], (n, m))
    over = [np.interp(speed, speeds, column) for column in rows.T]
    return float(brentq(lambda pedal: np.interp(pedal, pedals, over) - torque, pedals[0], pedals[-1]))


def governed(plant: Plant, speed: float) -> float:
    """As in the C, N·m."""
    points = plant.idle_full, plant.idle_none, plant.top
    return float(np.interp(speed, points, (plant.idle_torque, 0.0, -plant.top_drag)))


def _at(array):
    return array.ctypes.data_as(ctypes.c_void_p)


class Engine:
    """Cars and beds under one exported controller."""

    def __init__(self, controller, folder: Path):
        self.known, folder = list(controller.law.known), Path(folder)
        for name, text in c_sources(controller).items():
            (folder / name).write_text(text)
        library = folder / "own_engine.so"
        sources = [HERE / "own_engine.c", *sorted(folder.glob("*.c"))]
        subprocess.run(
            [compiler(), "-O2", "-shared", "-fPIC", f"-I{folder}", *map(str, sources), "-lm", "-o", str(library)],
            check=True,
        )  # fmt: skip
        self._library = ctypes.CDLL(str(library))

    def drive(self, plant: Plant, speed: float, torque: np.ndarray, draw, road: float = 0.0):
        """From a steady speed (m/s): the car's and the bed's rows, and where emulation ended (-1: nowhere).

        ``torque`` (n,) in N·m, with a map a pedal, is added to the engine's, which holds the speed, ``road`` to each
        body from then on.
        """
        wheel, n = speed / RADIUS, len(torque)
        carried = SHAPE * plant.peak * np.tan(np.arcsin(plant.drag_body * wheel / plant.peak) / SHAPE)
        body = wheel / (1 + carried / plant.slip)  # its tyres slip
        load = 2 * plant.drag_body * body  # N·m at the differential
        engine = wheel * plant.ratio
        demand = load / plant.ratio + plant.drag_engine * engine - governed(plant, engine)
        if plant.speeds:
            demand = pedal_for(plant, engine, load / plant.ratio + plant.drag_engine * engine)
        s = np.zeros(14)
        s[[0, 6]], s[[1, 8, 9]], s[10:12], s[12:14] = engine, wheel, body, carried / plant.k_car
        s[2], s[3], s[4:6] = load / plant.ratio / plant.k_in, load / plant.k_out, load / 2 / plant.k_side
        u = np.zeros((n, 3))
        u[:, 0], u[:, 1:] = demand + torque, road
        car, bed = np.zeros((n, 6)), np.zeros((HELD + n, 8))
        self._library.run_car(ctypes.byref(plant), _at(s), n, _at(u), _at(car))
        b = np.zeros(21)
        b[[0, 6]], b[[1, 8, 9, 10, 11]] = engine, wheel
        known = np.zeros((HELD + n, self._library.known_torques()))
        column = self.known.index("pedal" if plant.speeds else "engine_torque")
        known[:, column] = demand
        known[HELD:, column] += torque
        for side in ("left", "right"):
            known[HELD:, self.known.index(f"road_{side}")] = road
        noise, hold = draw.normal(size=(HELD + n, 6)), np.array([engine, wheel, wheel])
        ended = self._library.run_bed(
            ctypes.byref(plant), _at(b), HELD + n, HELD, _at(hold), _at(known), _at(noise), _at(bed)
        )
        return car, bed[HELD:], ended


def amplitudes(order: float, rows: np.ndarray, window: int = 300) -> np.ndarray:
    """Amplitude of an order (w,), N·m, of the torque of the input shaft over the engine's angle, window by window."""
    time, found = np.linspace(-1, 1, window), []
    for at in range(0, len(rows) - window + 1, window):
        phase = order * rows[at : at + window, 1]
        fitted = np.stack([np.ones(window), time, time**2, np.cos(phase), np.sin(phase)], axis=1)
        of = np.linalg.lstsq(fitted, rows[at : at + window, 2])[0]
        found.append(float(np.hypot(of[3], of[4])))
    return np.array(found)


def frequencies(order: float, rows: np.ndarray, window: int = 300) -> np.ndarray:
    """Hz (w,) of the order in the middle of each window."""
    at = np.arange(0, len(rows) - window + 1, window) + window // 2
    return order * rows[at, 0] / (2 * np.pi)
