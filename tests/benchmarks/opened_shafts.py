"""Whether opened shafts are noticed within five samples, and nothing else: `python -m tests.benchmarks.opened_shafts`.

Fresh beds of cases on the truth plant's engine, under the exported controller with its supervision. Shafts open under
load; and where none opens, driving torques that change fast act, measured and unmeasured, 5 % high and 5 ms late, with
lash in one shaft at a time, dry friction, noise, encoders, and kicks of the road. ``--case FILE…`` takes tuned cases,
``--drawn SEED…`` drawn ones (`tests/beds/drawn_cases.py`) at their start values, ``--beds N`` beds of each.
"""

import argparse
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from beds.drawn_cases import draw
from beds.plant_loop import air_gap, behind_lag, plant_model
from plant.engine import simulate

from matching.export import exported_controller
from matching.match.case import Case, of_system
from matching.match.case_file import load_case
from modelling.controller.law import EMULATION, NO_LIMIT, TORQUE_GONE, ExportedController
from modelling.errors import InputError

FINE = 2  # parts of a sample
SEED = 4242  # of beds and noise; no design draws from it
COUNT_RAD, NOISE_TORQUE, NOISE_SPEED = 2 * np.pi / 8192, 0.35, 0.084
BROKEN = 1e-6  # N·m/rad of a shaft that is open
OPENS_S, LASTS_S = 0.45, 0.9
LASHES_RAD = (0.0, 0.02, 0.0873)  # none, 1.1° and 5°
HIGH, LATE_S = 1.05, 5e-3
FRICTION_SHARE = 0.02  # of the flange torque that the dynamometers' limit allows
KICK_SHARE = 0.3  # of the same limit, of the road
TOO_FAST = 1e5  # rad/s: a bed that is not stable


@dataclass
class Trial:
    """What happens on a bed: torques by input (t,), what the controller knows of them, lash (shaft, rad), friction."""

    words: str
    torques: dict
    told: dict
    lash: tuple = ("", 0.0)
    friction: float = 0.0
    opens: str = ""
    from_sample: int = 0


class Sensing:
    """Noise, encoders that count, gains of the torque sensors."""

    def __init__(self, law, gains, seed):
        self.random = np.random.default_rng([SEED, seed])
        self.speeds = np.array(["torque" not in name for name in law.sensors])
        self.noise = np.where(self.speeds, NOISE_SPEED, NOISE_TORQUE)
        self.gains, self.step = gains, law.sample_time
        self.angle = self.counted = np.zeros(len(gains))

    def read(self, true):
        self.angle = self.angle + self.step * true
        counted = np.floor(self.angle / COUNT_RAD) * COUNT_RAD
        speed, self.counted = (counted - self.counted) / self.step, counted
        return self.gains * np.where(self.speeds, speed, true) + self.noise * self.random.standard_normal(len(true))


def run(controller: ExportedController, case: Case, values: dict, trial: Trial, seed: int) -> tuple:
    """Sample of the first alarm (or None), number of its fault, and the torque in the opened shaft before it opened.

    Faults other than a torque that is gone, and the older rule for it, are switched off where no shaft opens.
    """
    law, loop = controller.law, case.loop
    dynos, k, step = loop.dynamometers, len(loop.dynamometers), law.sample_time
    shaft, gap = trial.lash
    rubbing = (next(part.on for part in case.rig.inputs if part.name not in {d.torque_input for d in dynos}),)
    model = plant_model(
        case.rig, of_system(values, case.rig), gap, (shaft,) if gap else (), trial.friction, rubbing
    )  # fmt: skip
    chain, n = model.chain, model.chain.n
    fastest = chain.fastest()
    chain.fastest = lambda: fastest  # it does not change from sample to sample
    gains = np.array([values.get(f"dynamometers.{dyno.name}.torque_gain", 1.0) for dyno in dynos])
    lags = [values.get(f"loop.{name}", loop[name]) for name in ("inverter_lag", "torque_sensor_lag")]
    delay = max(values.get("loop.dead_time", loop["dead_time"]) - step / 2, 0.0)
    sensing = Sensing(law, np.array([values.get(f"sensors.{name}.gain", 1.0) for name in law.sensors]), seed)
    count = len(next(iter(trial.torques.values())))
    known = np.stack([trial.told.get(name, np.zeros(count)) for name in law.known], axis=1).reshape(count, -1)
    driven = [model.inputs.index(dyno.torque_input) for dyno in dynos]
    running, issued = controller.running(), np.zeros((count, k))
    x, air, flange, torque = np.zeros(2 * n), np.zeros(k), np.zeros(k), np.zeros(chain.s)
    grid, carried = np.arange(FINE + 1) * step / FINE, 0.0
    for s in range(count):
        if trial.opens and s == trial.from_sample:
            j = model.shafts.index(trial.opens)
            carried = float(torque[j])
            for key in ("k", "c"):
                chain[key][[j, chain.s + j]] = BROKEN
        true = np.array([*flange, *(model.reading(name, x[n:], torque) for name in law.sensors[k:])])
        answer = running.step(sensing.read(true), known[s], EMULATION, np.zeros(k))
        if answer.fault:
            return s, answer.fault, carried
        if np.abs(x[n:]).max() > TOO_FAST:
            raise FloatingPointError
        issued[s] = answer.commands
        inputs, later = np.zeros((FINE + 1, len(model.inputs))), min(s + 1, count - 1)
        for name, acts in trial.torques.items():
            if name in model.inputs:
                inputs[:, model.inputs.index(name)] = acts[s] + (acts[later] - acts[s]) * grid / step
        inputs[:, driven] = gains * air_gap(air, issued, s, delay, step, grid, lags[0])
        air = inputs[-1, driven] / gains
        motion = simulate(chain, inputs, x, step / FINE)
        x, torque = np.concatenate([motion.angle[-1], motion.speed[-1]]), motion.torque[-1]
        for i, dyno in enumerate(dynos):
            measured = model.reading(dyno.torque_sensor, motion.speed, motion.torque)
            flange[i] = behind_lag(flange[i], measured, step / FINE, lags[1])
    return None, 0, carried


def shapes(time: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Torques of the drive over their level (t,), by what they are."""

    def ramp(at, over):
        return np.clip((time - at) / over, 0, 1)

    yield "tip-in in 50 ms", ramp(0.1, 0.05)
    yield "tip-in in 5 ms", ramp(0.1, 0.005)
    yield "tip-in and tip-out in 10 ms", ramp(0.1, 0.01) - 2 * ramp(0.5, 0.01)
    yield "1.5 in 2 ms, then 2.5 less", 1.5 * ramp(0.1, 0.002) - 2.5 * ramp(0.5, 0.002)


def drive_of(case: Case) -> tuple[str, float]:
    """The input of the rig that drives, and its level: a third of what balances the dynamometers' limit of torque."""
    driven = {dyno.torque_input for dyno in case.loop.dynamometers}
    name = next(part.name for part in case.rig.inputs if part.name not in driven)
    ratio = np.prod([part.ratio.value for part in case.rig.shafts if part.ratio is not None] or [1.0])
    flanges = case.limits["dynamometer_torque"] * len(case.loop.dynamometers)
    return name, float(flanges / ratio / 3)


def opening_trials(case: Case, shafts: list[str]) -> Iterator[Trial]:
    """Every shaft opens at three levels, under a torque that is measured."""
    step = case.loop["sample_time"]
    time = np.arange(0, OPENS_S + 12 * step, step)
    name, level = drive_of(case)
    for share in (0.6, 1.0, 1.4):
        torque = {name: share * level * np.clip((time - 0.1) / 0.05, 0, 1)}
        for shaft in shafts:
            yield Trial(f"{shaft} opens", torque, torque, opens=shaft, from_sample=round(OPENS_S / step))


def normal_trials(case: Case, controller: ExportedController, lashed: list[str]) -> Iterator[Trial]:
    """Nothing opens; some shafts have lash."""
    step = case.loop["sample_time"]
    time = np.arange(0, LASTS_S, step)
    name, level = drive_of(case)
    friction = FRICTION_SHARE * case.limits["dynamometer_torque"]
    for words, shape in shapes(time):
        demanded = level * shape
        acts = {name: HIGH * np.interp(time - LATE_S, time, demanded)}
        for told in ({name: demanded}, {}):
            for gap in LASHES_RAD:
                for shaft in lashed if gap else [""]:
                    known = ", measured" if told else ", unmeasured"
                    yield Trial(f"{words}{known}", acts, told, (shaft, gap), friction)
    held = level * np.clip((time - 0.1) / 0.05, 0, 1)
    on_rig = {part.name for part in case.rig.inputs}
    for road in [part for part in controller.law.known if part not in on_rig][-1:]:
        kick = KICK_SHARE * case.limits["dynamometer_torque"] * np.clip((time - 0.5) / 0.005, 0, 1)
        yield Trial(f"kick of {road} under load", {name: held}, {name: held, road: kick}, friction=friction)


def judge(case: Case, beds: int, words: str) -> None:
    """Print what is noticed on fresh beds of a case."""
    controller = exported_controller(case)
    settings, watched = controller.settings, controller.watched.shafts
    stated = {row.shaft: row for row in controller.shafts}
    none = np.full(len(controller.law.dynamometers), NO_LIMIT)
    alone = replace(
        controller,
        settings=replace(
            settings, lost_torque=none, speed_limit=none, unexpected=np.full(len(controller.law.sensors), NO_LIMIT),
            frozen_samples=0,
        ),
    )  # fmt: skip
    quiet = replace(controller, settings=replace(settings, frozen_samples=0, speed_limit=none))
    values = [case.uncertainty.at(at) for at in case.uncertainty.draw(beds, SEED)]
    shafts = [part.name for part in case.rig.shafts]
    cut = [dyno.follows for dyno in case.loop.dynamometers if dyno.follows in shafts]
    lashed = list(dict.fromkeys([*watched, *cut[:1]]))
    noticed, alarms, runs, lost = {}, [], 0, 0
    for i, of_bed in enumerate(values):
        for trial in opening_trials(case, shafts):
            try:
                at, fault, carried = run(quiet, case, of_bed, trial, i)
            except FloatingPointError:
                lost += 1
                continue
            enough = abs(carried) > 1.1 * (stated[trial.opens].from_torque or 0.0)
            if at is not None and at <= trial.from_sample:
                alarms.append((trial.words, trial.lash, fault, at))
                continue
            in_time = at is not None and at <= trial.from_sample + 5 and fault == TORQUE_GONE
            noticed.setdefault(trial.opens, []).append((enough, in_time, at and at - trial.from_sample, carried))
        for trial in normal_trials(case, controller, lashed) if watched else ():
            try:
                at, fault, _ = run(alone, case, of_bed, trial, 1000 + i)
            except FloatingPointError:
                lost += 1
                continue
            runs += 1
            if at is not None:
                alarms.append((trial.words, trial.lash, fault, at))
    print(f"## {words}: dead time {1e3 * case.loop['dead_time']:g} ms, reads {', '.join(controller.law.sensors)}")
    for shaft, rows in noticed.items():
        loaded = [row for row in rows if row[0]]
        samples = sorted(row[2] if row[2] is not None else 99 for row in loaded)
        print(
            f"  {stated[shaft].words}: {sum(row[1] for row in loaded)} of {len(loaded)} in time; samples {samples}; "
            f"{len(rows) - len(loaded)} below the least torque, of these {sum(r[1] for r in rows if not r[0])} noticed"
        )
    print(f"  false alarms: {len(alarms)} in {runs} runs; {lost} unstable; {alarms[:8]}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--case", type=Path, nargs="*", default=[])
    parser.add_argument("--drawn", type=int, nargs="*", default=[])
    parser.add_argument("--beds", type=int, default=4)
    chosen = parser.parse_args()
    for path in chosen.case:
        judge(load_case(path), chosen.beds, path.stem)
    for seed in chosen.drawn:
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            try:
                case = load_case(draw(seed, Path(folder)))
                if case.rig.gears or case.rig.differentials:
                    print(f"drawn {seed}: the truth plant has no differentials")
                    continue
                if not case.loop.structure.is_observer:
                    continue
                judge(case, chosen.beds, f"drawn {seed}")
            except InputError as error:
                print(f"drawn {seed}: {error}")


if __name__ == "__main__":
    main()
