"""States at the start of a segment: which angles are held, and where a fit begins."""

from __future__ import annotations

import numpy as np

from matching.diagnosis.data.segments import Segment
from modelling.equations.compiled import Model
from modelling.model.components import Effect, Gear, Shaft
from modelling.model.system import System

FIRST_SAMPLES = 20  # that are averaged for the speed at the start


def sensors_with_zero(system: System) -> list[int]:
    """Angle sensors whose zero is fitted, by index: all but the first of every connected part of the drivetrain.

    Encoders start anywhere. The zero of the first is the angle at the start, which is fitted anyway; the difference
    between two says nothing about the twist of what is between them.
    """
    connected, reached, with_zero = _connected_inertias(system), set[str](), []
    for j, sensor in enumerate(system.sensors):
        if sensor.measures == "angle":
            if sensor.of in reached:
                with_zero.append(j)
            reached |= connected[sensor.of]
    return with_zero


def angles_without_reading(system: System, model: Model) -> set[int]:
    """Coordinates that are held at the start: one of every connected part of the drivetrain without an angle sensor.

    Speeds, torques and accelerations do not depend on the common angle of such a part, unless one of it is imposed.
    """
    connected, quantities = _connected_inertias(system), system.input_quantities
    measured = [sensor.of for sensor in system.sensors if sensor.measures == "angle"]
    measured += [part.on for part in system.inputs if quantities[part.name] == "angle"]
    known = {name for angle_of in measured for name in connected[angle_of]}
    held = set()
    for i, coordinate in enumerate(model.coordinates):
        if coordinate in connected and coordinate not in known:
            held.add(i)
            known |= connected[coordinate]
    return held


def states_of_time(system: System, model: Model) -> list[tuple[int, Effect]]:
    """States, by index, that follow from the time since a recording began alone, with the effect they are of."""
    return [
        (model.states.index(effect.name), effect)
        for effect in system.effects
        if effect.law.state is not None and effect.law.state.from_zero
    ]


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


def _turns_with(system: System, inertia: str, without_shaft: str = "") -> dict[str, float]:
    """By inertia: its angle when one turns by 1 rad and all that shafts and gears connect follows without twist, a
    shaft left out."""
    angles, reached = {inertia: 1.0}, [inertia]
    joints: dict[str, Shaft | Gear] = {
        f"shafts.{shaft.name}": shaft for shaft in system.shafts if shaft.name != without_shaft
    }
    joints |= {f"gears.{gear.name}": gear for gear in system.gears}
    while reached:
        name = reached.pop()
        for place, joint in joints.items():
            if name not in joint.between:
                continue
            first, second = joint.between
            ratio = system.parameters.get(f"{place}.ratio")
            factor = ratio.value if ratio is not None else 1.0
            other, angle = (second, angles[name] / factor) if name == first else (first, angles[name] * factor)
            if other not in angles:
                angles[other] = angle
                reached.append(other)
    return angles


def first_state(system: System, model: Model, segment: Segment) -> np.ndarray:
    """A state (x,) from which a fit of the start state begins.

    Speeds as measured; other inertias turn with the mean of the measured speeds, where there is no gear. The first
    angle sensor of a connected part gives its angle; the rest of the part stands without twist. An imposed motion
    begins as recorded.
    """
    x, n = np.zeros(len(model.states)), model.n
    with_zero = sensors_with_zero(system)
    speeds: dict[int, float] = {}
    for j, sensor in enumerate(system.sensors):
        values = segment.readings[:FIRST_SAMPLES, j]
        values = values[np.isfinite(values)]
        if not len(values):
            continue
        if sensor.measures == "speed" and sensor.of in model.coordinates:
            speeds[model.coordinates.index(sensor.of)] = float(values.mean())
        elif sensor.measures == "angle" and j not in with_zero:
            for name, share in _turns_with(system, sensor.of).items():
                if name in model.coordinates:
                    x[model.coordinates.index(name)] = share * float(values[0])
    common = float(np.mean(list(speeds.values()))) if speeds and not system.gears else 0.0
    for i in range(n):
        x[n + i] = speeds.get(i, common)
    _start_as_imposed(system, model, segment, x)
    return x


def _start_as_imposed(system: System, model: Model, segment: Segment, x: np.ndarray) -> None:
    """Let, in place, inertias whose motion is imposed begin as recorded."""
    for j, part in enumerate(system.inputs):
        if part.name not in system.imposed_by or part.on not in model.coordinates:
            continue
        i, recorded = model.coordinates.index(part.on), segment.inputs[:FIRST_SAMPLES, j]
        if system.input_quantities[part.name] == "angle":
            for name, share in _turns_with(system, part.on).items():
                if name in model.coordinates:
                    x[model.coordinates.index(name)] = share * recorded[0]
            recorded = np.gradient(recorded, segment.time[:FIRST_SAMPLES])
        x[model.n + i] = recorded[0]
