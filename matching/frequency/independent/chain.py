"""A drivetrain as its dynamic stiffness Z(s): torque over angle, built from the components at every s.

No equations of motion are derived and no states chosen. Angles of all inertias stand as unknowns; rigid gears and
differentials are constraints, taken out by a basis of their null space (Dresig and Holzweissig, Dynamics of Machinery).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np
from scipy.linalg import null_space

from modelling.model.components import Effect
from modelling.model.system import System

Parameters = Mapping[str, float]
# What an effect adds to the complex stiffness of its shaft for small oscillations about rest
_PARALLEL: dict[str, Callable[[Parameters], float]] = {
    "hysteresis": lambda p: p["torque"] / p["angle"],  # a Dahl element that has not slipped yet
    "hardening": lambda p: 0.0,
    "backlash": lambda p: 0.0,  # the lash stands closed
    "quadratic_damping": lambda p: 0.0,
}
_NOTHING_AT_REST = {"quadratic_drag", "constant_torque", "wrong_parameter"}  # no torque that changes with the motion
_SHAFTS = {"slip", "compliance", *_PARALLEL}


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
        for effect in system.effects:
            self._take(effect)
        self.nodes += [f"{shaft} compliance" for shaft, effects in self._on_shaft.items() if "compliance" in effects]

    def _take(self, effect: Effect) -> None:
        parameters = {key: quantity.value for key, quantity in effect.parameters}
        if effect.kind == "wrong_parameter":
            self._value[effect.at] = parameters["value"]
        elif effect.kind in _SHAFTS:
            self._on_shaft.setdefault(effect.at.removeprefix("shafts."), {})[effect.kind] = parameters
        elif effect.kind not in _NOTHING_AT_REST:
            raise NotCovered(f"{effect.kind} at {effect.at}")

    @cached_property
    def basis(self) -> np.ndarray:
        """Angles of the nodes (nodes, n) for unit coordinates."""
        rows = []
        for gear in self.system.gears:
            first, second = (self.unit(end) for end in gear.between)
            rows.append(first - self._value[f"gears.{gear.name}.ratio"] * second)
        for part in self.system.differentials:
            rows.append(self.unit(part.cage) - (self.unit(part.left) + self.unit(part.right)) / 2)
        return null_space(np.array(rows)) if rows else np.eye(len(self.nodes))

    def unit(self, node: str) -> np.ndarray:
        """1 at a node (nodes,)."""
        return np.eye(len(self.nodes))[self.nodes.index(node)]

    def stiffness(self, s: np.ndarray) -> np.ndarray:
        """Z (f, n, n) in the independent coordinates, N·m/rad, at complex s (f,), rad/s."""
        whole = np.zeros((len(s), len(self.nodes), len(self.nodes)), complex)
        for i, name in enumerate(part.name for part in self.system.inertias):
            whole[:, i, i] = s**2 * self._value[f"inertias.{name}.J"] + s * self._value[f"inertias.{name}.drag"]
        for shaft in self.system.shafts:
            complex_stiffness, twist = self.shaft(shaft.name, s)
            whole += complex_stiffness[:, None, None] * np.outer(twist, twist)
            further = self._on_shaft.get(shaft.name, {}).get("compliance")
            if further:
                middle = self.nodes.index(f"{shaft.name} compliance")
                behind = self.unit(self.nodes[middle]) - self.unit(shaft.between[1])
                whole += further["stiffness"] * np.outer(behind, behind)
                whole[:, middle, middle] += s**2 * further["J"]
        return self.basis.T @ whole @ self.basis

    def shaft(self, name: str, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Complex stiffness (f,) of a shaft, on its second end's side, and its twist (nodes,) for unit angles."""
        shaft = self.system[f"shafts.{name}"]
        effects, ratio = self._on_shaft.get(name, {}), self._value.get(f"shafts.{name}.ratio", 1.0)
        own = self._value[f"shafts.{name}.stiffness"] + s * self._value[f"shafts.{name}.damping"]
        parallel = sum(_PARALLEL[kind](p) for kind, p in effects.items() if kind in _PARALLEL)
        if "slip" in effects:  # spring and damper in series with a further damper
            series = s * effects["slip"]["coefficient"]
            if parallel:
                raise NotCovered(f"slip beside another effect at shafts.{name}")
            own = own * series / (own + series)
        second = f"{name} compliance" if "compliance" in effects else shaft.between[1]  # type: ignore[union-attr]
        return own + parallel, self.unit(shaft.between[0]) / ratio - self.unit(second)  # type: ignore[union-attr]

    def drive(self, inputs: list[str]) -> np.ndarray:
        """Generalised torques (n, u) of unit torques at inputs of the system."""
        on = {source.name: source.on for source in self.system.inputs}
        return self.basis.T @ np.array([self.unit(on[name]) for name in inputs]).T.reshape(len(self.nodes), len(inputs))

    def reading(self, sensor: str, s: np.ndarray) -> np.ndarray:
        """What a sensor reads (f, n) for unit coordinates; SI.

        Raises
        ------
        NotCovered
            If an effect sits at the sensor.
        """
        part = next(sensor_ for sensor_ in self.system.sensors if sensor_.name == sensor)
        if part.measures == "torque":
            complex_stiffness, twist = self.shaft(part.of, s)
            return complex_stiffness[:, None] * (twist @ self.basis)
        power = {"angle": 0, "speed": 1, "acceleration": 2}[part.measures]
        return (s**power)[:, None] * (self.unit(part.of) @ self.basis)
