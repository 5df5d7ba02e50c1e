"""A diagnosis: time over the length of the recording and over the number of candidates, and a large case.

``python -m tests.benchmarks.diagnosis_growth [--large]`` prints a table; ``--large`` runs the large case only: ten
inertias, twelve sensors, 60 s at 1 kHz. The recordings are made by SciPy's exact discretisation of a linear chain with
a constant torque on one inertia that the model does not know.
"""

import sys
import time

import numpy as np
from scipy.signal import cont2discrete

from matching.diagnosis.diagnosis import diagnose
from matching.diagnosis.result import Diagnosis
from modelling.effects import EFFECTS
from modelling.files import from_dict
from modelling.recording import Recording
from modelling.system import System

RATE = 1000.0
NOISE = {"speed": 0.01, "torque": 0.05}


def chain(count: int, sensors: int) -> System:
    """``count`` inertias in a row, driven at both ends, speeds measured first, then shaft torques."""
    parts = {f"part{i}": {"J": 0.5 + 0.1 * i, "drag": {"value": 0.05, "tolerance": 0.5}} for i in range(count)}
    shafts = {
        f"shaft{i}": {
            "between": [f"part{i}", f"part{i + 1}"],
            "stiffness": {"value": 2000.0 + 150 * i, "tolerance": 0.1},
            "damping": {"value": 1.0, "tolerance": 0.5},
        }
        for i in range(count - 1)
    }
    every = [(f"part{i}", "speed") for i in range(count)] + [(f"shaft{i}", "torque") for i in range(count - 1)]
    read = {f"{what}_{of}": {"measures": what, "of": of, "uncertainty": NOISE[what]} for of, what in every[:sensors]}
    inputs = {"drive": {"on": "part0"}, "brake": {"on": f"part{count - 1}"}}
    return from_dict({"inertias": parts, "shafts": shafts, "inputs": inputs, "sensors": read})


def recording(system: System, seconds: float, hidden: float = -3.0) -> Recording:
    """Chain as written, but each value a little off, with a constant torque (N·m) on the middle inertia."""
    rng = np.random.default_rng(0)
    n, time_ = len(system.inertias), np.arange(round(seconds * RATE)) / RATE
    value = {name: q.value * (1 + 0.03 * rng.uniform(-1, 1) * q.uncertain) for name, q in system.parameters.items()}
    stiff, damp = np.zeros((n, n)), np.diag([value[f"inertias.part{i}.drag"] for i in range(n)])
    for i in range(n - 1):
        twist = np.zeros(n)
        twist[[i, i + 1]] = 1, -1
        stiff += value[f"shafts.shaft{i}.stiffness"] * np.outer(twist, twist)
        damp += value[f"shafts.shaft{i}.damping"] * np.outer(twist, twist)
    inverse = np.diag([1 / value[f"inertias.part{i}.J"] for i in range(n)])
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiff, -inverse @ damp]])
    B = np.vstack([np.zeros((n, 3)), inverse[:, [0, n - 1, n // 2]]])
    u = np.zeros((len(time_), 3))
    u[:, 0] = 20 * np.sin(2 * np.pi * (0.2 * time_ + 14 * time_**2 / seconds)) + 15 * np.sign(np.sin(1.1 * time_))
    u[:, 1] = -10 * np.sign(np.sin(0.7 * time_))
    u[:, 2] = hidden
    Ad, Bd, Cd, Dd, _ = cont2discrete((A, B, np.eye(2 * n), np.zeros((2 * n, 3))), 1 / RATE, "foh")
    z, x = np.zeros(2 * n), np.empty((len(time_), 2 * n))
    z = -Dd @ u[0]  # at rest
    for k in range(len(time_)):
        x[k] = Cd @ z + Dd @ u[k]
        z = Ad @ z + Bd @ u[k]
    channels = {"drive": u[:, 0], "brake": u[:, 1]}
    for sensor in system.sensors:
        i = int(sensor.of.removeprefix("part").removeprefix("shaft"))
        truth = x[:, n + i]
        if sensor.measures == "torque":
            twist, rate = x[:, i] - x[:, i + 1], x[:, n + i] - x[:, n + i + 1]
            truth = value[f"shafts.shaft{i}.stiffness"] * twist + value[f"shafts.shaft{i}.damping"] * rate
        channels[sensor.name] = truth + NOISE[sensor.measures] * rng.standard_normal(len(truth))
    return Recording(time_, channels, (), "made.csv")


def timed(count: int, sensors: int, seconds: float) -> tuple[float, Diagnosis, int]:
    """Seconds of one diagnosis, what it found, and how many candidates (kind and place) there were."""
    system = chain(count, sensors)
    data = recording(system, seconds)
    diagnose(system, [recording(system, 2.0)])  # compiles what is needed
    candidates = sum(len(kind.places(system)) for kind in EFFECTS.values())
    began = time.perf_counter()
    found = diagnose(system, [data])
    return time.perf_counter() - began, found, candidates


def line(count: int, sensors: int, seconds: float) -> None:
    took, found, candidates = timed(count, sensors, seconds)
    named = ", ".join(f"{cause.kind} at {cause.at}" for cause in found.causes)
    print(
        f"{count:8d} {sensors:8d} {seconds:6g} s {candidates:10d} {took:8.1f} s  {found.verdict}: {named}", flush=True
    )


def main() -> None:
    print(f"{'inertias':>8} {'sensors':>8} {'length':>8} {'candidates':>10} {'time':>10}  answer")
    if "--large" not in sys.argv:
        for seconds in (7.5, 15.0, 30.0, 60.0):
            line(3, 4, seconds)
        for count in (2, 4, 6, 8):
            line(count, count + 1, 10.0)
    line(10, 12, 60.0)


if __name__ == "__main__":
    main()
