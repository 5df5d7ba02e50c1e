"""States at the start of a segment: which angles are held, and where a fit begins."""

from __future__ import annotations

import numpy as np

from matching.diagnosis.data.segments import Segment
from modelling.equations.compiled import Model
from modelling.model.system import System

FIRST_SAMPLES = 20  # that are averaged for the speed at the start


def angles_without_reading(system: System, model: Model) -> set[int]:
    """Coordinates that are held at the start: one of every connected part of the drivetrain without an angle sensor.

    Speeds, torques and accelerations do not depend on the common angle of such a part.
    """
    connected = _connected_inertias(system)
    known = {name for sensor in system.sensors if sensor.measures == "angle" for name in connected[sensor.of]}
    held = set()
    for i, coordinate in enumerate(model.coordinates):
        if coordinate in connected and coordinate not in known:
            held.add(i)
            known |= connected[coordinate]
    return held


def _connected_inertias(system: System) -> dict[str, set[str]]:
    """By inertia: those that shafts, gears and differentials connect it with, itself included."""
    connected = {part.name: {part.name} for part in system.inertias}
    joints = [shaft.between for shaft in system.shafts] + [gear.between for gear in system.gears]
    for ends in [*joints, *((part.cage, part.left, part.right) for part in system.differentials)]:
        merged = set().union(*(connected[name] for name in ends))
        for name in merged:
            connected[name] = merged
    return connected


def flank_shifts(system: System, model: Model) -> list[np.ndarray]:
    """Changes (x,) of a start state: none, and with backlash to either flank of each gap.

    A start state is fitted from each of them: within a gap no torque tells in which direction the flanks are.
    """
    shifts = [np.zeros(len(model.states))]
    for effect in system.effects:
        if not effect.law.free_play:
            continue
        gap = system.parameters[f"{effect.name}.{effect.law.free_play}"].value
        shaft = next(shaft for shaft in system.shafts if f"shafts.{shaft.name}" == effect.at)
        moved = _turns_with(system, shaft.between[1], shaft.name)
        shift = np.array([moved.get(name, 0.0) for name in model.coordinates])
        for flank in (-gap / 2, gap / 2):
            shifts.append(np.concatenate([flank * shift, np.zeros(len(model.states) - model.n)]))
    return shifts


def _turns_with(system: System, inertia: str, without_shaft: str) -> dict[str, float]:
    """By inertia: its angle when one turns by 1 rad and all that is connected follows without twist, a shaft left
    out."""
    angles, reached = {inertia: 1.0}, [inertia]
    while reached:
        name = reached.pop()
        for shaft in system.shafts:
            if name not in shaft.between or shaft.name == without_shaft:
                continue
            first, second = shaft.between
            ratio = system.parameters.get(f"shafts.{shaft.name}.ratio")
            factor = ratio.value if ratio is not None else 1.0
            other, angle = (second, angles[name] / factor) if name == first else (first, angles[name] * factor)
            if other not in angles:
                angles[other] = angle
                reached.append(other)
    return angles


def first_state(system: System, model: Model, segment: Segment) -> np.ndarray:
    """A state (x,) from which a fit of the start state begins.

    Speeds and angles as measured; other inertias turn with the mean of the measured speeds, where there is no gear.
    """
    x, n = np.zeros(len(model.states)), model.n
    speeds: dict[int, float] = {}
    for j, sensor in enumerate(system.sensors):
        values = segment.readings[:FIRST_SAMPLES, j]
        values = values[np.isfinite(values)]
        if sensor.of in model.coordinates and len(values):
            i = model.coordinates.index(sensor.of)
            if sensor.measures == "speed":
                speeds[i] = float(values.mean())
            elif sensor.measures == "angle":
                x[i] = float(values[0])
    common = float(np.mean(list(speeds.values()))) if speeds and not system.gears else 0.0
    for i in range(n):
        x[n + i] = speeds.get(i, common)
    return x
