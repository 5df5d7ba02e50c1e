"""A drivetrain as its dynamic stiffness Z(s): torque over angle, built from the components at every s.

No equations of motion are derived and no states chosen. Angles of all inertias stand as unknowns; rigid gears and
differentials are constraints, taken out by a basis of their null space (Dresig and Holzweissig, Dynamics of Machinery).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from functools import cached_property

import numpy as np
from scipy.linalg import null_space

from matching.frequency.independent.steady import RESISTS, Balance, patch_slip
from modelling.model.components import Effect
from modelling.model.system import System

Parameters = Mapping[str, float]
# What an effect adds to the complex stiffness of its shaft for small oscillations about rest or steady motion
_PARALLEL: dict[str, Callable[[Parameters], float]] = {
    "hysteresis": lambda p: p["torque"] / p["angle"],  # a Dahl element that has not slipped yet
    "hardening": lambda p: 0.0,
    "backlash": lambda p: 0.0,  # the lash stands closed
    "quadratic_damping": lambda p: 0.0,
}
_NOTHING_AT_REST = {"quadratic_drag", "constant_torque", "wrong_parameter"}  # no torque that changes with the motion
_SHAFTS = {"slip", "tyre_slip", "compliance", *_PARALLEL}
_BENT = {"hysteresis", "hardening", "backlash"}
# What a sensor's effect does, as sections (d, c, T) in a row: d + c/(1 + s·T)
_SENSORS: dict[str, tuple[str, Callable[[float], list[tuple[float, float, float]]]]] = {
    "sensor_gain": ("factor", lambda factor: [(factor, 0.0, 0.0)]),
    "lag": ("time_constant", lambda time: [(0.0, 1.0, time)]),
    "all_pass": ("delay", lambda delay: 2 * [(-1.0, 2.0, delay / 4)]),
}


class NotCovered(Exception):
    """The model holds something that this method does not know."""


class Chain:
    """Dynamic stiffness of a system; n independent coordinates, f complex frequencies.

    Raises
    ------
    NotCovered
        If an effect is not known here.
    """

    def __init__(self, system: System):
        self.system = system
        self.nodes = [part.name for part in system.inertias]
        self._value = {name: quantity.value for name, quantity in system.parameters.items()}
        self._on_shaft: dict[str, dict[str, dict[str, float]]] = {}
        self._on_sensor: dict[str, list[tuple[str, str]]] = {}  # kind and name of the parameter
        self._resists: list[tuple[int, str, dict[str, float]]] = []
        self._rolling: dict[str, tuple[float, float]] = {}  # by shaft: speed of the road, torque
        for effect in system.effects:
            self._take(effect)
        self.nodes += [f"{shaft} compliance" for shaft, effects in self._on_shaft.items() if "compliance" in effects]
        self._slope = np.array([self._value.get(f"inertias.{name}.drag", 0.0) for name in self.nodes])
        if system.operating_point is not None and (self._resists or self._bent() or self._patches()):
            self._move()

    def with_values(self, values: Parameters) -> Chain:
        """The same system with some quantities other than its own, SI; ratios stay."""
        other = copy(self)
        other._value = self._value | dict(values)
        return other

    def _take(self, effect: Effect) -> None:
        parameters = {key: quantity.value for key, quantity in effect.parameters}
        if effect.kind == "wrong_parameter":
            self._value[effect.at] = parameters["value"]
        elif effect.kind in _SHAFTS:
            self._on_shaft.setdefault(effect.at.removeprefix("shafts."), {})[effect.kind] = parameters
        elif effect.kind in _SENSORS and effect.at.startswith("sensors."):
            for place in effect.places:
                entry = effect.kind, f"{effect.name}.{_SENSORS[effect.kind][0]}"
                self._on_sensor.setdefault(place.removeprefix("sensors."), []).append(entry)
        elif effect.kind in RESISTS and self.system.operating_point is not None:
            self._resists.append((self.nodes.index(effect.at.removeprefix("inertias.")), effect.kind, parameters))
        elif effect.kind not in _NOTHING_AT_REST:
            raise NotCovered(f"{effect.kind} at {effect.at}")

    def _bent(self) -> list[str]:
        """Shafts whose stiffness depends on the torque that they carry."""
        return [name for name, effects in self._on_shaft.items() if effects.keys() & _BENT]

    def _patches(self) -> list[str]:
        """Shafts with a tyre's contact patch in series, in the model's order."""
        return [part.name for part in self.system.shafts if "tyre_slip" in self._on_shaft.get(part.name, {})]

    def _move(self) -> None:
        """Drag and stiffness as they are in steady motion at the operating point."""
        point = self.system.operating_point
        assert point is not None
        speeds, torques = dict(point.speeds), dict(point.torques)
        springs: list[np.ndarray] = []
        slips, patches = [], []
        for shaft in self.system.shafts:
            effects = self._on_shaft.get(shaft.name, {})
            if "tyre_slip" in effects:
                patches.append((len(springs), self.nodes.index(shaft.between[1]), effects["tyre_slip"]))
            springs.append(self._twist(shaft.name))
            slips.append(1 / effects["slip"]["coefficient"] if "slip" in effects else 0.0)
            if "compliance" in effects:
                springs.append(self.unit(f"{shaft.name} compliance") - self.unit(shaft.between[1]))
                slips.append(0.0)
        balance = Balance(
            np.array(springs).reshape(-1, len(self.nodes)),
            self._rigid,
            np.array([self.unit(source.on) for source in self.system.inputs]).reshape(-1, len(self.nodes)),
            np.array(slips),
            self._slope,
            tuple(self._resists),
            np.array([torques.get(source.name, np.nan) for source in self.system.inputs]),
            np.array([speeds.get(node, np.nan) for node in self.nodes]),
            tuple(patches),
        )
        motion = balance.solve()
        if motion is None or balance.sticking(motion[0]):
            raise NotCovered("this operating point")
        self._slope = balance.resistance(motion[0])[1]
        self._rolling = {
            name: (float(motion[0][node]), float(motion[1][row]))
            for name, (row, node, _) in zip(self._patches(), patches, strict=True)
        }
        for name in self._bent():
            row = next(i for i, spring in enumerate(springs) if np.array_equal(spring, self._twist(name)))
            self._bend(name, abs(float(motion[1][row])))

    def _bend(self, name: str, torque: float) -> None:
        """Stiffness of a shaft that carries a torque, and that its lash is closed."""
        effects = self._on_shaft[name]
        if "hysteresis" in effects or torque < 1e-6:
            raise NotCovered(f"{' and '.join(effects)} at shafts.{name} at this operating point")
        cubic, stiffness = effects.get("hardening", {}).get("cubic", 0.0), self._value[f"shafts.{name}.stiffness"]
        roots = np.roots([cubic, 0.0, stiffness, -torque]) if cubic else np.array([torque / stiffness])
        twist = min(root.real for root in roots if abs(root.imag) < 1e-9 * abs(root) and root.real > 0)
        self._value[f"shafts.{name}.stiffness"] = stiffness + 3 * cubic * twist**2

    def _twist(self, name: str) -> np.ndarray:
        """Twist (nodes,) of a shaft for unit angles."""
        shaft = next(shaft for shaft in self.system.shafts if shaft.name == name)
        second = f"{name} compliance" if "compliance" in self._on_shaft.get(name, {}) else shaft.between[1]
        return self.unit(shaft.between[0]) / self._value.get(f"shafts.{name}.ratio", 1.0) - self.unit(second)

    @cached_property
    def basis(self) -> np.ndarray:
        """Angles of the nodes (nodes, n) for unit coordinates."""
        return null_space(self._rigid) if len(self._rigid) else np.eye(len(self.nodes))

    @property
    def _rigid(self) -> np.ndarray:
        """Rows (c, nodes) that are 0 for angles that rigid gears and differentials allow."""
        rows = []
        for gear in self.system.gears:
            first, second = (self.unit(end) for end in gear.between)
            rows.append(first - self._value[f"gears.{gear.name}.ratio"] * second)
        for part in self.system.differentials:
            rows.append(self.unit(part.cage) - (self.unit(part.left) + self.unit(part.right)) / 2)
        return np.array(rows).reshape(-1, len(self.nodes))

    def unit(self, node: str) -> np.ndarray:
        """1 at a node (nodes,)."""
        return np.eye(len(self.nodes))[self.nodes.index(node)]

    def stiffness(self, s: np.ndarray) -> np.ndarray:
        """Z (f, n, n) in the independent coordinates, N·m/rad, at complex s (f,), rad/s."""
        whole = np.zeros((len(s), len(self.nodes), len(self.nodes)), complex)
        for i, name in enumerate(part.name for part in self.system.inertias):
            whole[:, i, i] = s**2 * self._value[f"inertias.{name}.J"] + s * self._slope[i]
        for shaft in self.system.shafts:
            complex_stiffness, twist = self.shaft(shaft.name, s)
            whole += complex_stiffness[:, None, None] * np.outer(self._twist(shaft.name), twist)
            further = self._on_shaft.get(shaft.name, {}).get("compliance")
            if further:
                middle = self.nodes.index(f"{shaft.name} compliance")
                behind = self.unit(self.nodes[middle]) - self.unit(shaft.between[1])
                whole += further["stiffness"] * np.outer(behind, behind)
                whole[:, middle, middle] += s**2 * further["J"]
        return self.basis.T @ whole @ self.basis

    def shaft(self, name: str, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Complex stiffness (f,) of a shaft, on its second end's side, and the twist (nodes,) that it answers to."""
        effects = self._on_shaft.get(name, {})
        stiffness = self._value[f"shafts.{name}.stiffness"] + s * self._value[f"shafts.{name}.damping"]
        parallel = sum(_PARALLEL[kind](p) for kind, p in effects.items() if kind in _PARALLEL)
        if "slip" in effects:  # spring and damper in series with a further damper
            series = s * effects["slip"]["coefficient"]
            if parallel:
                raise NotCovered(f"slip beside another effect at shafts.{name}")
            stiffness = stiffness * series / (stiffness + series)
        if "tyre_slip" in effects:
            if effects.keys() & _BENT:
                raise NotCovered(f"slip of a tyre beside another effect at shafts.{name}")
            return self._patch(name, stiffness, s)
        return stiffness + parallel, self._twist(name)

    def _patch(self, name: str, carcass: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A carcass of complex stiffness (f,) on a patch whose slip is torque over speed; see :meth:`shaft`.

        The slip that there is anyway turns the patch a little further for each turn of the road.
        """
        parameters, (speed, torque) = self._on_shaft[name]["tyre_slip"], self._rolling.get(name, (0.0, 0.0))
        at_zero, (slip, by_torque) = parameters["slip_stiffness"], patch_slip(parameters, torque)
        passed_on = 1 / (by_torque * at_zero)
        second = self.unit(next(part.between[1] for part in self.system.shafts if part.name == name))
        series = at_zero * s / (at_zero * s + abs(speed) * carcass)
        return passed_on * carcass * series, self._twist(name) - slip * np.sign(speed) * second

    def drive(self, inputs: list[str]) -> np.ndarray:
        """Generalised torques (n, u) of unit torques at inputs of the system."""
        on = {source.name: source.on for source in self.system.inputs}
        return self.basis.T @ np.array([self.unit(on[name]) for name in inputs]).T.reshape(len(self.nodes), len(inputs))

    def reading(self, sensor: str, s: np.ndarray) -> np.ndarray:
        """What a sensor reads (f, n) for unit coordinates; SI."""
        factor = np.ones(len(s), complex)
        for direct, lagged, time in self.sections(sensor):
            factor *= direct + lagged / (1 + s * time)
        return factor[:, None] * self.measured(sensor, s)

    def sections(self, sensor: str) -> list[tuple[float, float, float]]:
        """What effects at a sensor do: (d, c, T) of d + c/(1 + s·T), T in s, one section behind the other."""
        effects = self._on_sensor.get(sensor, ())
        return [section for kind, name in effects for section in _SENSORS[kind][1](self._value[name])]

    def measured(self, sensor: str, s: np.ndarray) -> np.ndarray:
        """What a sensor without faults reads (f, n) for unit coordinates; SI."""
        part = next(sensor_ for sensor_ in self.system.sensors if sensor_.name == sensor)
        if part.measures == "torque":
            complex_stiffness, twist = self.shaft(part.of, s)
            return complex_stiffness[:, None] * (twist @ self.basis)
        power = {"angle": 0, "speed": 1, "acceleration": 2}[part.measures]
        return (s**power)[:, None] * (self.unit(part.of) @ self.basis)
