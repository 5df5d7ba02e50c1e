"""What the vehicle's manoeuvre asks of adapters and dynamometers, as constraints on what may move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from matching.match.case import Case
from matching.match.requirements import TORQUE_OVER_SPEED
from modelling.bed.vehicle import TorqueCurve
from modelling.linear.steady_motion import operating_motion, torques_of
from modelling.simulation.simulate import simulate
from modelling.system import Sensor, Shaft

# If the rig reproduces the vehicle's response, the cut shafts carry the vehicle's torques and their ends turn as the
# vehicle's do. Behind the cut stands a chain of adapters and the rotor: each of its shafts carries the interface torque
# less what the inertias before it and their drag take, the dynamometer what is left. Torques and speeds are absolute:
# the vehicle begins at its operating point, at standstill without one.


@dataclass(frozen=True)
class DynamometerChain:
    """What stands behind one cut, from there to the rotor, and the manoeuvre there.

    ``shafts`` holds each shaft with the inertias before it, ``inertias`` all of them;
    ``torque`` (t,) N·m, ``acceleration`` (t,) rad/s² and ``speed`` (t,) rad/s of the vehicle's interface; ``drag`` of
    each inertia, N·m·s/rad.
    """

    dynamometer: str
    shafts: tuple[tuple[str, tuple[str, ...]], ...]
    inertias: tuple[str, ...]
    torque: np.ndarray
    acceleration: np.ndarray
    speed: np.ndarray
    drag: Mapping[str, float] = field(default_factory=dict)

    def remaining_torque(self, passed: tuple[str, ...]) -> np.ndarray:
        """Interface torque (t,) less the drag of the inertias that it has passed, N·m."""
        return self.torque - sum(self.drag.get(name, 0.0) for name in passed) * self.speed

    def peak(self, passed: tuple[str, ...], inertia: float, factor: np.ndarray | float = 1.0) -> float:
        """Largest |(remaining torque − inertia·acceleration)·factor| over the manoeuvre, inertia in kg·m²."""
        return float(np.abs((self.remaining_torque(passed) - inertia * self.acceleration) * factor).max())


class ExceededLimit(NamedTuple):
    """A limit of a dynamometer or of the shafts before it, what the manoeuvre takes of it, and what is allowed; SI."""

    dynamometer: str
    limit: str
    demand: float
    allowed: float


@dataclass(frozen=True)
class Demands:
    """Chains of a case, the limits they have to keep, and the dynamometers' torque over speed if it is stated."""

    chains: tuple[DynamometerChain, ...]
    limits: Mapping[str, float]
    torque_curve: TorqueCurve | None = None

    def taken(self, values: Mapping[str, float]) -> list[ExceededLimit]:
        """Every limit with what the manoeuvre takes of it, whether it is exceeded or not."""
        every = []
        for chain in self.chains:
            demands = {}
            for shaft, before in chain.shafts:
                torque = chain.peak(before, sum(values[f"rig.inertias.{name}.J"] for name in before))
                demands[f"shafts.{shaft}.torque"] = torque
                demands[f"shafts.{shaft}.twist"] = torque / max(values[f"rig.shafts.{shaft}.stiffness"], 1e-9)
            total = sum(values[f"rig.inertias.{name}.J"] for name in chain.inertias)
            for name, factor in self._at_the_rotor(chain).items():
                demands[name] = chain.peak(chain.inertias, total, factor)
            demands["dynamometer_speed"] = float(np.abs(chain.speed).max())
            every += [
                ExceededLimit(chain.dynamometer, name, demand, self.limits[name])
                for name, demand in demands.items()
                if name in self.limits
            ]
        return every

    def shares(self, values: Mapping[str, float]) -> np.ndarray:
        """What the manoeuvre takes of every limit, as a share of it."""
        return np.array([one.demand / one.allowed for one in self.taken(values)])

    def broken(self, values: Mapping[str, float], part: float = 1.001) -> list[ExceededLimit]:
        """Limits that the manoeuvre takes more than a part of, worst first."""
        broken = [one for one in self.taken(values) if one.demand > one.allowed * part]
        return sorted(broken, key=lambda exceeded: exceeded.allowed / exceeded.demand)

    def quantities(self, limit: str) -> set[str]:
        """Names of the quantities of the rig that decide what the manoeuvre takes of a limit."""
        names: set[str] = set()
        for chain in self.chains:
            behind: dict[str, tuple[str, ...]] = dict.fromkeys(self._at_the_rotor(chain), chain.inertias)
            behind |= {
                f"shafts.{shaft}.{what}": inertias for shaft, inertias in chain.shafts for what in ("torque", "twist")
            }
            names |= {f"rig.inertias.{name}.J" for name in behind.get(limit, ())}
            if limit in behind and limit.endswith(".twist"):
                names.add(f"rig.{limit.removesuffix('.twist')}.stiffness")
        return names

    def _at_the_rotor(self, chain: DynamometerChain) -> dict[str, np.ndarray | float]:
        """What the dynamometer's torque (t,) is multiplied by for each limit on it."""
        factors: dict[str, np.ndarray | float] = {"dynamometer_torque": 1.0, "dynamometer_power": chain.speed}
        if self.torque_curve is not None:
            factors[TORQUE_OVER_SPEED] = 1 / self.torque_curve.at(chain.speed)
        return factors


def rig_values(case: Case) -> dict[str, float]:
    """Every quantity of the rig, SI, by its name in a case."""
    return {f"rig.{name}": quantity.value for name, quantity in case.rig.parameters.items()}


def demands(case: Case, points: int = 400) -> Demands:
    """Simulate the vehicle's manoeuvre and find what it asks behind every cut.

    Parameters
    ----------
    points : int
        The manoeuvre is thinned to about so many samples, extremes kept.
    """
    time = max(case.manoeuvre.values(), key=lambda torque: torque.duration).time(1000.0)
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
    drag = {part.name: part.drag.value for part in case.rig.inertias}
    chains = []
    for dyno in case.loop.dynamometers:
        cut = cuts[dyno.follows]
        rotor = next(part.on for part in case.rig.inputs if part.name == dyno.torque_input)
        shafts, inertias = _path(case, cut.rig_end, rotor, dyno.follows)
        torque = readings[f"cut_{cut.shaft}_torque"] * cut.factor
        acceleration, speed = (readings[f"cut_{cut.shaft}_{what}"] for what in ("acceleration", "speed"))
        extremes = [place(of) for of in (torque, acceleration) for place in (np.argmax, np.argmin)]
        keep = np.union1d(np.linspace(0, len(time) - 1, points).astype(int), extremes)
        chains.append(
            DynamometerChain(dyno.name, shafts, inertias, torque[keep], acceleration[keep], speed[keep], drag)
        )
    return Demands(tuple(chains), case.limits, case.torque_curve)


def _path(
    case: Case, start: str, end: str, without: str
) -> tuple[tuple[tuple[str, tuple[str, ...]], ...], tuple[str, ...]]:
    """Shafts from the cut to the rotor, each with the inertias passed before it, and all inertias up to the rotor."""
    joints: list[Shaft] = [part for part in case.rig.shafts if part.name != without]
    paths: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [(start, (), (start,))]
    reached = {start}
    while paths:
        here, shafts, passed = paths.pop(0)
        if here == end:
            return tuple((name, passed[: i + 1]) for i, name in enumerate(shafts)), passed
        for joint in joints:
            if here in joint.between:
                other = joint.between[1 - joint.between.index(here)]
                if other not in reached:
                    reached.add(other)
                    paths.append((other, (*shafts, joint.name), (*passed, other)))
    return (), (start, end)
