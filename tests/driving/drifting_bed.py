"""The bed of ``drifting_bed.c``: an exported controller for minutes and hours on a bed whose values drift."""

import ctypes
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from driving.own_bed import ONE, TWO, Plant, held_motor, inputs, plant, ramp
from matplotlib.figure import Figure
from needs import compiler

from matching.export import exported_controller
from matching.match.case_file import load_case
from matching.report import common as style
from modelling.controller.c_source import c_sources

HERE = Path(__file__).parent
EXAMPLE = HERE.parents[1] / "examples" / "drive_away"
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


def tracked_picture() -> Figure:
    """What is tracked of both dynamometers, next to the truth: the left one drifts from the 2nd to the 7th minute."""
    controller = exported_controller(load_case(EXAMPLE / "case.toml"))
    random = np.random.default_rng(8)
    of, speed = plant(EXAMPLE / "vehicle.toml", EXAMPLE / "rig.toml", 0.0025, draw=random), 50.0
    away = Drift(120, 420, (1e-3, 0.0), (0.05, 0.0), (-10.0, 0.0))
    with TemporaryDirectory() as folder:
        rows = DriftingBed(controller, Path(folder)).run(of, speed, tip_ins(random, of, speed), 600, away)
    minutes = np.arange(1, len(rows) + 1) / 60
    gone = np.clip((60 * minutes - 120) / 300, 0, 1)
    panels = (
        ("torque gain", GAIN, 1.0, 1), ("zero of the flange in N·m", ZERO, 1.0, 2),
        ("dead time beyond\nplanned in ms", DELAY, 1e3, 4),
    )  # fmt: skip
    with style.styled():
        drawn = style.figure(7.2, 6.0)
        rows_of = enumerate(zip(drawn.subplots(3, 1, sharex=True), panels, strict=True))
        for number, (axes, (label, at, scale, bit)) in rows_of:
            for side, colour in enumerate((style.VEHICLE, style.RIG)):
                gain, late = truth(of, side)
                true = (
                    gain * (1 + gone * away.gain[side]), gone * away.zero[side], late + gone * away.delay[side],
                )[number]  # fmt: skip
                value, u = (scale * rows[:, at + 2 * side + k] for k in range(2))
                known = minutes > 0.4  # before it nothing is known
                axes.fill_between(
                    minutes[known],
                    (value - 2 * u)[known],
                    (value + 2 * u)[known],
                    color=colour,
                    alpha=0.25,
                    linewidth=0,
                )
                axes.plot(minutes[known], value[known], color=colour, label=f"{SIDES[side]}, tracked (± 2 u)")
                axes.plot(minutes, scale * true, "--", color=style.INK, linewidth=0.9, label="true" if side else None)
                warned = np.flatnonzero(rows[:, DRIFTED + side].astype(int) & bit)
                if len(warned):
                    axes.axvline(minutes[warned[0]], color=style.LIMIT, linestyle=":", label="warning begins")
            axes.set_ylabel(label)
        drawn.axes[0].legend(loc="upper left", fontsize="small")
        drawn.axes[-1].set_xlabel("time in min")
    return drawn
