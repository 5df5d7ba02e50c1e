"""The bed of ``drifting_bed.c``: an exported controller for minutes and hours on a bed whose values drift."""

import ctypes
import subprocess
from pathlib import Path

import numpy as np
from driving.own_bed import ONE, TWO, Plant, held_motor, inputs, ramp
from needs import compiler

from modelling.controller.c_source import c_sources

HERE = Path(__file__).parent
SIDES = ("left", "right")
STEP, PIECES = 1e-3, 16  # s; fine steps a sample
COLUMNS = 22
FLANGE, ROTOR, SENT, GAIN, ZERO, DELAY, DRIFTED = 2, 4, 6, 8, 12, 16, 20  # of its output; value, uncertainty by side


class Drift(ctypes.Structure):
    """From one second to another, straight: dead times in s, gains as shares, zeros in N·m, left and right."""

    _fields_ = [("first", ONE), ("last", ONE), ("delay", TWO), ("gain", TWO), ("zero", TWO)]


NONE = Drift(1e9, 2e9)


class DriftingBed:
    """An exported controller with its case's sensors, compiled with the bed."""

    def __init__(self, controller, folder: Path):
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in c_sources(controller).items():
            (folder / name).write_text(text)
        command = [compiler(), "-std=c99", "-O2", "-shared", "-fPIC", "-I.", str(HERE / "drifting_bed.c")]
        subprocess.run([*command, "controller.c", "-o", "all.so", "-lm"], cwd=folder, check=True)
        self._library = ctypes.CDLL(str(folder / "all.so"))
        sensors, known = list(controller.law.sensors), list(controller.law.known)
        sides = [f"{what}_{side}_{unit}" for what, unit in (("flange", "torque"), ("rotor", "speed")) for side in SIDES]
        torques = ["motor_torque", *(f"{what}_{side}" for what in ("brake", "road") for side in SIDES)]
        self._channel, self._known = (
            (ctypes.c_int * 5)(*(have.index(one) if one in have else -1 for one in wanted))
            for have, wanted in ((sensors, [*sides, "motor_speed"]), (known, torques))
        )

    def run(
        self, of: Plant, speed: float, u: np.ndarray, seconds: float, drift: Drift = NONE, hold=1.0, seed=1, every=1000
    ) -> np.ndarray:
        """Output (t, COLUMNS), a row for ``every`` samples, of inputs u (t, 8) that repeat, from a speed in rad/s."""
        u, samples = np.ascontiguousarray(u), round(seconds / STEP)
        out = np.zeros((samples // every, COLUMNS))
        double = ctypes.POINTER(ctypes.c_double)
        self._library.run_drifting(
            ctypes.byref(of), ctypes.c_double(held_motor(of, speed)[1]), u.ctypes.data_as(double), len(u), samples,
            round(hold / STEP), ctypes.c_double(STEP), PIECES, self._channel, self._known, ctypes.byref(drift),
            ctypes.c_ulonglong(seed), every, out.ctypes.data_as(double),
        )  # fmt: skip
        return out


def tip_ins(random: np.random.Generator, of: Plant, speed: float, seconds: int = 60) -> np.ndarray:
    """Inputs (t, 8) of a drive that repeats: torques drawn within ± 70 N·m about the one that holds the speed."""
    time, base = np.arange(seconds * 1000) * STEP, held_motor(of, speed)[0]
    torque, level, at = np.zeros(len(time)), 0.0, 1.0
    while at < seconds - 6:
        wanted = random.uniform(-70, 70)
        torque += (wanted - level) * ramp(time, at, random.uniform(0.1, 0.6))
        level, at = wanted, at + random.uniform(1.5, 5)
    torque -= level * ramp(time, seconds - 3, 0.5)
    return inputs(time, base + torque - torque.mean())


def truth(of: Plant, side: int) -> tuple[float, float]:
    """Gain, and seconds of dead time and lags more than planned, that the readings of a drawn bed show."""
    late = (of.delay - 0.0025) + (of.inverter[side] - 0.002) + (of.flange_lag[side] - 0.0005)
    return of.gain[side] * of.flange_gain[side], late
