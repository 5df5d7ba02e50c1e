"""Steady motion of a chain at its operating point, from the torque balance of every inertia."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

Parameters = Mapping[str, float]
NEWTON_STEPS, BALANCED = 60, 1e-10  # of the largest term
FIRST_SPEED = 10.0  # rad/s, from which a speed is looked for that no operating point states
SLIDING_FROM = 1e-2  # rad/s: below it dry friction may stick


def _stribeck(p: Parameters, speed: float) -> tuple[float, float]:
    more = (p["breakaway"] - p["torque"]) * np.exp(-((speed / p["speed"]) ** 2))
    return np.sign(speed) * (p["torque"] + more), -2 * abs(speed) / p["speed"] ** 2 * more


# Torque that resists at a speed, and its derivative
RESISTS: dict[str, Callable[[Parameters, float], tuple[float, float]]] = {
    "constant_torque": lambda p, speed: (p["torque"], 0.0),
    "quadratic_drag": lambda p, speed: (p["coefficient"] * speed * abs(speed), 2 * p["coefficient"] * abs(speed)),
    "coulomb_friction": lambda p, speed: (
        p["torque"] if speed > 0 else -p.get("torque_reverse", p["torque"]),
        0.0,
    ),
    "stribeck_friction": _stribeck,
}


def patch_slip(p: Parameters, torque: float) -> tuple[float, float]:
    """Slip (dimensionless) of a tyre's contact patch at a torque (N·m), and its derivative by torque, 1/(N·m).

    The Magic Formula (Pacejka, Tire and Vehicle Dynamics, 2012, section 4.3), inverted; NaN beyond the peak.
    """
    shape, peak = p.get("shape", 1.65), p["peak"]
    share = torque / peak
    if abs(share) >= 1:
        return np.nan, np.nan
    angle = np.arcsin(share) / shape
    factor = shape * peak / p["slip_stiffness"]
    return factor * np.tan(angle), factor / (np.cos(angle) ** 2 * shape * peak * np.sqrt(1 - share**2))


DRY = {"coulomb_friction", "stribeck_friction"}


@dataclass(frozen=True)
class Balance:
    """What balances: n nodes, s springs, c constraints, u inputs.

    Attributes
    ----------
    twists, rigid, inputs : ndarray (s, n), (c, n), (u, n)
        Twist of each spring, each rigid joint, and which node an input acts on.
    slips : ndarray (s,)
        Twist rate for 1 N·m of a damper in series, 0 without one.
    drag : ndarray (n,)
        N·m·s/rad.
    resists : tuple of (node, kind, parameters)
    patches : tuple of (spring, node, parameters)
        Springs with a tyre's contact patch in series, and the node that turns as the tyre does without slip.
    torques : ndarray (u,)
        N·m, NaN where it is to be found.
    speeds : ndarray (n,)
        rad/s, NaN where it is to be found.
    """

    twists: np.ndarray
    rigid: np.ndarray
    inputs: np.ndarray
    slips: np.ndarray
    drag: np.ndarray
    resists: tuple[tuple[int, str, Parameters], ...]
    torques: np.ndarray
    speeds: np.ndarray
    patches: tuple[tuple[int, int, Parameters], ...]

    def solve(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Speeds (n,) and torques of the springs (s,); None where Newton's method finds no balance."""
        n, s, c = self.twists.shape[1], len(self.twists), len(self.rigid)
        free, stated = np.isnan(self.torques), ~np.isnan(self.speeds)
        x = np.zeros(n + s + c + int(free.sum()))
        rows = np.vstack([self.rigid, self.twists, 1e3 * np.eye(n)[stated]])
        x[:n] = np.linalg.lstsq(rows, np.concatenate([np.zeros(c + s), 1e3 * self.speeds[stated]]))[0]
        if not stated.any():
            _, _, across = np.linalg.svd(rows)
            x[:n] = FIRST_SPEED * across[-1] / np.abs(across[-1]).max() * np.sign(across[-1].sum() or 1.0)
        linear = np.zeros((n + s + c + int(stated.sum()), len(x)))
        linear[:n, n : n + s], linear[:n, n + s : n + s + c] = -self.twists.T, -self.rigid.T
        linear[:n, n + s + c :] = self.inputs[free].T
        linear[n : n + s, :n], linear[n : n + s, n : n + s] = self.twists, -np.diag(self.slips)
        linear[n + s : n + s + c, :n], linear[n + s + c :, :n] = self.rigid, np.eye(n)[stated]
        known = np.concatenate([self.inputs[~free].T @ self.torques[~free], np.zeros(s + c), -self.speeds[stated]])
        for _ in range(NEWTON_STEPS):
            torque, slope = self.resistance(x[:n])
            residual = linear @ x + known
            residual[:n] -= torque
            tangent = linear.copy()
            tangent[:n, :n] -= np.diag(slope)
            for row, node, parameters in self.patches:
                slip, steeper = patch_slip(parameters, float(x[n + row]))
                residual[n + row] -= abs(x[node]) * slip
                tangent[n + row, node] -= np.sign(x[node]) * slip
                tangent[n + row, n + row] -= abs(x[node]) * steeper
            if not np.isfinite(residual).all():
                return None
            if np.abs(residual).max() <= BALANCED * max(1.0, np.abs(x).max()):
                return x[:n], x[n : n + s]
            x = x - np.linalg.lstsq(tangent, residual)[0]
        return None

    def resistance(self, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Torques (n,) that resist at speeds (n,), and their derivatives by speed."""
        torque, slope = self.drag * speeds, self.drag.copy()
        for node, kind, parameters in self.resists:
            more, steeper = RESISTS[kind](parameters, float(speeds[node]))
            torque[node] += more
            slope[node] += steeper
        return torque, slope

    def sticking(self, speeds: np.ndarray) -> list[int]:
        """Nodes whose dry friction may stick at speeds (n,)."""
        return [node for node, kind, _ in self.resists if kind in DRY and abs(speeds[node]) < SLIDING_FROM]
