"""A drivetrain as one rigid body: its inertia, and torque and speed of a recording, all at the shaft of one sensor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from modelling.model.system import System


@dataclass(frozen=True)
class RigidBody:
    """Inertia (kg·m²), torque (t,) (N·m) and speed (t,) (rad/s) at one shaft, and how often time divides the speed's
    change: once where the speed was recorded, twice where it comes from an angle."""

    inertia: float
    torque: np.ndarray
    speed: np.ndarray
    order: int


def as_one_rigid_body(time: np.ndarray, channels: Mapping[str, np.ndarray], system: System) -> Iterator[RigidBody]:
    """One for each recorded speed or angle of an inertia, channels (t,) at times (t,) in s; complete ones alone."""
    for sensor in system.sensors:
        if sensor.measures not in ("speed", "angle") or sensor.name not in channels:
            continue
        ratios = _speed_ratios(system, sensor.of)
        inertia = sum(part.J.value * ratios[part.name] ** 2 for part in system.inertias if part.name in ratios)
        torque = sum((ratios[part.on] * channels[part.name] for part in system.inputs if part.on in ratios), 0 * time)
        motion = channels[sensor.name]
        if inertia <= 0 or not np.isfinite(motion).all():
            continue
        if sensor.measures == "speed":
            yield RigidBody(inertia, torque, motion, 1)
        else:
            yield RigidBody(inertia, torque, np.gradient(motion, time), 2)


def _speed_ratios(system: System, root: str) -> dict[str, float]:
    """Speed of each inertia that shafts, gears and differentials connect to ``root``, over its speed."""
    ratios, waiting = {root: 1.0}, [root]
    links: list[tuple[str, str, float]] = []
    links += [(*shaft.between, shaft.ratio.value if shaft.ratio else 1.0) for shaft in system.shafts]
    links += [(*gear.between, gear.ratio.value) for gear in system.gears]
    for part in system.differentials:
        links += [(part.cage, part.left, 1.0), (part.cage, part.right, 1.0)]
    while waiting:
        name = waiting.pop()
        for first, second, ratio in links:  # speed(first) = ratio · speed(second)
            if first == name and second not in ratios and ratio:
                ratios[second] = ratios[name] / ratio
                waiting.append(second)
            elif second == name and first not in ratios:
                ratios[first] = ratios[name] * ratio
                waiting.append(first)
    return ratios
