"""What the vehicle's own manoeuvre asks of adapters and dynamometers, as constraints on what may move.

If the rig reproduces the vehicle's response, the cut shafts carry the vehicle's torques, and their ends on the rig turn
as the vehicle's do. Between the cuts and the rotors the rig's shafts count as stiff. Speeds then follow from ratios,
gears and differentials, and the balance of torques gives what each shaft carries and each dynamometer supplies. Torques
and speeds are absolute: the vehicle begins at its operating point, at standstill without one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from matching.match.case import LIMITS_OF_ALL, Case, own_limit
from matching.match.requirements import STRESSES, TORQUE_OVER_SPEED
from modelling.bed.vehicle import TorqueCurve
from modelling.linear.state_space import discretise
from modelling.linear.steady_motion import operating_motion, torques_of
from modelling.simulation.simulate import simulate
from modelling.system import MOVABLE_DIMENSIONS, Drawing, Sensor
from modelling.topology import Joint, connected_parts, joints, path

SAMPLING_RATE = 1000.0  # Hz, of the manoeuvre: twenty samples a period of 50 Hz, above what moves a driveline by much
LEAST_STIFFNESS = 1e-9  # N·m/rad: no stiffness at all, for twists that are too large whatever they are
SEEN = 1e-4  # relative change by which a quantity is tried
RIGID = 1e6  # times the stiffest shaft: how a gear shares a torque with parallel shafts


class ExceededLimit(NamedTuple):
    """A limit of a dynamometer or of the shafts before it, what the manoeuvre takes of it, and what is allowed; SI."""

    dynamometer: str
    limit: str
    demand: float
    allowed: float


@dataclass(frozen=True)
class CutMotion:
    """The manoeuvre at one cut, where the rig takes it over.

    Attributes
    ----------
    end : str
        The inertia of the rig there.
    torque, acceleration, speed : ndarray (t,)
        What the cut shaft transmits into it, N·m; its motion, rad/s² and rad/s.
    """

    end: str
    torque: np.ndarray
    acceleration: np.ndarray
    speed: np.ndarray


class Loads(NamedTuple):
    """Torque (t,) N·m by shaft, at its second end, and torque and speed (t,) rad/s by dynamometer, at its rotor."""

    shafts: Mapping[str, np.ndarray]
    torques: Mapping[str, np.ndarray]
    speeds: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class BehindCut:
    """A connected part of the rig behind one cut, or behind several, with its dynamometers.

    Attributes
    ----------
    inertias : tuple of str
        n names.
    joints : tuple of Joint
        What connects them.
    cuts : tuple of CutMotion
        c of them.
    rotors : dict of str to str
        Inertia that a dynamometer acts on, by dynamometer, in the order of ``cuts``.
    """

    inertias: tuple[str, ...]
    joints: tuple[Joint, ...]
    cuts: tuple[CutMotion, ...]
    rotors: Mapping[str, str]

    @cached_property
    def ways(self) -> dict[str, tuple[str, ...]]:
        """By dynamometer the shafts from its cut to its rotor."""
        ways = {}
        for (name, rotor), cut in zip(self.rotors.items(), self.cuts, strict=True):
            way = [joint.place for joint in path(cut.end, rotor, self.joints) or () if not joint.rigid]
            ways[name] = tuple(place.removeprefix("shafts.") for place in way)
        return ways

    def loads(self, values: Mapping[str, float]) -> Loads:
        """What the manoeuvre asks of shafts and dynamometers at values of the rig's quantities ``rig.…``, SI."""
        rows, free = self._constraints(values)
        turns, driven = (_selected(self.inertias, ends) for ends in ([c.end for c in self.cuts], self.rotors.values()))
        J, drag = (np.diag([values[f"rig.inertias.{name}.{key}"] for name in self.inertias]) for key in ("J", "drag"))
        torque, acceleration, speed = (
            np.array([getattr(cut, of) for cut in self.cuts]) for of in ("torque", "acceleration", "speed")
        )
        per_cut = free @ np.linalg.pinv(turns @ free)  # speed of each inertia per speed of a cut
        speeds, accelerations = per_cut @ speed, per_cut @ acceleration
        own = free @ null_space(turns @ free) if free.shape[1] > len(turns) else np.zeros((len(J), 0))
        missing = J @ accelerations + drag @ speeds - turns.T @ torque  # what dynamometers and joints have to supply
        if own.shape[1]:
            more, faster = _internal_motion(free, own, driven, J, drag, missing)
            speeds, accelerations = speeds + own @ more, accelerations + own @ faster
            missing = missing + J @ own @ faster + drag @ own @ more
        supplied = np.linalg.lstsq(free.T @ driven.T, free.T @ missing)[0]
        carried = self._shares(rows, values) @ (missing - driven.T @ supplied)
        shafts = {
            joint.place.removeprefix("shafts."): carried[i] for i, joint in enumerate(self.joints) if not joint.rigid
        }
        return Loads(shafts, dict(zip(self.rotors, supplied)), dict(zip(self.rotors, driven @ speeds)))

    def reflected_inertia(self, values: Mapping[str, float]) -> float:
        """Inertia that the first cut has to accelerate, kg·m²: all behind it, by the square of its ratio."""
        _, free = self._constraints(values)
        ratio = free @ np.linalg.pinv(_selected(self.inertias, [self.cuts[0].end]) @ free)[:, 0]
        return float(ratio**2 @ [values[f"rig.inertias.{name}.J"] for name in self.inertias])

    def _constraints(self, values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Twist of every joint per angle of each inertia (j, n), and a basis (n, m) of motions that twist none."""
        rows = np.zeros((len(self.joints), len(self.inertias)))
        for row, joint in zip(rows, self.joints, strict=True):
            ratio = values.get(f"rig.{joint.place}.ratio", 1.0)
            shares = (-1.0, 1 / (1 + ratio), ratio / (1 + ratio)) if joint.divides else (-1 / ratio, 1.0)
            for end, share in zip(joint.ends, shares, strict=True):
                row[self.inertias.index(end)] = -share
        return rows, null_space(rows) if len(rows) else np.eye(len(self.inertias))

    def _shares(self, rows: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        """Torque of each joint per torque on each inertia (j, n) that it has to balance.

        Parallel shafts share a torque by their stiffness: the least elastic energy (Castigliano).
        """
        stiffness = np.array([values.get(f"rig.{joint.place}.stiffness", np.inf) for joint in self.joints])
        stiffest = np.max(stiffness, where=np.isfinite(stiffness), initial=1.0)
        weight = np.sqrt(np.where(np.isfinite(stiffness), np.maximum(stiffness, 1e-9), RIGID * stiffest) / stiffest)
        return weight[:, None] * np.linalg.pinv((weight[:, None] * rows).T)


def _internal_motion(
    free: np.ndarray, own: np.ndarray, driven: np.ndarray, J: np.ndarray, drag: np.ndarray, missing: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Speeds and accelerations (r, t) of motions ``own`` (n, r) that neither cuts nor dynamometers impose.

    A side of an open differential that carries an inertia alone moves by the torque that the differential divides.
    """
    unseen = free @ null_space(driven @ free)  # motions on which the dynamometers do no work
    inertia, damping, torque = unseen.T @ J @ own, unseen.T @ drag @ own, -unseen.T @ missing
    A, B = np.linalg.lstsq(inertia, -damping)[0], np.linalg.lstsq(inertia, np.eye(len(inertia)))[0]
    step = discretise(A, B, 1 / SAMPLING_RATE)
    motion = np.zeros((own.shape[1], torque.shape[1]))
    motion[:, 0] = np.linalg.lstsq(damping, torque[:, 0])[0]
    grown = step.held @ torque[:, :-1] + step.ramp @ np.diff(torque)
    for i, added in enumerate(grown.T):
        motion[:, i + 1] = step.transition @ motion[:, i] + added
    return motion, A @ motion + B @ torque


def _selected(inertias: tuple[str, ...], names: Iterable[str]) -> np.ndarray:
    """Rows (k, n) that pick the named inertias."""
    return np.array([[float(name == inertia) for inertia in inertias] for name in names])


@dataclass(frozen=True)
class Demands:
    """What stands behind the cuts of a case, the limits to keep, and the dynamometers' torque over speed if stated."""

    behind: tuple[BehindCut, ...]
    limits: Mapping[str, float]
    torque_curve: TorqueCurve | None = None
    drawings: Mapping[str, Drawing] = field(default_factory=dict)

    def taken(self, values: Mapping[str, float]) -> list[ExceededLimit]:
        """Every limit with what the manoeuvre takes of it, whether it is exceeded or not."""
        return [one for part in self.behind for one in self._taken(part, values) if one.limit in self.limits]

    def _taken(self, part: BehindCut, values: Mapping[str, float]) -> Iterator[ExceededLimit]:
        loads = part.loads(values)

        def one(dynamometer: str, limit: str, demand: np.ndarray) -> ExceededLimit:
            return ExceededLimit(dynamometer, limit, float(np.abs(demand).max()), self.limits.get(limit, np.inf))

        for shaft, torque in loads.shafts.items():
            dynamometer = next((name for name, way in part.ways.items() if shaft in way), next(iter(part.rotors)))
            yield one(dynamometer, f"shafts.{shaft}.torque", torque)
            stiffness = max(values[f"rig.shafts.{shaft}.stiffness"], LEAST_STIFFNESS)
            yield one(dynamometer, f"shafts.{shaft}.twist", torque / stiffness)
            if shaft in self.drawings:
                for what, stress in stresses(self.drawings[shaft], torque, shaft, values).items():
                    yield one(dynamometer, f"shafts.{shaft}.{what}", np.array([stress]))
        for dynamometer, torque in loads.torques.items():
            speed = loads.speeds[dynamometer]
            own = own_limit(dynamometer, "torque")
            yield one(dynamometer, own if own in self.limits else LIMITS_OF_ALL["torque"], torque)
            yield one(dynamometer, "dynamometer_power", torque * speed)
            if self.torque_curve is not None:
                yield one(dynamometer, TORQUE_OVER_SPEED, torque / self.torque_curve.at(speed))
            yield one(dynamometer, "dynamometer_speed", speed)

    def shares(self, values: Mapping[str, float]) -> np.ndarray:
        """What the manoeuvre takes of every limit, as a share of it."""
        return np.array([one.demand / one.allowed for one in self.taken(values)])

    def broken(self, values: Mapping[str, float], part: float = 1.001) -> list[ExceededLimit]:
        """Limits that the manoeuvre takes more than a part of, worst first."""
        broken = [one for one in self.taken(values) if one.demand > one.allowed * part]
        return sorted(broken, key=lambda exceeded: exceeded.allowed / exceeded.demand)

    def quantities(self, limit: str, values: Mapping[str, float]) -> set[str]:
        """Names of the quantities of the rig that change what the manoeuvre takes of a limit."""

        def demanded(changed: Mapping[str, float]) -> np.ndarray:
            return np.array(
                [one.demand for part in self.behind for one in self._taken(part, changed) if one.limit == limit]
            )

        before = demanded(values)
        behind = {name for part in self.behind for name in (*part.inertias, *(joint.place for joint in part.joints))}
        places = {f"rig.inertias.{name}" for name in behind} | {f"rig.{name}" for name in behind}
        near = [name for name in values if name.rpartition(".")[0] in places]
        return {
            name
            for name in near
            if np.abs(demanded({**values, name: values[name] * (1 + SEEN)}) - before).max(initial=0.0)
            > SEEN**2 * np.abs(before).max(initial=0.0)
        }


def stresses(
    drawing: Drawing, torque: np.ndarray, shaft: str = "", values: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Largest shear stress that a torque (t,) makes in a shaft, and half of the range in which it varies, Pa.

    ``values`` may hold other dimensions of the shaft, as ``rig.shafts.NAME.diameter``.
    """
    given = values or {}
    sizes = {key: given[name] for key in MOVABLE_DIMENSIONS if (name := f"rig.shafts.{shaft}.{key}") in given}
    per_torque = drawing.with_sizes(sizes).stress_per_torque if sizes else drawing.stress_per_torque
    found = float(np.abs(torque).max()), float(np.ptp(torque)) / 2
    return {what: per_torque * value for what, value in zip(STRESSES, found, strict=True)}


def rig_values(case: Case) -> dict[str, float]:
    """Every quantity and dimension of the rig, SI, by its name in a case."""
    return {f"rig.{name}": quantity.value for name, quantity in (case.rig.parameters | case.rig.dimensions).items()}


def demands(case: Case) -> Demands:
    """Simulate the vehicle's manoeuvre and find what it asks behind every cut."""
    time = max(case.manoeuvre.values(), key=lambda torque: torque.duration).time(SAMPLING_RATE)
    inputs = {part.name: np.zeros(len(time)) for part in case.vehicle.inputs}
    inputs |= {name: driven.torque(time) for name, driven in case.manoeuvre.items() if name in inputs}
    inputs = {name: torque + inputs[name] for name, torque in torques_of(case.vehicle).items()}
    cuts = {interface.shaft: interface for interface in case.residual_vehicle.interfaces}
    watched: list[Sensor] = []
    for name, interface in cuts.items():
        watched.append(Sensor(f"cut_{name}_torque", "torque", name))
        watched += [Sensor(f"cut_{name}_{what}", what, interface.vehicle_end) for what in ("speed", "acceleration")]
    vehicle = replace(case.vehicle, sensors=(*case.vehicle.sensors, *watched))
    start = None if vehicle.operating_point is None else operating_motion(vehicle).state
    readings = simulate(vehicle, time, inputs, start=start).readings
    every = joints(case.rig, without=[f"shafts.{name}" for name in cuts])
    on = {part.name: part.on for part in case.rig.inputs}
    behind = []
    for part in connected_parts((inertia.name for inertia in case.rig.inertias), every):
        here = [dyno for dyno in case.loop.dynamometers if cuts[dyno.follows].rig_end in part]
        if not here:
            continue
        motions = []
        for dyno in here:
            cut = cuts[dyno.follows]
            torque, acceleration, speed = (
                readings[f"cut_{cut.shaft}_{what}"] for what in ("torque", "acceleration", "speed")
            )
            motions.append(CutMotion(cut.rig_end, torque * cut.factor, acceleration, speed))
        inside = tuple(joint for joint in every if joint.ends[0] in part)
        rotors = {dyno.name: on[dyno.torque_input] for dyno in here}
        behind.append(BehindCut(tuple(part), inside, tuple(motions), rotors))
    drawings = {shaft.name: shaft.drawing for shaft in case.rig.shafts if shaft.drawing is not None}
    return Demands(tuple(behind), case.limits, case.torque_curve, drawings)
