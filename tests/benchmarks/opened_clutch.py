"""Whether an observer could notice an opened clutch sooner: `python -m tests.benchmarks.opened_clutch [--beds N]`.

A clutch between motor and gearbox of the reference drive opens under load, on drawn beds with noise. What the readings
of the motor's speed and of the flange torques are off from what the observer expects (its innovations) is averaged over
three samples, with the sign of the flange torque and over it: the motor runs away, and the flange torque falls.
Thresholds are the least that all these beds reach within :data:`NOTICED_WITHIN` samples. Beside it beds with everything
wrong, lash and driving torques that change fast, where nothing opens: what part of the thresholds they reach.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from matching.fmu.controller import exported_controller
from matching.frequency.beds.tuner import tuner
from matching.frequency.case.case import Case
from matching.frequency.case.load import load_case
from matching.frequency.case.uncertainty import of_system
from matching.frequency.in_time.closed_loop import BedRun, bed_motions
from matching.frequency.in_time.imperfection import Imperfection
from matching.frequency.loop.control_law import control_law
from matching.frequency.loop.parts import parts_of
from matching.frequency.tuning.tune import tuned_weights
from modelling.bed.observer.model import NOISE
from modelling.controller.law import ControlLaw
from tests.benchmarks.observer_table import CASE
from tests.fmu.linear_bed import LinearBed

AVERAGED, NOTICED_WITHIN = 3, 5  # samples
LOADED_N_M = 300.0  # of a flange: `lost_torque`
LEVELS_N_M = (75.0, 100.0, 150.0)  # of the motor when the clutch opens
OPENS, LAST, SETTLED = 640, 660, 2500  # samples
OPEN = {"shafts.gear_mesh.stiffness": 1e-6, "shafts.gear_mesh.damping": 1e-6}
LASHES_RAD = (0.0, 0.02, 0.0873)  # none, 1.1° and 5°
FRICTION_N_M = 18.0


class Recorder:
    """Stands in for the correction L of a law and keeps the innovations that it is applied to."""

    def __init__(self, L: np.ndarray):
        self.innovations: list[np.ndarray] = []
        self._L = L

    def __matmul__(self, innovation: np.ndarray) -> np.ndarray:
        self.innovations.append(innovation)
        corrected: np.ndarray = self._L @ innovation
        return corrected


def opened(case: Case, law: ControlLaw, values: dict[str, float], level: float, seed: int) -> np.ndarray:
    """Speed and torque shares (t, 2) of a bed whose clutch opens at sample :data:`OPENS`."""
    rig, rng = case.rig.with_values(of_system(values, case.rig)), np.random.default_rng(seed)
    bed = LinearBed(parts_of(replace(case, rig=rig)), case.loop)
    broken = LinearBed(parts_of(replace(case, rig=rig.with_values(OPEN))), case.loop).half
    noise = np.array([NOISE["torque"] if "torque" in name else NOISE["speed"] for name in law.sensors])
    state, innovations, flanges = np.zeros(len(law.A)), [], []
    drive = level * np.clip((np.arange(LAST + 1) - 100) / 50, 0, 1)
    for n in range(LAST):
        if n == OPENS:
            bed.half = broken
        readings = bed.readings() + noise * rng.standard_normal(len(noise))
        innovations.append(readings - law.E @ state)
        flanges.append(readings[:2])
        known = np.array([drive[n] if name == "motor_torque" else 0.0 for name in law.known])
        sent, state = law.step(state, readings, known, np.full(2, np.inf))
        bed.step(sent, drive[n : n + 1], drive[n + 1 : n + 2])
    return shares(law, np.array(innovations)[:, :, None], np.array(flanges)[:, :, None])[:, :, 0]


def shares(law: ControlLaw, innovations: np.ndarray, flanges: np.ndarray) -> np.ndarray:
    """Means over three samples over the flange torque (t, 2, b): of the motor's speed, of the flange torque's fall.

    Innovations (t, y, b), flange torques (t, 2, b); 0 where no flange is loaded.
    """
    total = flanges.sum(axis=1)
    off = np.stack([innovations[:, law.sensors.index("motor_speed")], -innovations[:, :2].sum(axis=1)], axis=1)
    signed = off * np.sign(total)[:, None]
    mean = np.stack([signed[i : len(signed) + 1 - AVERAGED + i] for i in range(AVERAGED)]).mean(axis=0)
    now = slice(AVERAGED - 1, None)
    loaded = np.abs(flanges[now]).max(axis=1) > LOADED_N_M
    return np.where(loaded[:, None], mean / np.maximum(np.abs(total[now]), 1.0)[:, None], 0.0)


def driving_torques(step: float) -> Iterator[tuple[str, np.ndarray]]:
    """Torques of the motor (t,), N·m, by what they are."""
    time = np.arange(SETTLED) * step
    yield "tip-in in 50 ms", 100 * np.clip((time - 0.2) / 0.05, 0, 1)
    yield "tip-in in 5 ms", 100 * np.clip((time - 0.2) / 0.005, 0, 1)
    yield (
        "tip-in and tip-out in 10 ms",
        100 * np.clip((time - 0.2) / 0.01, 0, 1) - 200 * np.clip((time - 1) / 0.01, 0, 1),
    )
    yield "150 N·m in 2 ms", 150 * np.clip((time - 0.2) / 0.002, 0, 1) - 250 * np.clip((time - 1) / 0.002, 0, 1)


def main() -> None:
    """Print thresholds, and what is reached where nothing opens."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--beds", type=int, default=12)
    beds = parser.parse_args().beds
    case = load_case(CASE)
    case = replace(case, loop=case.loop.with_values(tuned_weights(tuner(case))[0]))
    values = [case.uncertainty.at(position) for position in case.uncertainty.draw(beds, 0)]
    law, step = exported_controller(case).law, case.loop["sample_time"]
    after = slice(OPENS + 1 - AVERAGED + 1, OPENS + NOTICED_WITHIN - AVERAGED + 2)
    reached = [[opened(case, law, of_bed, level, i)[after] for i, of_bed in enumerate(values)] for level in LEVELS_N_M]
    best = [[rows[np.argmax((rows / [1e-3, 0.05]).min(axis=1))] for rows in of_level] for of_level in reached]
    least = np.min(best, axis=(0, 1))
    print(f"thresholds: {least[0] * 1e3:.2f} rad/s and {least[1] * 1e3:.0f} N·m for 1000 N·m at the flanges")
    print("| | " + " | ".join(f"lash {gap:g} rad" for gap in LASHES_RAD) + " |\n|---|" + "---|" * len(LASHES_RAD))
    for words, torque in driving_torques(step):
        cells = [f"{normal(case, values, torque, gap, least):.2f}" for gap in LASHES_RAD]
        print(f"| {words} | {' | '.join(cells)} |", flush=True)


def normal(case: Case, values: list[dict[str, float]], torque: np.ndarray, gap: float, least: np.ndarray) -> float:
    """Largest part of both thresholds that is reached at once where nothing opens, torque measured and unmeasured."""
    names = [dynamometer.torque_sensor for dynamometer in case.loop.dynamometers]
    law, largest = control_law(parts_of(case)), 0.0
    for known in (("motor_torque",), ()):
        recorder = Recorder(law.L)
        wrong = [Imperfection("", of_bed, gap, FRICTION_N_M, 1.05, 5e-3, True) for of_bed in values]
        runs = [BedRun(bed, {"motor_torque": torque}, known) for bed in wrong]
        motions = bed_motions(case, replace(law, L=recorder), runs, names)  # type: ignore[arg-type]
        flanges = np.stack([motion.readings for motion in motions if motion is not None], axis=2)
        both = shares(law, np.array(recorder.innovations), flanges)
        largest = max(largest, float((both / least[:, None]).min(axis=1).max()))
    return largest


if __name__ == "__main__":
    main()
