"""Chains with free play and dry friction, integrated event by event: exact in between, for there they are linear.

Shares nothing with the product: from one event to the next the motion is a matrix exponential, and an event (a flank
meets or leaves, a rotor stops or starts) is found by bisection.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm

SUBSTEPS = 8  # a sample, at the ends of which events are looked for
BISECTIONS = 32


@dataclass
class Chain:
    """Inertias J (n,) with drag and dry friction T (n,); shafts k, c, gap (n-1,); inputs on inertias ``on``."""

    J: np.ndarray
    drag: np.ndarray
    friction: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    gap: np.ndarray
    on: list[int]
    _made: dict = field(default_factory=dict, repr=False)

    def as_model(self) -> dict:
        """The same as a model file, a sensor of every speed and shaft torque."""
        n = len(self.J)
        shafts = {
            f"s{i}": {"between": [f"i{i}", f"i{i + 1}"], "stiffness": float(k), "damping": float(c)}
            for i, (k, c) in enumerate(zip(self.stiffness, self.damping, strict=True))
        }
        gaps = [(f"shafts.s{i}", "backlash", "gap", float(gap)) for i, gap in enumerate(self.gap) if gap]
        rubbing = [(f"inertias.i{i}", "coulomb_friction", "torque", float(T)) for i, T in enumerate(self.friction) if T]
        sensors = {f"w{i}": {"measures": "speed", "of": f"i{i}"} for i in range(n)}
        return {
            "inertias": {f"i{i}": {"J": float(self.J[i]), "drag": float(self.drag[i])} for i in range(n)},
            "shafts": shafts,
            "inputs": {f"u{j}": {"on": f"i{i}"} for j, i in enumerate(self.on)},
            "sensors": sensors | {f"t{i}": {"measures": "torque", "of": f"s{i}"} for i in range(n - 1)},
            "effects": [{"kind": kind, "at": at, key: value} for at, kind, key, value in gaps + rubbing],
        }

    def readings(self, time: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Speeds and shaft torques (t, 2n-1) for torques (t, u) that are linear between even samples, from rest."""
        n, u = len(self.J), len(self.on)
        step = (time[1] - time[0]) / SUBSTEPS
        z = np.zeros(2 * n + 2 * u + 1)
        z[-1] = 1.0
        z[2 * n : 2 * n + u], z[2 * n + u : -1] = torque[0], (torque[1] - torque[0]) / (time[1] - time[0])
        mode = self._mode_after(z, [0] * (n - 1), [0] * n)
        out = np.zeros((len(time), 2 * n - 1))
        out[0] = self._read(z, mode)
        for i in range(len(time) - 1):
            z[2 * n : 2 * n + u] = torque[i]
            z[2 * n + u : -1] = (torque[i + 1] - torque[i]) / (time[1] - time[0])
            for _ in range(SUBSTEPS):
                z, mode = self._advance(z, mode, step)
            out[i + 1] = self._read(z, mode)
        return out

    def _advance(self, z, mode, step):
        left = step
        for _ in range(200):
            after = self._over(mode, left, kept=left == step) @ z
            if not self._left(after, mode):
                return after, mode
            passed, crossed = 0.0, (left, after)
            for halving in range(1, BISECTIONS):
                part = step / 2**halving
                if passed + part <= left:
                    further = self._over(mode, part) @ z
                    if self._left(further, mode):
                        crossed = (passed + part, further)
                    else:
                        z, passed = further, passed + part
            passed, z = crossed
            mode = self._mode_after(z, *mode)
            left -= passed
            if left <= 1e-12 * step:
                return z, mode
        raise AssertionError("events without end")

    def _over(self, mode, seconds, kept=True):
        """The matrix that advances a state by so long in a mode."""
        key = (tuple(mode[0]), tuple(mode[1]))
        if key not in self._made:
            self._made[key] = self._rates(*mode)
        if not kept:
            return expm(self._made[key] * seconds)
        if (key, seconds) not in self._made:
            self._made[key, seconds] = expm(self._made[key] * seconds)
        return self._made[key, seconds]

    def _twists(self, z):
        n = len(self.J)
        return z[: n - 1] - z[1:n], z[n : 2 * n - 1] - z[n + 1 : 2 * n]

    def _flank(self, z, side):
        """Positive where the flank of that side carries torque: it is met, and spring and damper push."""
        twist, rate = self._twists(z)
        over = side * twist - self.gap / 2
        return np.minimum(over, self.stiffness * over + self.damping * side * rate)

    def _shaft_torques(self, z, sides):
        twist, rate = self._twists(z)
        side = np.array(sides)
        torque = self.stiffness * (twist - side * self.gap / 2) + self.damping * rate
        return np.where((self.gap == 0) | (side != 0), torque, 0.0)

    def _free_torques(self, z, sides):
        """On every inertia, its dry friction left out."""
        n, u = len(self.J), len(self.on)
        torque = -self.drag * z[n : 2 * n]
        shafts = self._shaft_torques(z, sides)
        torque[:-1] -= shafts
        torque[1:] += shafts
        np.add.at(torque, self.on, z[2 * n : 2 * n + u])
        return torque

    def _rates(self, sides, slides):
        n, u = len(self.J), len(self.on)
        A = np.zeros((2 * n + 2 * u + 1,) * 2)
        A[:n, n : 2 * n] = np.eye(n)
        A[2 * n : 2 * n + u, 2 * n + u : -1] = np.eye(u)
        for j in range(len(A)):
            unit = np.zeros(len(A))
            unit[j] = 1.0
            torque = self._free_torques(unit, sides) if j < len(A) - 1 else 0.0
            A[n : 2 * n, j] = torque / self.J
        constant = self._free_torques(np.zeros(len(A)), sides)  # of the flanks
        A[n : 2 * n, : len(A) - 1] -= (constant / self.J)[:, None]
        A[n : 2 * n, -1] = (constant - np.array(slides) * self.friction) / self.J
        stuck = [i for i in range(n) if self.friction[i] and not slides[i]]
        A[n + np.array(stuck, int)] = 0.0
        return A

    def _left(self, z, mode):
        """Whether a state is outside its mode."""
        sides, slides = mode
        n = len(self.J)
        for side in (1, -1):
            carries = self._flank(z, side)
            for s in range(n - 1):
                if self.gap[s] and (carries[s] > 0) != (sides[s] == side):
                    return True
        torque = self._free_torques(z, sides)
        for i in range(n):
            if self.friction[i] and (
                slides[i] * z[n + i] < -1e-14 if slides[i] else abs(torque[i]) > self.friction[i] * (1 + 1e-13)
            ):
                return True
        return False

    def _mode_after(self, z, sides, slides):
        """The mode of a state just after an event; a rotor that has just changed sign is stopped."""
        n = len(self.J)
        plus, minus = self._flank(z, 1) > 0, self._flank(z, -1) > 0
        sides = [int(p) - int(m) if gap else 0 for p, m, gap in zip(plus, minus, self.gap, strict=True)]
        torque, slides = self._free_torques(z, sides), list(slides)
        for i in range(n):
            if self.friction[i] and (slides[i] == 0 or slides[i] * z[n + i] < -1e-14):
                z[n + i] = 0.0
                slides[i] = int(np.sign(torque[i])) if abs(torque[i]) > self.friction[i] else 0
        return sides, slides

    def _read(self, z, mode):
        n = len(self.J)
        return np.concatenate([z[n : 2 * n], self._shaft_torques(z, mode[0])])


def drawn(seed: int, samples: int = 400) -> tuple[Chain, np.ndarray, np.ndarray]:
    """A chain of two to four inertias, time (t,) and torques (t, 2): harmonic, square, or held at random values."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    J, frequency = 10 ** rng.uniform(-2, 0, n), 10 ** rng.uniform(0.7, 1.7, n - 1)
    k = (2 * np.pi * frequency) ** 2 * J[:-1] * J[1:] / (J[:-1] + J[1:])
    c = 2 * rng.choice([0.003, 0.02, 0.1], n - 1) * k / (2 * np.pi * frequency)
    gap = np.where(rng.random(n - 1) < 0.7, 10 ** rng.uniform(-3, -1.3, n - 1), 0.0)
    if not gap.any():
        gap[rng.integers(n - 1)] = 0.01
    friction = np.where(rng.random(n) < 0.5, rng.uniform(0.2, 2, n), 0.0) * (seed % 4 > 0)
    chain = Chain(J, rng.choice([0.0, 0.05, 0.3], n), friction, k, c, gap, [0, n - 1])
    time = np.arange(samples) * 10 ** rng.uniform(-3, -2.3)
    torque = np.empty((samples, 2))
    for j in range(2):
        size = rng.uniform(2, 15)
        wave = np.sin(2 * np.pi * rng.uniform(1, 8) * time + rng.uniform(0, 6))
        held = np.repeat(rng.normal(0, 1, samples // 10 + 1), 10)[:samples]
        torque[:, j] = size * (wave, np.sign(wave), held)[seed % 3]
    return chain, time, torque
