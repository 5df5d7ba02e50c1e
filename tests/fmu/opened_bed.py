"""Fresh beds on the truth plant's engine under the exported controller and its supervision; shafts may open."""

from dataclasses import dataclass

import numpy as np
from match_beds.plant_loop import air_gap, behind_lag, plant_model
from plant.engine import simulate

from matching.match.box import of_system
from matching.match.case import Case
from modelling.controller.law import EMULATION, ExportedController

FINE = 2  # parts of a sample
SEED = 4242  # of beds and noise; no design draws from it
COUNT_RAD, NOISE_TORQUE, NOISE_SPEED = 2 * np.pi / 8192, 0.35, 0.084
BROKEN = 1e-6  # N·m/rad of a shaft that is open
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
        answer = running.step(sensing.read(true), known[s], EMULATION, np.zeros(k), s)
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
