"""Beds and vehicles with free play in the shafts at the cut, in time: equations, integrator and delay line of its own.

Only names and numbers are read off a case, and the matrices of the delivered control law. Between contacts a drivetrain
is linear: its matrix exponential steps it exactly, and the torque that free play takes away acts as an input that is
linear over a fine step, found by a predictor and a corrector. Shafts with ratio, damping and slip, rigid gears and
differentials; b rows side by side.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, null_space

FINE = 8  # steps a sample
CORRECTIONS = 2  # of a step
RUNAWAY = 1e7  # rad/s or N·m: nothing on a bed gets there


@dataclass
class Train:
    """One drivetrain with values of its own; n coordinates, m slips, states [angles (n), speeds (n), slips (m)]."""

    system: object
    values: dict

    def __post_init__(self):
        system = self.system
        self.value = {name: own.value for name, own in system.parameters.items()} | self.values
        self.nodes = [part.name for part in system.inertias]
        rigid = [self.at(gear.between[0]) - self.value[f"gears.{gear.name}.ratio"] * self.at(gear.between[1])
                 for gear in system.gears]  # fmt: skip
        rigid += [2 * self.at(part.cage) - self.at(part.left) - self.at(part.right) for part in system.differentials]
        assert not system.planetary_gears
        self.basis = null_space(np.array(rigid)) if rigid else np.eye(len(self.nodes))
        slips = {}
        for effect in system.effects:
            assert effect.kind == "slip"
            slips[effect.at.removeprefix("shafts.")] = self.value[f"{effect.at}.slip.coefficient"]
        self.n, self.m = self.basis.shape[1], len(slips)
        J, drag = (np.diag([self.value.get(f"inertias.{name}.{key}", 0.0) for name in self.nodes])
                   for key in ("J", "drag"))  # fmt: skip
        self.mass = self.basis.T @ J @ self.basis
        size = 2 * self.n + self.m
        self.A = np.zeros((size, size))
        self.A[: self.n, self.n : 2 * self.n] = np.eye(self.n)
        force = np.zeros((self.n, size))
        force[:, self.n : 2 * self.n] = -self.basis.T @ drag @ self.basis
        self.twist, self.torque, self.law = {}, {}, {}
        for shaft in system.shafts:
            ratio = self.value.get(f"shafts.{shaft.name}.ratio", 1.0)
            twist = (self.at(shaft.between[0]) / ratio - self.at(shaft.between[1])) @ self.basis
            k, d = (self.value[f"shafts.{shaft.name}.{key}"] for key in ("stiffness", "damping"))
            row = np.concatenate([k * twist, d * twist, np.zeros(self.m)])
            if shaft.name in slips:
                where, c = 2 * self.n + list(slips).index(shaft.name), slips[shaft.name]
                row[where] -= k
                self.A[where] = row / (c + d)
                row = c * self.A[where]
            self.twist[shaft.name], self.torque[shaft.name], self.law[shaft.name] = twist, row, (k, d)
            force -= np.outer(twist, row)
        self.A[self.n : 2 * self.n] = np.linalg.solve(self.mass, force)

    def at(self, node):
        return np.eye(len(self.nodes))[self.nodes.index(node)]

    def pushed(self, generalised):
        """Column of the rates for a generalised torque (n,) of 1 N·m."""
        return np.concatenate([np.zeros(self.n), np.linalg.solve(self.mass, generalised), np.zeros(self.m)])

    def driven(self, name):
        on = next(part.on for part in self.system.inputs if part.name == name)
        return self.pushed(self.basis.T @ self.at(on))

    def sensed(self, name):
        """Row of a sensor (x,), shafts without their play, and the shaft whose torque it reads or None."""
        part = next(one for one in self.system.sensors if one.name == name)
        if part.measures == "torque":
            return self.torque[part.of], part.of
        assert part.measures == "speed"
        return np.concatenate([np.zeros(self.n), self.at(part.of) @ self.basis, np.zeros(self.m)]), None


def own_values(values, system, prefix):
    """Of values named as a box names them, those that a model has; the specimen stands in both models."""
    plain = {name.removeprefix(prefix): value for name, value in values.items() if name.startswith(prefix)}
    return {name: value for name, value in plain.items() if name in system.parameters}


class Rows:
    """Rows of drivetrains of one structure with play in their ``cuts``; on beds machines and flanges' lags as well."""

    def __init__(self, trains, gaps, cuts, drives, machines=(), step=1e-3):
        self.trains, self.gaps, self.cuts, self.h = trains, np.asarray(gaps)[:, None], cuts, step / FINE
        first = trains[0]
        self.x, self.k = 2 * first.n + first.m, len(machines)
        self.flanges = [j for j, one in enumerate(machines) if one.flange is not None]
        size = self.x + self.k + len(self.flanges)
        self.states = np.zeros((len(trains), size))
        stepped = [self._matrices(train, i, machines, drives, size) for i, train in enumerate(trains)]
        self.Ad, self.Bheld, self.Bplay, self.Bmore = (np.stack(part) for part in zip(*stepped))
        self.angle = np.stack([[train.twist[cut] for cut in cuts] for train in trains])
        self.law = np.stack([[train.law[cut] for cut in cuts] for train in trains])
        self.elastic = np.stack([[train.torque[cut] for cut in cuts] for train in trains])
        self.lost = np.zeros(len(trains), bool)

    def _matrices(self, train, i, machines, drives, size):
        k, x = self.k, self.x
        A, play = np.zeros((size, size)), np.zeros((size, len(self.cuts)))
        held = np.zeros((size, k + len(drives)))
        A[:x, :x] = train.A
        for c, cut in enumerate(self.cuts):
            play[:x, c] = train.pushed(train.twist[cut])  # torque that the play takes off a closed shaft
        for j, one in enumerate(machines):
            A[:x, x + j] = one.gains[i] * train.driven(one.input)
            A[x + j, x + j], held[x + j, j] = -1 / one.lags[i], 1 / one.lags[i]
        for row, j in enumerate(self.flanges, x + k):
            sensed, shaft = train.sensed(machines[j].flange)
            A[row, :x], A[row, row] = sensed / machines[j].flange_lags[i], -1 / machines[j].flange_lags[i]
            if shaft in self.cuts:
                play[row, self.cuts.index(shaft)] -= 1 / machines[j].flange_lags[i]
        for j, name in enumerate(drives):
            held[:x, k + j] = train.driven(name)
        B = np.hstack([held, play])
        w, h = B.shape[1], self.h
        block = np.zeros((size + 2 * w,) * 2)
        block[:size, :size], block[:size, size : size + w] = A, B
        block[size : size + w, size + w :] = np.eye(w)
        grown = expm(block * h)
        even, rising = grown[:size, size : size + w], grown[:size, size + w :] / h
        cut = k + len(drives)
        return grown[:size, :size], even[:, :cut], even[:, cut:], rising[:, cut:]

    def taken(self, x):
        """Torque (b, cuts) that play takes off shafts without play: a flank pushes, and does not pull."""
        n = self.trains[0].n
        angle = np.einsum("bcn,bn->bc", self.angle, x[:, :n])
        rate = np.einsum("bcn,bn->bc", self.angle, x[:, n : 2 * n])
        k, d = self.law[..., 0], self.law[..., 1]
        beyond = angle - np.clip(angle, -self.gaps / 2, self.gaps / 2)
        torque = k * beyond + d * rate
        torque = np.where(beyond > 0, np.maximum(torque, 0.0), np.where(beyond < 0, np.minimum(torque, 0.0), 0.0))
        return k * angle + d * rate - torque

    def carried(self, x):
        """Torques (b, cuts) of the shafts with play."""
        return np.einsum("bcx,bx->bc", self.elastic, x[:, : self.x]) - self.taken(x)

    def turning(self, ends):
        """Speeds (b, ends) of inertias by name."""
        n = self.trains[0].n
        rows = np.stack([[train.at(end) @ train.basis for end in ends] for train in self.trains])
        return np.einsum("ben,bn->be", rows, self.states[:, n : 2 * n])

    def advance(self, held):
        """A fine step under commands and torques (b, k + d) that are held."""
        x = self.states
        before = self.taken(x)
        ahead = (self.Ad @ x[..., None] + self.Bheld @ held[..., None] + self.Bplay @ before[..., None])[..., 0]
        found = ahead
        for _ in range(CORRECTIONS):
            found = ahead + (self.Bmore @ (self.taken(found) - before)[..., None])[..., 0]
        self.lost |= ~(np.abs(found).max(axis=1) < RUNAWAY)
        self.states = np.where(self.lost[:, None], 0.0, found)


@dataclass
class Machine:
    """A dynamometer of every row: torque over command, lags (s), total dead times (s)."""

    input: str
    flange: str | None
    gains: list
    lags: list
    flange_lags: list
    delays: list


def machines_of(case, rows):
    """The dynamometers of a case with the values (dict) of every row."""
    loop = case.loop
    found = []
    for one in loop.dynamometers:
        lag, flange_lag, delay = (
            loop[name] if getattr(one, name) is None else getattr(one, name)
            for name in ("inverter_lag", "torque_sensor_lag", "dead_time")
        )
        scaled = [[values.get(f"loop.{name}", loop[name]) / loop[name] for values in rows]
                  for name in ("inverter_lag", "torque_sensor_lag")]  # fmt: skip
        later = [values.get("loop.dead_time", loop["dead_time"]) - loop["dead_time"] for values in rows]
        found.append(Machine(
            one.torque_input, one.torque_sensor, [v.get(f"dynamometers.{one.name}.torque_gain", 1.0) for v in rows],
            [lag * each for each in scaled[0]], [flange_lag * each for each in scaled[1]],
            [delay + each for each in later],
        ))  # fmt: skip
    return found


def pulse(case, name, size, seconds):
    """Torques (samples,) of a pulse of 0.1 s at an input."""
    time = np.arange(round(seconds / case.loop["sample_time"])) * case.loop["sample_time"]
    return {name: size * ((time >= 0.2) & (time < 0.3))}


def vehicles(case, rows, gaps, torques, speeds=False):
    """Torques at the cuts (t, b, cuts) of the vehicle with each row's specimen, with ``speeds`` those behind them."""
    cuts, step = [one.shaft for one in case.residual_vehicle.interfaces], case.loop["sample_time"]
    trains = [
        Train(case.vehicle, own_values(row, case.vehicle, "rig.") | own_values(row, case.vehicle, "vehicle."))
        for row in rows
    ]
    beds = Rows(trains, gaps, cuts, list(torques), step=step)
    count = len(next(iter(torques.values())))
    ends = [one.vehicle_end for one in case.residual_vehicle.interfaces] if speeds else []
    found = np.empty((count, len(rows), len(cuts) + len(ends)))
    for n in range(count):
        found[n, :, : len(cuts)] = beds.carried(beds.states)
        if ends:
            found[n, :, len(cuts) :] = beds.turning(ends)
        acting = np.tile([torque[n] for torque in torques.values()], (len(rows), 1))
        for _ in range(FINE):
            beds.advance(acting)
    return found, beds.lost


def beds(case, law, rows, gaps, torques, speeds=False):
    """As :func:`vehicles`, of the rig under the law; and which rows ran away."""
    cuts, step = [one.shaft for one in case.residual_vehicle.interfaces], case.loop["sample_time"]
    trains = [Train(case.rig, own_values(row, case.rig, "rig.")) for row in rows]
    machines = machines_of(case, rows)
    rig = Rows(trains, gaps, cuts, list(torques), machines, step)
    k, count, b = len(machines), len(next(iter(torques.values()))), len(rows)
    limit = case.limits.get("dynamometer_torque", np.inf)
    # the dead time counts half a sample of hold
    late = np.maximum(np.array([one.delays for one in machines]).T - step / 2, 0.0)
    flanges = [machines[j].flange for j in rig.flanges]
    gains = np.array([[row.get(f"sensors.{name}.gain", 1.0) for name in law.sensors] for row in rows])
    plain = [name for name in law.sensors if name not in flanges]
    sensed = np.stack([[train.sensed(name)[0] for name in plain] or np.zeros((0, rig.x)) for train in trains])
    of_cut = [(i, cuts.index(trains[0].sensed(name)[1])) for i, name in enumerate(plain)
              if trains[0].sensed(name)[1] in cuts]  # fmt: skip
    known = {name: torques.get(name, np.zeros(count)) for name in law.known}
    issued, state = np.zeros((count, b, k)), np.zeros((len(law.A), b))
    ends = [one.rig_end for one in case.residual_vehicle.interfaces] if speeds else []
    found = np.empty((count, b, len(cuts) + len(ends)))
    middles = (np.arange(FINE) + 0.5) / FINE * step
    every, machine = np.arange(b)[:, None], np.arange(k)
    for n in range(count):
        x = rig.states
        found[n, :, : len(cuts)] = rig.carried(x)
        if ends:
            found[n, :, len(cuts) :] = rig.turning(ends)
        read = np.einsum("bsx,bx->bs", sensed, x[:, : rig.x])
        for i, c in of_cut:
            read[:, i] -= rig.taken(x)[:, c]
        by_name = dict(zip(plain, read.T)) | dict(zip(flanges, x[:, rig.x + k :].T))
        y = gains.T * np.stack([by_name[name] for name in law.sensors])
        w = np.tile([[own[n]] for own in known.values()], (1, b)).reshape(len(known), b)
        corrected = state + law.L @ (y - law.E @ state)
        sent = np.clip(law.K @ corrected + law.Dy @ y + law.Dw @ w, -limit, limit)
        state = law.A @ corrected + law.By @ y + law.Bw @ w + law.Bs @ sent
        state[:, rig.lost] = 0.0
        issued[n] = sent.T
        drive = np.tile([torque[n] for torque in torques.values()], (b, 1))
        for middle in middles:
            at = np.floor((n * step + middle - late) / step + 1e-9).astype(int)
            acting = np.where(at >= 0, issued[np.maximum(at, 0), every, machine], 0.0)
            rig.advance(np.hstack([acting, drive]))
    return found, rig.lost
