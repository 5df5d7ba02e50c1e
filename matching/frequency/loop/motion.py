"""Motion of rig or vehicle from sample to sample, linear exactly, nonlinear by fine steps."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import scipy

from matching.frequency.loop.delay_line import arrivals
from matching.frequency.loop.linear_body import Body
from matching.frequency.loop.parts import Parts
from modelling.equations.compiled import compiled
from modelling.equations.shaft_law import CONTACT_TIME
from modelling.linear.discretise import discretise
from modelling.linear.elements import elements
from modelling.linear.propagate import propagated
from modelling.linear.reference_motion import operating_motion
from modelling.model.system import System
from modelling.simulation.plan import steps_per_second

FINEST = 50e-6  # s: longest fine step


class LinearMotion:
    """Exact propagation from sample to sample: k held commands through a delay line, d torques that vary linearly.

    Parameters
    ----------
    A, B : ndarray (x, x), (x, k + d)
    count : int
        k, the first columns of B.
    step : float
        s, one sample.
    delay : float
        s, of the line that carries commands.

    Attributes
    ----------
    start, drift : ndarray (x,)
        State at time 0, and its rate where nothing acts: zero.
    whole : ndarray (x, x)
        What a sample makes of the state.
    drives : ndarray (2, x, d)
        What the torques at its beginning and at its end do within a sample.
    commands : list of (int, ndarray (x, k))
        How many samples ago a command was issued and what it does within one sample.
    """

    def __init__(self, A: np.ndarray, B: np.ndarray, count: int, step: float, delay: float = 0.0):
        pieces = int(np.ceil(step / FINEST - 1e-9))
        fine, push = scipy.signal.cont2discrete((A, B, np.eye(len(A)), np.zeros(B.shape)), step / pieces)[:2]
        self.start = self.drift = np.zeros(len(A))
        self.whole = np.eye(len(A))
        pushes = []
        for _ in range(pieces):
            pushes.append(self.whole @ push[:, :count])
            self.whole = fine @ self.whole
        torques = discretise(A, B[:, count:], step)
        self.drives = np.stack([torques.held - torques.ramp, torques.ramp])
        weights = arrivals(delay, step, pieces)
        over = [sum(w * p for w, p in zip(column, reversed(pushes), strict=True)) for column in weights.T]
        self.commands = [(i, part) for i, part in enumerate(over) if count and np.any(weights[:, i])]

    def advance(self, x: np.ndarray, drives: np.ndarray, issued: np.ndarray, k: int) -> np.ndarray:
        """The state (x,) a sample later, from the state x (x,) at sample ``k``.

        Parameters
        ----------
        drives : ndarray (2, d)
            Torques at this sample and at the next, N·m.
        issued : ndarray (t, k)
            Commands in N·m, of which those up to sample ``k`` inclusive count.
        """
        new = self.whole @ x + self.drives[0] @ drives[0] + self.drives[1] @ drives[1]
        for i, push in self.commands:
            if k >= i:
                new += push @ issued[k - i]
        return new

    def free(self, drives: np.ndarray) -> np.ndarray:
        """States (t, x) from the start under torques (t, d) in N·m alone, no command; the last torque stays."""
        following = np.concatenate([drives[1:], drives[-1:]])
        return propagated(self.whole, drives @ self.drives[0].T + following @ self.drives[1].T, self.start)


class NonlinearMotion:
    """Runge-Kutta of order four over fine steps, inverter and torque-sensor lags included.

    States [x of the model, air-gap torques (k), lagged flange torques (k)], absolute: they begin at the operating
    point. Commands and drives are what is added to its torques. Arguments as :class:`LinearMotion`.

    Attributes
    ----------
    start, drift : ndarray (x,)
        States at the operating point at time 0, and their rates: angles turn on.
    deviation_readings : ca.Function
        x → signed lagged flange torques and rotor speeds (2·k,), less those at the operating point.
    readings : ca.Function
        (x of the model, added inputs (u,)) → y, absolute.
    """

    def __init__(self, parts: Parts | None, system: System, step: float, delay: float = 0.0):
        model = compiled(system)
        p = model.p0
        needed = max(steps_per_second(model, p[None]) * step, step / FINEST)
        if parts is not None:
            needed = max(needed, *(step / (2 * parts.case.loop[lag]) for lag in ("inverter_lag", "torque_sensor_lag")))
        self._pieces = int(np.ceil(needed - 1e-9))
        if CONTACT_TIME in model.parameters:
            p = p.copy()
            p[model.parameters.index(CONTACT_TIME)] = step / self._pieces
        self._weights = arrivals(delay, step, self._pieces)
        dynos = () if parts is None else parts.dynamometers
        k, n = len(dynos), len(model.states)
        x, v, w = ca.SX.sym("x", n + 2 * k), ca.SX.sym("v", k), ca.SX.sym("w", len(model.inputs) - k)
        about = operating_motion(system)
        u = ca.SX(ca.DM(about.inputs))
        driven = [dyno.torque_input for dyno in dynos]
        for i, name in enumerate(name for name in model.inputs if name not in driven):
            u[model.inputs.index(name)] += w[i]
        for j, name in enumerate(driven):
            u[model.inputs.index(name)] = x[n + j]
        held = np.array([about.inputs[model.inputs.index(name)] for name in driven])  # by the dynamometers
        rates: list[Any] = [model.rates(x[:n], u, p)]
        self.start = np.concatenate([about.state, held, np.zeros(k)])
        if parts is not None:
            loop = parts.case.loop
            readings = model.readings(x[:n], u, p, 0)
            flange = ca.vertcat(
                *(parts.toward[j] * readings[model.sensors.index(d.torque_sensor)] for j, d in enumerate(dynos))
            )
            commands = held + v
            rates += [
                (commands - x[n : n + k]) / loop["inverter_lag"],
                (flange - x[n + k :]) / loop["torque_sensor_lag"],
            ]
            still = ca.Function("flange", [x, w], [flange])
            self.start[n + k :] = still(self.start, np.zeros(w.shape[0])).full().ravel()
            names = [*(d.speed_sensor for d in dynos), *loop.further_sensors]
            deviations = ca.vertcat(x[n + k :], *(readings[model.sensors.index(name)] for name in names))
            deviations = ca.substitute(deviations, w, ca.DM.zeros(w.shape))
            deviations = deviations - ca.Function("seen", [x], [deviations])(self.start)
            self.deviation_readings = ca.Function("deviation_readings", [x], [deviations])
        slope = ca.Function("slope", [x, v, w], [ca.vertcat(*rates)])
        h = step / self._pieces
        k1 = slope(x, v, w)
        k2 = slope(x + h / 2 * k1, v, w)
        k3 = slope(x + h / 2 * k2, v, w)
        k4 = slope(x + h * k3, v, w)
        single_step = ca.Function("one", [x, v, w], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
        self._run = single_step.mapaccum("sample", self._pieces)
        self.drift = np.concatenate([about.state[model.n : 2 * model.n], np.zeros(n + 2 * k - model.n)])
        self._count = k
        self.twists = elements(model, p[None]).deflection_jacobian
        self.readings = ca.Function("readings", [x, w], [model.readings(x[:n], u, p, 0)])

    def advance(self, x: np.ndarray, drives: np.ndarray, issued: np.ndarray, k: int) -> np.ndarray:
        """As :meth:`LinearMotion.advance`; over a fine step, torques have the value of its middle."""
        commands = np.zeros((self._pieces, self._count))
        for i in range(min(self._weights.shape[1], k + 1) if self._count else 0):
            commands += np.outer(self._weights[:, i], issued[k - i])
        middles = (np.arange(self._pieces) + 0.5) / self._pieces
        path = self._run(x, commands.T, np.outer(drives[0], 1 - middles) + np.outer(drives[1], middles))
        return path[:, -1].full().ravel()

    def free(self, drives: np.ndarray) -> np.ndarray:
        """As :meth:`LinearMotion.free`."""
        states, no_commands = np.empty((len(drives), len(self.start))), np.zeros((len(drives), 0))
        x = self.start
        for k in range(len(drives)):
            states[k] = x
            x = self.advance(x, drives[k : k + 2] if k + 1 < len(drives) else drives[[k, k]], no_commands, k)
        return states


def body_motion(linear_body: Body, step: float) -> LinearMotion:
    """Motion of a vehicle, or of a rig without control, in steps of s."""
    return LinearMotion(linear_body.space.A, linear_body.space.B, 0, step)
