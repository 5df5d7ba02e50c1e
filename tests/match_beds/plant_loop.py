"""A bed under a control law, and a vehicle, on the truth plant's engine: nothing here computes with the product."""

import itertools
from dataclasses import dataclass

import numpy as np
from plant.engine import Chain, simulate

FINE = 8  # parts of a sample


@dataclass
class PlantModel:
    """A chain with the names of its inertias, shafts and inputs."""

    chain: Chain
    inertias: list
    shafts: list
    inputs: list
    sensors: dict

    def reading(self, name, speed, torque):
        """A sensor's reading from speeds (n,) and shaft torques (s,)."""
        sensor = self.sensors[name]
        if sensor.measures == "torque":
            return torque[..., self.shafts.index(sensor.of)]
        return speed[..., self.inertias.index(sensor.of)]


def plant_model(system, values=None, gap=0.0, lashed=(), friction=0.0, rubbing=()):
    """The engine's chain for what a model file says, with other values, lash and dry friction."""
    inertias, shafts = [part.name for part in system.inertias], [part.name for part in system.shafts]
    chain = Chain(len(inertias), len(shafts), len(system.inputs))
    known = {name: quantity.value for name, quantity in system.parameters.items()} | dict(values or {})
    for i, name in enumerate(inertias):
        for key, entry in (("J", "J"), ("drag", "drag")):
            chain[entry][[i, chain.n + i]] = known[f"inertias.{name}.{key}"]
        if name in rubbing:
            for key in ("friction", "friction_reverse", "breakaway", "breakaway_reverse"):
                chain[key][i] = friction
    for j, part in enumerate(system.shafts):
        chain["first"][j], chain["second"][j] = (inertias.index(end) for end in part.between)
        chain["ratio"][j] = known.get(f"shafts.{part.name}.ratio", 1.0)
        chain["k"][[j, chain.s + j]] = known[f"shafts.{part.name}.stiffness"]
        chain["c"][[j, chain.s + j]] = known[f"shafts.{part.name}.damping"]
        chain["gap"][j] = gap if part.name in lashed else 0.0
    for effect in system.effects:
        assert effect.kind == "slip"
        chain["series_damper"][shafts.index(effect.at.split(".")[1])] = known[f"{effect.at}.slip.coefficient"]
    chain["on"][:] = [inertias.index(part.on) for part in system.inputs]
    names = [part.name for part in system.inputs]
    return PlantModel(chain, inertias, shafts, names, {part.name: part for part in system.sensors})


def vehicle_run(model, torques, step, sensors):
    """Readings (t, y) of a vehicle under torques by input (t,)."""
    inputs = np.stack([torques.get(name, 0 * next(iter(torques.values()))) for name in model.inputs], axis=1)
    motion = simulate(model.chain, inputs, np.zeros(2 * model.chain.n), step)
    return np.stack([model.reading(name, motion.speed, motion.torque) for name in sensors], axis=1)


def bed_run(model, law, loop, torques, told, sensors, *, dead_time, gains, sense=None, limit=np.inf):
    """Readings (t, y) of a bed under the law, its commands late by the dead time less half a sample of hold.

    ``torques`` act by input (t,), ``told`` is what the controller knows of them; ``sense`` makes readings of true ones.
    """
    step, dynos, n = law.sample_time, loop.dynamometers, model.chain.n
    count, k = len(next(iter(torques.values()))), len(dynos)
    known = np.stack([told.get(name, np.zeros(count)) for name in law.known], axis=1)
    driven = [model.inputs.index(dyno.torque_input) for dyno in dynos]
    delay = max(dead_time - step / 2, 0.0)
    issued, read = np.zeros((count, k)), np.zeros((count, len(sensors)))
    x, state = np.zeros(2 * n), np.zeros(len(law.A))
    air, flange, torque = np.zeros(k), np.zeros(k), np.zeros(model.chain.s)
    grid = np.arange(FINE + 1) * step / FINE
    for s in range(count):
        read[s] = [model.reading(name, x[n:], torque) for name in sensors]
        true = [flange[i] for i in range(k)] + [model.reading(name, x[n:], torque) for name in law.sensors[k:]]
        y = np.array(true) if sense is None else sense(np.array(true))
        corrected = state + law.L @ (y - law.E @ state)
        issued[s] = np.clip(law.K @ corrected + law.Dy @ y + law.Dw @ known[s], -limit, limit)
        state = law.A @ corrected + law.By @ y + law.Bw @ known[s] + law.Bs @ issued[s]
        inputs, later = np.zeros((FINE + 1, len(model.inputs))), min(s + 1, count - 1)
        for name, own in torques.items():
            if name in model.inputs:
                inputs[:, model.inputs.index(name)] = own[s] + (own[later] - own[s]) * grid / step
        inputs[:, driven] = gains * air_gap(air, issued, s, delay, step, grid, loop["inverter_lag"])
        air = inputs[-1, driven] / gains
        motion = simulate(model.chain, inputs, x, step / FINE)
        x, torque = np.concatenate([motion.angle[-1], motion.speed[-1]]), motion.torque[-1]
        for i, dyno in enumerate(dynos):
            measured = model.reading(dyno.torque_sensor, motion.speed, motion.torque)
            flange[i] = behind_lag(flange[i], measured, step / FINE, loop["torque_sensor_lag"])
    return read


def air_gap(air, issued, s, delay, step, grid, lag):
    """Torques (g, k) behind the inverter's lag at the points of the grid, exact for held commands."""
    arrival = (s - np.floor(s - delay / step + 1e-9) - delay / step) * -step  # of the command after that at its start
    edges = np.union1d(grid, [edge for edge in arrival + step * np.arange(3) if 0 < edge < step])
    found, now = {0.0: air}, air
    for a, b in itertools.pairwise(edges):
        at = int(np.floor((s * step + (a + b) / 2 - delay) / step))
        command = issued[at] if at >= 0 else np.zeros(len(air))
        now = command + (now - command) * np.exp(-(b - a) / lag)
        found[b] = now
    return np.stack([found[point] for point in grid])


def behind_lag(value, measured, step, lag):
    """A first-order lag's output after inputs (g,) that vary linearly between points a step apart."""
    decay = np.exp(-step / lag)
    for a, b in itertools.pairwise(measured):
        slope = (b - a) / step
        value = b - slope * lag + (value - a + slope * lag) * decay
    return value
