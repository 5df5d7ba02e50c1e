"""Two inertias and a shaft with hard laws, fine steps, no line of the product: what the simulation is measured against.

Semi-implicit Euler of 10 µs. Lash is a dead zone with contact that cannot pull. Dry friction is set-valued: an inertia
that would change its speed's sign within a step stops there, and stays as long as what drives it does not exceed the
breakaway.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

STEP = 1e-5


@dataclass
class Friction:
    """Sliding torque by direction; breakaway and Stribeck speed where it falls."""

    forward: float = 0.0
    reverse: float = 0.0
    breakaway: float = 0.0
    stribeck: float = 0.0

    def sliding(self, speed: float) -> float:
        plain = self.forward if speed > 0 else self.reverse
        if not self.stribeck:
            return plain
        return plain + (self.breakaway - plain) * math.exp(-((speed / self.stribeck) ** 2))

    def next_speed(self, speed: float, torque: float, J: float) -> float:
        """Speed after a step under the torque of everything else."""
        if speed == 0.0:
            most = (self.breakaway or self.forward) if torque > 0 else (self.breakaway or self.reverse)
            if abs(torque) <= most:
                return 0.0
            return STEP * (torque - math.copysign(self.sliding(math.copysign(1e-12, torque)), torque)) / J
        new = speed + STEP * (torque - math.copysign(self.sliding(speed), speed)) / J
        return 0.0 if new * speed < 0 and (self.forward or self.breakaway) else new


def two_mass(
    time: np.ndarray,
    motor: np.ndarray,
    brake: np.ndarray,
    J: tuple[float, float] = (0.09, 1.3),
    drag: tuple[float, float] = (0.02, 0.15),
    stiffness: float = 300.0,
    damping: float = 0.4,
    gap: float = 0.0,
    dahl: tuple[float, float] | None = None,
    friction: tuple[Friction, Friction] | None = None,
) -> dict[str, np.ndarray]:
    """Speeds and shaft torque (t,) from rest; evenly sampled torques on motor and load, linear between."""
    friction = friction or (Friction(), Friction())
    dt = time[1] - time[0]
    inner = round(dt / STEP)
    a1 = a2 = v1 = v2 = z = 0.0
    out = np.empty((len(time), 3))
    for k in range(len(time)):
        for i in range(inner):
            twist, rate = a1 - a2, v1 - v2
            torque = stiffness * twist + damping * rate
            if gap:
                over = abs(twist) - gap / 2
                side = math.copysign(1.0, twist)
                torque = side * max(0.0, stiffness * over + damping * rate * side) if over > 0 else 0.0
            if dahl:
                torque += z
            if i == 0:
                out[k] = v1, v2, torque
                if k + 1 == len(time):
                    break
            w = i / inner
            u1 = motor[k] + (motor[k + 1] - motor[k]) * w
            u2 = brake[k] + (brake[k + 1] - brake[k]) * w
            v1 = friction[0].next_speed(v1, u1 - drag[0] * v1 - torque, J[0])
            v2 = friction[1].next_speed(v2, u2 - drag[1] * v2 + torque, J[1])
            if dahl:
                z += STEP * rate * (1 - math.copysign(1.0, rate) * z / dahl[0]) * dahl[0] / dahl[1]
            a1 += STEP * v1
            a2 += STEP * v2
    return {"motor_speed": out[:, 0], "load_speed": out[:, 1], "link_torque": out[:, 2]}
