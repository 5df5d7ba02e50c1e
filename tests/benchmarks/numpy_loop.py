"""The closed loop of a case in plain NumPy, as an engineer without CasADi would write it, for many s at once.

Mass, damping and stiffness matrices are assembled once an evaluation (by rigmatch's own functions: no time to speak
of), rig and residual vehicles solved as stacks of complex matrices over all s, the loop by stacks over the
dynamometers. It is checked against the programme's own functions in the benchmark that uses it.
"""

import casadi as ca
import numpy as np

from matching.match.case import Case, Move
from matching.match.programme import sensor_sign
from modelling.bed.controllers import LEAD_POLE_OVER_ZERO
from modelling.equations.casadi_code import Model, compiled


class Body:
    """Responses (f, y, u) of a linear system with angles and speeds (n each) and further states (z)."""

    def __init__(self, model: Model, moves: tuple[Move, ...], prefix: str):
        self.inputs, self.sensors, self.n = model.inputs, model.sensors, model.n
        self.extra = len(model.states) - 2 * model.n
        x, u, values = ca.SX.sym("x", len(model.states)), ca.SX.sym("u", len(model.inputs)), ca.SX.sym("v", len(moves))
        p = ca.SX(model.p0)
        for i, move in enumerate(moves):
            for name in move.together:
                if name.startswith(prefix) and name.removeprefix(prefix) in model.parameters:
                    p[model.parameters.index(name.removeprefix(prefix))] = values[i]
        force, rates = model.force(x, u, p), model.rates(x, u, p)[2 * model.n :]
        parts = [model.mass(p)]
        for one in (force, rates, model.readings(x, u, p, 0)):
            parts += [ca.jacobian(one, x), ca.jacobian(one, u)]
        at_rest = ca.substitute(parts, [x, u], [ca.DM.zeros(*x.shape), ca.DM.zeros(*u.shape)])
        self.kept: tuple[np.ndarray, list[np.ndarray]] | None = None  # at the last p
        self.numbers = ca.Function("numbers", [values], [ca.densify(part) for part in at_rest])

    def response(self, s: np.ndarray, p: np.ndarray) -> np.ndarray:
        """At s (f,) and the values p of all moves."""
        n, z = self.n, self.extra
        if self.kept is None or not np.array_equal(self.kept[0], p):
            self.kept = p.copy(), [part.full() for part in self.numbers(p)]
        M, force, force_in, rate, rate_in, read, direct = self.kept[1]
        s = s[:, None, None]
        Z = np.empty((len(s), n + z, n + z), complex)
        Z[:, :n, :n] = s * (s * M - force[:, n : 2 * n]) - force[:, :n]
        Z[:, :n, n:] = -force[:, 2 * n :]
        if z:
            Z[:, n:, :n] = -rate[:, :n] - s * rate[:, n : 2 * n]
            Z[:, n:, n:] = s * np.eye(z) - rate[:, 2 * n :]
        found = np.linalg.solve(Z, np.vstack([force_in, rate_in]).astype(complex))
        q = found[:, :n]
        return (read[:, :n] + s * read[:, n : 2 * n]) @ q + read[:, 2 * n :] @ found[:, n:] + direct


class NumpyLoop:
    """Compared responses and return difference of a case's feedback loop.

    Parameters
    ----------
    moves : tuple of Move
        What moves; their values in this order are p.
    """

    def __init__(self, case: Case, moves: tuple[Move, ...]):
        dynos, self.own = case.loop.dynamometers, dict(case.loop.values)
        self.rig = Body(compiled(case.rig), moves, "rig.")
        self.parts = [Body(compiled(part), moves, "residual_vehicle.") for part in case.residual_vehicle.parts]
        self.tuned = {
            name.removeprefix("loop."): i for i, move in enumerate(moves) for name in move.together if "loop." in name
        }
        cuts = {own.shaft: own for own in case.residual_vehicle.interfaces}
        sensors, inputs = self.rig.sensors, self.rig.inputs
        self.k = len(dynos)
        self.torque_signs = np.array([sensor_sign(case.rig, dyno) for dyno in dynos])[:, None]
        self.torques = [sensors.index(dyno.torque_sensor) for dyno in dynos]
        self.speeds = [sensors.index(dyno.speed_sensor) for dyno in dynos]
        self.driven = [inputs.index(dyno.torque_input) for dyno in dynos]
        sources = list(dict.fromkeys(pair.input for pair in case.compared))
        self.on_rig = [(i, inputs.index(name)) for i, name in enumerate(sources) if name in inputs]
        self.sources = len(sources)
        self.compared = [(sensors.index(pair.sensor), sources.index(pair.input)) for pair in case.compared]
        self.residual, self.roads = [], []  # (part, its sensor, its input, dynamometer, dynamometer or source)
        for number, part in enumerate(self.parts):
            for j, dyno in enumerate(dynos):
                if (speed := cuts[dyno.follows].speed) not in part.sensors:
                    continue
                row = part.sensors.index(speed)
                for k, other in enumerate(dynos):
                    if (torque := cuts[other.follows].torque) in part.inputs:
                        self.residual.append((number, row, part.inputs.index(torque), j, k))
                for i, name in enumerate(sources):
                    if name in part.inputs and name not in inputs:
                        self.roads.append((number, row, part.inputs.index(name), j, i))

    def at(self, s: np.ndarray, p: np.ndarray, count: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """H (count, h) at the first s, I + L (f, k, k) at all of s (f,)."""
        loop = self.own | {name: p[i] for name, i in self.tuned.items()}
        count = len(s) if count is None else count
        G, parts = self.rig.response(s, p), [part.response(s, p) for part in self.parts]
        lead = (1 + s * loop["lead_time"]) / (1 + s * (loop["lead_time"] / LEAD_POLE_OVER_ZERO))
        actuator = (np.exp(-s * loop["dead_time"]) / (1 + s * loop["inverter_lag"]) * lead)[:, None, None]
        speed_error = loop["proportional_gain"] + loop["integral_gain"] / s
        reference = (speed_error + s * loop["acceleration_feed_forward"])[:, None, None]
        speed_error = speed_error[:, None, None]
        lag = (1 / (1 + s * loop["torque_sensor_lag"]))[:, None, None]
        R = np.zeros((len(s), self.k, self.k), complex)
        for number, row, column, j, k in self.residual:
            R[:, j, k] = parts[number][:, row, column]
        measured = G[:, self.torques] * self.torque_signs * lag
        command = actuator * (
            reference * (R @ measured) - speed_error * G[:, self.speeds] - loop["torque_feed_forward"] * measured
        )
        D = np.eye(self.k) - command[:, :, self.driven]
        right = np.zeros((count, self.k, self.sources), complex)
        H = np.zeros((count, len(self.rig.sensors), self.sources), complex)
        for i, column in self.on_rig:
            right[:, :, i] = command[:count, :, column]
            H[:, :, i] = G[:count, :, column]
        for number, row, column, j, i in self.roads:
            right[:, j, i] += (actuator * reference)[:count, 0, 0] * parts[number][:count, row, column]
        H += G[:count][:, :, self.driven] @ np.linalg.solve(D[:count], right)
        return np.stack([H[:, row, i] for row, i in self.compared], axis=1), D
