"""Margin, roll-off and noise of a sampled law on the bed as planned, by dynamic stiffness."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from scipy.linalg import expm, null_space

from matching.match.case import Box, Case
from modelling.controller.law import ControlLaw
from modelling.system import Effect, Shaft, System

# --- Steady motion of a chain at its operating point, from the torque balance of every inertia.

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


# --- A drivetrain as its dynamic stiffness Z(s): torque over angle, built from the components at every s.
#
# No equations of motion are derived and no states chosen. Angles of all inertias stand as unknowns; rigid gears and
# differentials are constraints, taken out by a basis of their null space (Dresig and Holzweissig, Dynamics of
# Machinery).

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
    """Dynamic stiffness of a system; n independent coordinates, f complex frequencies."""

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


# --- The closed loop as one matrix W(s): rig, residual vehicle and control law at every s, dead time exact.
#
# Unknowns are the coordinates of the rig, those of the residual vehicle and the air-gap torques. W has no poles in the
# right half plane, so det W turns once round 0 for every closed-loop pole that a contour there encloses.


@dataclass(frozen=True)
class Law:
    """Air-gap torque command of one dynamometer: gains (f,) on reference angle, rotor angle and flange torque."""

    reference: np.ndarray
    rotor: np.ndarray
    torque: np.ndarray


def speed_controller(case: Case, s: np.ndarray) -> Law:
    """lead·[(kp + ki/s)·(reference − speed) + ka·s·reference − kt·torque] at s (f,), speeds as s times angles."""
    loop = case.loop
    lead = (1 + s * loop["lead_time"]) / (1 + s * loop["lead_time"] / 5)
    error = s * loop["proportional_gain"] + loop["integral_gain"]
    ahead = s**2 * loop["acceleration_feed_forward"]
    return Law(lead * (error + ahead), -lead * error, -lead * loop["torque_feed_forward"])


# Feedback of the control structures, written here once more; measured torques do not go round it.
LAWS: dict[str, Callable[[Case, np.ndarray], Law]] = {"pi": speed_controller, "model_based": speed_controller}


@dataclass(frozen=True)
class IndependentLoop:
    """A tuned case in the frequency domain; f complex frequencies, k dynamometers."""

    case: Case
    rig: Chain = field(init=False)
    vehicle: tuple[Chain, ...] = field(init=False)

    def __post_init__(self) -> None:
        if self.case.loop.structure.name not in LAWS:
            raise NotCovered(f"the control structure {self.case.loop.structure.name!r}")
        object.__setattr__(self, "rig", Chain(self.case.rig))
        object.__setattr__(self, "vehicle", tuple(Chain(part) for part in self.case.residual_vehicle.parts))

    def matrix(self, s: np.ndarray) -> np.ndarray:
        """W (f, w, w): rows are the torque balances of rig and residual vehicle, then the control laws."""
        n, k, dynamometers = self.rig.basis.shape[1], len(self.case.loop.dynamometers), self.case.loop.dynamometers
        sizes = [n, *(part.basis.shape[1] for part in self.vehicle), k]
        starts = np.cumsum([0, *sizes])
        W = np.zeros((len(s), starts[-1], starts[-1]), complex)
        torques = starts[-2]
        W[:, :n, :n] = self.rig.stiffness(s)
        W[:, :n, torques:] = -self.rig.drive([dynamometer.torque_input for dynamometer in dynamometers])
        for part, first, last in zip(self.vehicle, starts[1:-2], starts[2:-1], strict=True):
            W[:, first:last, first:last] = part.stiffness(s)
        law = LAWS[self.case.loop.structure.name](self.case, s)
        act = self.actuator(s)
        for j in range(k):
            torque, rotor = self.measured(j, s)
            at, end = self.interface(j)
            rows = slice(starts[1 + at], starts[2 + at])
            W[:, rows, :n] -= (self.vehicle[at].basis.T @ self.vehicle[at].unit(end))[None, :, None] * torque[:, None]
            reference = self.vehicle[at].unit(end) @ self.vehicle[at].basis
            W[:, torques + j, torques + j] = 1
            W[:, torques + j, rows] -= (act * law.reference)[:, None] * reference
            W[:, torques + j, :n] -= act[:, None] * (law.rotor[:, None] * rotor + law.torque[:, None] * torque)
        return W

    def actuator(self, s: np.ndarray) -> np.ndarray:
        """Air-gap torque (f,) for a command: dead time and inverter lag."""
        return np.exp(-s * self.case.loop["dead_time"]) / (1 + s * self.case.loop["inverter_lag"])

    def measured(self, j: int, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lagged flange torque into the rotor and rotor angle (f, n), (n,) of a dynamometer, for unit coordinates."""
        dynamometer = self.case.loop.dynamometers[j]
        rotor = next(part.on for part in self.case.rig.inputs if part.name == dynamometer.torque_input)
        flange = next(part.of for part in self.case.rig.sensors if part.name == dynamometer.torque_sensor)
        shaft = next(part for part in self.case.rig.shafts if part.name == flange)
        speed_of = next(part.of for part in self.case.rig.sensors if part.name == dynamometer.speed_sensor)
        torque = self.rig.reading(dynamometer.torque_sensor, s) * torque_into(self.case.rig, shaft, rotor)
        lag = 1 / (1 + s * self.case.loop["torque_sensor_lag"])
        return lag[:, None] * torque, self.rig.unit(speed_of) @ self.rig.basis

    def interface(self, j: int) -> tuple[int, str]:
        """Which part of the residual vehicle a dynamometer stands for, and the inertia that it follows."""
        followed = self.case.loop.dynamometers[j].follows
        shaft = next(part for part in self.case.vehicle.shafts if part.name == followed)
        for at, part in enumerate(self.vehicle):
            for end in shaft.between:
                if end in part.nodes:
                    return at, end
        raise NotCovered(f"the cut at shafts.{followed}")

    def unstable_poles(self, offset: float = 1e-3, steps: int = 4000) -> int:
        """Closed-loop poles with a real part above ``offset``, 1/s, by the argument principle.

        The contour runs up the line Re s = offset and back on a half circle so wide that no pole lies beyond it. It is
        refined until det W turns by less than half a radian from point to point; slower drifts than exp(offset·t) are
        rigid motions.
        """
        radius = 2 * np.pi * 2e4
        up = np.concatenate([[0.0], np.geomspace(1e-4, radius, steps)])
        line = offset + 1j * up
        angle = np.pi / 2 - np.linspace(0, np.pi / 2, 400)[1:]
        path = np.concatenate([line, offset + radius * np.exp(1j * angle)])
        phase = np.linalg.slogdet(self.matrix(path))[0]
        for _ in range(30):
            turn = np.angle(phase[1:] / phase[:-1])
            wide = np.flatnonzero(np.abs(turn) > 0.5)
            if not len(wide):
                break
            middle = (path[wide] + path[wide + 1]) / 2
            phase = np.insert(phase, wide + 1, np.linalg.slogdet(self.matrix(middle))[0])
            path = np.insert(path, wide + 1, middle)
        turn = np.angle(phase[1:] / phase[:-1])
        # clockwise up the line and back: the upper half alone turns by −π for every pole of the whole
        count = -turn.sum() / np.pi
        if np.abs(turn).max() > 0.5 or abs(count - round(count)) > 0.05:
            raise NotCovered("a pole so near the imaginary axis that it cannot be counted")
        return round(count)

    def return_difference(self, s: np.ndarray) -> np.ndarray:
        """I + L at the commands (f, k, k)."""
        k = len(self.case.loop.dynamometers)
        plant = np.linalg.solve(
            self.rig.stiffness(s),
            np.broadcast_to(
                self.rig.drive([each.torque_input for each in self.case.loop.dynamometers]).astype(complex),
                (len(s), self.rig.basis.shape[1], k),
            ),
        )
        law, act = LAWS[self.case.loop.structure.name](self.case, s), self.actuator(s)
        torques = np.stack([(self.measured(j, s)[0][:, None] @ plant)[:, 0] for j in range(k)], axis=1)
        angles = np.stack([self.measured(j, s)[1] @ plant for j in range(k)], axis=1)
        followed = self._followed(s) @ torques
        command = (
            law.reference[:, None, None] * followed
            + law.rotor[:, None, None] * angles
            + law.torque[:, None, None] * torques
        )
        return np.eye(k) - act[:, None, None] * command

    def _followed(self, s: np.ndarray) -> np.ndarray:
        """Reference angles (f, k, k) of the residual vehicle for flange torques."""
        k = len(self.case.loop.dynamometers)
        followed = np.zeros((len(s), k, k), complex)
        for at, part in enumerate(self.vehicle):
            mine = [j for j in range(k) if self.interface(j)[0] == at]
            ends = np.array([part.unit(self.interface(j)[1]) @ part.basis for j in mine])
            torques = np.broadcast_to(ends.T.astype(complex), (len(s), *ends.T.shape))
            followed[np.ix_(range(len(s)), mine, mine)] = ends @ np.linalg.solve(part.stiffness(s), torques)
        return followed

    def response(self, s: np.ndarray, source: str, sensor: str) -> np.ndarray:
        """What a sensor of the rig reads (f,) for a torque that the controller does not measure."""
        W = self.matrix(s)
        load = np.zeros((len(s), W.shape[1], 1), complex)
        n = self.rig.basis.shape[1]
        if source in {part.name for part in self.case.rig.inputs}:
            load[:, :n] = self.rig.drive([source])
        else:
            starts = np.cumsum([n, *(part.basis.shape[1] for part in self.vehicle)])
            for part, first, last in zip(self.vehicle, starts[:-1], starts[1:], strict=True):
                if source in {driven.name for driven in part.system.inputs}:
                    load[:, first:last] = part.drive([source])
        motion = np.linalg.solve(W, load)[:, :n]
        return (self.rig.reading(sensor, s)[:, None] @ motion)[:, 0, 0]


def torque_into(system: System, shaft: Shaft, rotor: str) -> float:
    """Torque into the side of a shaft where ``rotor`` hangs, for 1 N·m that the shaft transmits."""
    joined = [set(other.between) for other in system.shafts if other.name != shaft.name]
    joined += [set(gear.between) for gear in system.gears]
    joined += [{differential.cage, differential.left, differential.right} for differential in system.differentials]
    side = {rotor}
    for _ in system.inertias:
        side |= {end for ends in joined if ends & side for end in ends}
    if shaft.between[1] in side:
        return 1.0
    return -1 / (1.0 if shaft.ratio is None else shaft.ratio.value)


def plain_response(chain: Chain, s: np.ndarray, source: str, sensor: str) -> np.ndarray:
    """What a sensor of a system reads (f,) for a torque at one of its inputs, nothing closed round it."""
    return plain_responses(chain, s, [source], [sensor])[:, 0, 0]


def plain_responses(chain: Chain, s: np.ndarray, sources: Sequence[str], sensors: Sequence[str]) -> np.ndarray:
    """What sensors of a system read (f, sensors, sources) for torques at some of its inputs."""
    drive = chain.drive(list(sources)).astype(complex)
    motion = np.linalg.solve(chain.stiffness(s), np.broadcast_to(drive, (len(s), *drive.shape)))
    return np.stack([chain.reading(sensor, s) for sensor in sensors], axis=1) @ motion


# --- One drawn bed under a sampled controller, assembled here once more: from dynamic stiffness, not from state spaces.
#
# What the rig does between samples follows from its masses, dampings and stiffnesses, read off the dynamic stiffness at
# three s; what it shows at a frequency from the dynamic stiffness itself. The controller is what is judged: its
# matrices
# are taken as they are, step by step as it runs.

POLYNOMIAL = 1e-9  # relative: so well must M·s² + D·s + K give the dynamic stiffness at a further s


@dataclass(frozen=True)
class DrawnBed:
    """A bed with values of its own; n coordinates, k dynamometers, y sensors of the controller.

    ``values`` are named as :class:`matching.match.case.Uncertain` has them.
    """

    case: Case
    rig: Chain
    values: Mapping[str, float]

    def _value(self, name: str) -> float:
        return self.values.get(f"loop.{name}", self.case.loop[name])

    @property
    def _delay(self) -> float:
        """From a sample to the moment its command acts, s: the dead time counts half a sample of hold."""
        return max(self._value("dead_time") - self.case.loop["sample_time"] / 2, 0.0)

    @cached_property
    def gains(self) -> np.ndarray:
        """Air-gap torque over command (k,)."""
        names = [dynamometer.name for dynamometer in self.case.loop.dynamometers]
        return np.array([self.values.get(f"dynamometers.{name}.torque_gain", 1.0) for name in names])

    @cached_property
    def sensor_gains(self) -> np.ndarray:
        """Reading over what is measured (y,)."""
        return np.array([self.values.get(f"sensors.{name}.gain", 1.0) for name in self.case.loop.controller_sensors])

    @cached_property
    def drive(self) -> np.ndarray:
        """Generalised torques (n, k) of unit air-gap torques."""
        return self.rig.drive([dynamometer.torque_input for dynamometer in self.case.loop.dynamometers])

    def sensors(self, s: np.ndarray) -> np.ndarray:
        """What the controller's sensors read (f, y, n) of unit coordinates, gains and the flanges' lag included."""
        names, k = self.case.loop.controller_sensors, len(self.gains)
        rows = np.stack([self.rig.reading(name, s) for name in names], axis=1) * self.sensor_gains[:, None]
        rows[:, :k] /= (1 + s * self._value("torque_sensor_lag"))[:, None, None]
        return rows

    def moved(self, s: np.ndarray, torques: np.ndarray) -> np.ndarray:
        """Coordinates (f, n, d) in rad for generalised torques (n, d) in N·m at s (f,)."""
        load = np.broadcast_to(torques.astype(complex), (len(s), *torques.shape))
        return np.linalg.solve(self.rig.stiffness(s), load)

    def command_at(self, s: np.ndarray) -> np.ndarray:
        """Air-gap torques (f, k) at a frequency for sampled commands: hold, dead time, lag and gain."""
        step = self.case.loop["sample_time"]
        hold = (1 - np.exp(-s * step)) / (s * step)
        late = hold * np.exp(-s * self._delay) / (1 + s * self._value("inverter_lag"))
        return late[:, None] * self.gains

    @cached_property
    def rates(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A (x, x), B (x, k), C (y, x) in continuous time; states [coordinates, rates, air gap, flanges, sensors]."""
        K, plus, minus, other = np.real(self.rig.stiffness(np.array([0.0, 1.0, -1.0, 2.0], complex)))
        M, D = (plus + minus) / 2 - K, (plus - minus) / 2
        if np.abs(4 * M + 2 * D + K - other).max() > POLYNOMIAL * np.abs(other).max():
            raise NotCovered("a rig whose dynamic stiffness is no polynomial")
        n, k = len(M), len(self.gains)
        names = self.case.loop.controller_sensors
        first = 2 * n + 2 * k
        size = first + sum(time > 0 for name in names for *_, time in self.rig.sections(name))
        A, B, C = np.zeros((size, size)), np.zeros((size, k)), np.zeros((len(self.sensor_gains), size))
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n, : 2 * n + 2 * k] = np.linalg.solve(
            M, np.hstack([-K, -D, self.drive * self.gains, np.zeros((n, k))])
        )
        lag, sensor_lag = self._value("inverter_lag"), self._value("torque_sensor_lag")
        A[2 * n : 2 * n + k, 2 * n : 2 * n + k], B[2 * n : 2 * n + k] = -np.eye(k) / lag, np.eye(k) / lag
        for i, name in enumerate(names):
            still, turning = (self.rig.measured(name, np.array([s]))[0] for s in (0.0j, 1.0 + 0j))
            row = np.zeros(size)
            row[: 2 * n] = np.real(np.concatenate([still, turning - still])) * self.sensor_gains[i]
            for direct, lagged, time in self.rig.sections(name):
                before, row = row, direct * row
                if time > 0:
                    A[first] = before / time
                    A[first, first] -= 1 / time
                    row[first] += lagged
                    first += 1
            if i < k:
                A[2 * n + k + i] += row / sensor_lag
                A[2 * n + k + i, 2 * n + k + i] -= 1 / sensor_lag
                C[i, 2 * n + k + i] = 1
            else:
                C[i] = row
        return A, B, C

    @cached_property
    def stepped(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A (x, x), B (x, k), C (y, x) from sample to sample; states end with commands on their way, oldest first."""
        A, B, C = self.rates
        x, k, step = len(A), B.shape[1], self.case.loop["sample_time"]
        late = self._delay / step
        waiting = int(np.ceil(late - 1e-9)) or 1  # commands that a sample may still wait for
        switch = waiting - late  # of the sample, from its beginning to where the next command arrives, counted back
        augmented = np.block([[A, B], [np.zeros((k, x + k))]])
        first, rest = expm(augmented * step * (1 - switch)), expm(augmented * step * switch)
        whole = np.zeros((x + k * waiting,) * 2)
        whole[:x, :x] = rest[:x, :x] @ first[:x, :x]
        whole[:x, x : x + k] += rest[:x, :x] @ first[:x, x:]
        new = rest[:x, x:]
        drive = np.zeros((x + k * waiting, k))
        if waiting > 1:
            whole[:x, x + k : x + 2 * k] += new
            whole[x:-k, x + k :] = np.eye(k * (waiting - 1))
        else:
            drive[:x] = new
        drive[-k:] = np.eye(k)
        return whole, drive, np.hstack([C, np.zeros((len(C), k * waiting))])

    def closed(self, law: ControlLaw) -> np.ndarray:
        """State matrix (x + c, x + c) of bed and law, one sample after the other as they run.

        States of the law that neither readings nor commands reach are left out: no bed changes them.
        """
        A, B, C = self.stepped
        reached = _reached(law.A, np.hstack([law.L, law.By, law.Bs]))
        x, o = len(A), int(reached.sum())
        state = np.eye(x + o)
        bed, predicted, read = state[:x], state[x:], C @ state[:x]
        corrected = predicted + law.L[reached] @ (read - law.E[:, reached] @ predicted)
        sent = law.K[:, reached] @ corrected + law.Dy @ read
        inside = law.A[np.ix_(reached, reached)]
        return np.vstack([A @ bed + B @ sent, inside @ corrected + law.By[reached] @ read + law.Bs[reached] @ sent])


def _reached(A: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Which states (x,) of x⁺ = A·x + inputs·u the inputs reach."""
    reached: np.ndarray = np.asarray(inputs.any(axis=1))
    for _ in range(len(A)):
        further = reached | (A[:, reached] != 0).any(axis=1)
        if (further == reached).all():
            break
        reached = further
    return reached


# --- The bed as planned with its cut shafts opened, as a lash lets it appear: stated once more, apart from the search.

# Of stiffness and damping that is left; a shaft in which a lash is crossed acts on the swing like a softer one
# (describing function: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968).
SHARES_LEFT = (0.001, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7)


def with_opened_shafts(case: Case, share: float, alone: str | None = None) -> dict[str, float]:
    """Values (SI) of the bed, by name, whose followed shafts have ``share`` of their stiffness and damping.

    ``alone`` names the one shaft that does; without it all do.
    """
    quantities = {
        f"shafts.{dynamometer.follows}.{quantity}"
        for dynamometer in case.loop.dynamometers
        if alone in (None, dynamometer.follows)
        for quantity in ("stiffness", "damping")
    }
    return {
        f"rig.{name}": share * parameter.value for name, parameter in case.rig.parameters.items() if name in quantities
    }


def dampings_opened(
    case: Case, damping: Callable[[Mapping[str, float]], float]
) -> tuple[dict[float, float], dict[str, dict[float, float]]]:
    """Least damping ratios by share, of all followed shafts opened together and, by its name, of each one alone."""
    together = {share: damping(with_opened_shafts(case, share)) for share in SHARES_LEFT}
    names = [dynamometer.follows for dynamometer in case.loop.dynamometers]
    if len(names) == 1:
        return together, {names[0]: together}
    return together, {
        name: {share: damping(with_opened_shafts(case, share, name)) for share in SHARES_LEFT} for name in names
    }


# --- The worst beds of a box: descent by the gradients of dampings, ascent of the error, from planned and drawn beds.
#
# The least damped mode may be one of the residual vehicle that no bed moves, and another one fall below it in a corner
# of the box. So the descent follows those modes that their gradients promise to be damped least in a corner.

STARTS = 1  # drawn beds with the least damping, beside the bed as planned
ROUNDS = 4  # of the descent at most, each with a gradient of its own
ERROR_ROUNDS = 2  # of the error's, which takes longer to work out
DIFFERENCE = 0.02  # of a half-width
SHARES = (1.0, 0.5, 0.25)  # of the way to the corner that the gradient points to
DEPENDS = 1e-6  # relative change over a half-width below which a figure does not depend on anything: rounding
FOLLOWED = 4  # figures whose corners are tried in a round
WORTH_A_ROUND = 0.02  # relative fall below which no other round follows
NAMED = 4  # quantities that a figure depends on most


@dataclass(frozen=True)
class WorstBed:
    """The bed of the box with the least damping that was met.

    Attributes
    ----------
    damping_ratio : float
        Negative where it is not stable.
    values : mapping
        SI, by name.
    named : tuple of str
        Quantities that its damping depends on most, most first.
    """

    damping_ratio: float
    values: Mapping[str, float]
    named: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "damping_ratio": self.damping_ratio, "stable": self.damping_ratio > 0, "values": dict(self.values),
            "depends_most_on": list(self.named),
        }  # fmt: skip


@dataclass(frozen=True)
class LargestError:
    """The bed of the box with the largest response error to unmeasured torques that was met; as :class:`WorstBed`."""

    unmeasured: float
    values: Mapping[str, float]
    named: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {"unmeasured": self.unmeasured, "values": dict(self.values), "depends_most_on": list(self.named)}


def worst_bed(
    dampings: Callable[[Mapping[str, float]], np.ndarray], box: Box, positions: np.ndarray
) -> WorstBed | None:  # fmt: skip
    """Look for the bed with the least damping; None where nothing is uncertain.

    Parameters
    ----------
    dampings : callable
        Damping ratios (m,) of the least damped modes of a bed, least first, by its values.
    positions : ndarray (b, p)
        Drawn beds in the box, least damped first.
    """
    if not box.uncertain or not len(positions):
        return None
    starts = [np.zeros(len(box.uncertain)), *positions[:STARTS]]
    descents = [_descended(lambda at: dampings(box.at(at)), position, ROUNDS) for position in starts]
    ratio, position, slopes = min(descents, key=lambda descent: descent[0])
    return WorstBed(ratio, box.at(position), _named(box, slopes))


def largest_error(
    error: Callable[[Mapping[str, float]], float], box: Box, position: np.ndarray
) -> LargestError | None:  # fmt: skip
    """Look for the bed with the largest error; None where nothing is uncertain.

    Parameters
    ----------
    error : callable
        Response error of a bed, by its values; infinite where it is not stable, which no ascent goes to.
    position : ndarray (p,)
        The drawn bed with the largest error.
    """
    if not box.uncertain:
        return None

    def to_lower(at: np.ndarray) -> np.ndarray:
        value = error(box.at(at))
        return np.array([-value if np.isfinite(value) else 0.0])

    lowered, end, slopes = _descended(to_lower, position, ERROR_ROUNDS)
    return LargestError(-lowered, box.at(end), _named(box, slopes))


def _named(box: Box, slopes: np.ndarray) -> tuple[str, ...]:
    return tuple(box.uncertain[i].name for i in np.argsort(-np.abs(slopes))[:NAMED])


def _descended(
    of: Callable[[np.ndarray], np.ndarray], position: np.ndarray, rounds: int
) -> tuple[float, np.ndarray, np.ndarray]:  # value, position (p,), slopes (p,)
    """The least value met on the way from a position, towards the corners that the gradients of figures point to.

    ``of`` gives figures (m,), least first; one that depends on nothing has no gradient but rounding.
    """
    figures, named = of(position), np.zeros(len(position))
    for _ in range(rounds):
        inward = np.where(position > 0, -DIFFERENCE, DIFFERENCE)
        slopes = np.array([of(position + step) - figures for step in np.diag(inward)]) / inward[:, None]
        depends = np.flatnonzero(np.abs(slopes).max(axis=0) > DEPENDS * np.abs(figures))
        if not len(depends):
            break
        in_corner = (figures - np.abs(slopes).sum(axis=0))[depends]
        pointing = slopes.T[depends[np.argsort(in_corner, kind="stable")[:FOLLOWED]]]
        tried = [(slope, position + share * (-np.sign(slope) - position)) for slope in pointing for share in SHARES]
        ends = [of(place) for _, place in tried]
        best = int(np.argmin([end[0] for end in ends]))
        named = tried[best][0]
        if ends[best][0] > figures[0] - WORTH_A_ROUND * abs(figures[0]):
            break
        figures, position = ends[best], tried[best][1]
    return float(figures[0]), position, named


# --- Fresh beds drawn from what is not known exactly, judged by the assembly of this room.

ERROR_POINTS = 150  # of the response error over the band, midpoints of equal parts of its logarithm
AT_REST = 1e-7  # of z: a rigid motion stands at 1; rounding moves it by less
SLOWEST_SWING_RAD_S = 1.0  # below, a pair of poles is a drift, not a mode
LEFT_TO_ITS_OWN = 0.95  # of the damping of a mode of the bed's own, where the loop has rolled off
MODES = 16  # of a bed, the least damped ones, that the search for the worst bed looks at
LOWEST_Z = 1e-3  # poles that decay faster from sample to sample have no frequency worth a number


@dataclass(frozen=True)
class BedVerdict:
    """One bed: stable or not, its least damping ratio, damped enough or not, errors to measured, unmeasured torques."""

    stable: bool
    damping_ratio: float
    damped: bool
    measured: float
    unmeasured: float


@dataclass(frozen=True)
class BedsCheck:
    """Of all drawn beds; ``not_covered`` says what of the case this method does not know, all else is empty then.

    Attributes
    ----------
    drawn, stable, damped : int
        ``damped`` beds have every mode damped by ``required_damping`` at least, or, of those where the loop has rolled
        off, by what the bed without control leaves it at least.
    smallest_damping_ratio, required_damping : float
    measured, unmeasured : tuple of float
        Response errors of every stable bed, smallest first, each against the vehicle with the same specimen.
    worst : WorstBed or None
        The least damped bed of the box that descents from the bed as planned and from the worst drawn one find.
    largest_error : LargestError or None
        The bed with the largest error to unmeasured torques that an ascent from the worst of the drawn ones finds.
    opened : mapping of float to float
        Least damping ratio of the bed as planned, by the share that is left of its cut shafts' stiffness and damping;
        −1 where it grows without swinging. In ``result.json``: ``opened_cut_shafts``, a list with ``share_left``,
        ``damping_ratio``, ``stable`` and ``smallest_damping_ratio_alone``, that with one cut shaft opened alone.
    opened_alone : mapping of str to mapping of float to float
        The same where one cut shaft opens and the others do not, by its name.
    """

    drawn: int
    stable: int
    damped: int
    smallest_damping_ratio: float
    required_damping: float
    measured: tuple[float, ...]
    unmeasured: tuple[float, ...]
    worst: WorstBed | None = None
    largest_error: LargestError | None = None
    not_covered: str = ""
    opened: Mapping[float, float] = field(default_factory=dict)
    opened_alone: Mapping[str, Mapping[float, float]] = field(default_factory=dict)

    @property
    def holds(self) -> bool:
        """Whether every bed is stable and damped."""
        return not self.not_covered and self.stable == self.damped == self.drawn

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "drawn": self.drawn, "stable": self.stable, "damped": self.damped,
            "smallest_damping_ratio": None if self.not_covered else self.smallest_damping_ratio,
            "required_damping_ratio": self.required_damping,
            "error_median": quantile(self.measured, 0.5), "error_95": quantile(self.measured, 0.95),
            "unmeasured_median": quantile(self.unmeasured, 0.5), "unmeasured_95": quantile(self.unmeasured, 0.95),
            "worst": None if self.worst is None else self.worst.to_dict(),
            "largest_error": None if self.largest_error is None else self.largest_error.to_dict(),
            "opened_cut_shafts": [
                {"share_left": share, "damping_ratio": ratio, "stable": ratio > 0,
                 "smallest_damping_ratio_alone": min(
                     (alone[share] for alone in self.opened_alone.values()), default=ratio
                 )}
                for share, ratio in self.opened.items()
            ],
            "not_covered": self.not_covered,
        }  # fmt: skip


def quantile(values: Sequence[float], share: float) -> float | None:
    """Quantile of values; None where there are none."""
    return float(np.quantile(values, share)) if values else None


class Judge:
    """A control law on any bed of a case.

    Parameters
    ----------
    frequencies : ndarray (f,), optional
        Hz; over the band unless given.
    required : (float, float)
        Least damping ratio of any mode, and from where the loop has to have rolled off, Hz.
    """

    def __init__(
        self, case: Case, law: ControlLaw, frequencies: np.ndarray | None = None,
        required: tuple[float, float] = (0.0, np.inf),
    ):  # fmt: skip
        self.case, self.law, self.required = case, law, required
        self.rig, self.vehicle = Chain(case.rig), Chain(case.vehicle)
        low, high = np.log(case.band)
        over_band = np.exp(low + (high - low) * (np.arange(ERROR_POINTS) + 0.5) / ERROR_POINTS)
        self.frequencies = over_band if frequencies is None else frequencies
        self._of_readings, self._of_known = self._action()
        self._rig_inputs = {part.name for part in case.rig.inputs}
        self._sources = list(dict.fromkeys(pair.input for pair in case.compared))
        self._sensors = list(dict.fromkeys(pair.sensor for pair in case.compared))
        resting = [self.rig.stiffness(np.zeros(1, complex))[0].real, *self._residual()]
        self._at_rest = sum(len(K) - np.linalg.matrix_rank(K) for K in resting)

    def _residual(self) -> list[np.ndarray]:
        return [Chain(part).stiffness(np.zeros(1, complex))[0].real for part in self.case.residual_vehicle.parts]

    def _action(self) -> tuple[np.ndarray, np.ndarray]:
        """Commands for readings (f, k, y) and known torques (f, k, w), from the law as it runs."""
        law, x, y = self.law, len(self.law.A), len(self.law.sensors)
        z = np.exp(2j * np.pi * self.frequencies * law.sample_time)
        keep, sending = np.eye(x) - law.L @ law.E, law.A + law.Bs @ law.K
        inputs = np.hstack([sending @ law.L + law.By + law.Bs @ law.Dy, law.Bw + law.Bs @ law.Dw])
        loop = z[:, None, None] * np.eye(x) - sending @ keep
        states = np.linalg.solve(loop, np.broadcast_to(inputs, (len(z), *inputs.shape)))
        commands = law.K @ keep @ states
        commands[:, :, :y] += law.K @ law.L + law.Dy
        commands[:, :, y:] += law.Dw
        return commands[:, :, :y], commands[:, :, y:]

    def verdict(self, values: Mapping[str, float]) -> BedVerdict:
        """One bed, by its values."""
        bed = self._bed(values)
        z = np.linalg.eigvals(bed.closed(self.law))
        stable, ratio = self._poles(z)
        drawn = {
            name.split(".", 1)[1]: value for name, value in values.items() if name.startswith(("rig.", "vehicle."))
        }
        known = self.case.vehicle.parameters
        vehicle = self.vehicle.with_values({name: value for name, value in drawn.items() if name in known})
        measured, unmeasured = self._errors(bed, vehicle)
        return BedVerdict(stable, ratio, self._damped(z, bed), measured, unmeasured)

    def _damped(self, z: np.ndarray, bed: DrawnBed) -> bool:
        """Whether every mode of a bed has the damping it needs.

        Where the loop has rolled off, a mode of the bed's own that has less without control cannot be given more.
        """
        least, fast_from = self.required
        alone = np.linalg.eigvals(bed.rates[0])
        alone = alone[(alone.imag > 0) & (np.abs(alone) >= 2 * np.pi * fast_from)]
        of_its_own = LEFT_TO_ITS_OWN * float(np.min(-alone.real / np.abs(alone), initial=1.0))
        s = self._swinging(z)
        need = np.where(np.abs(s) >= 2 * np.pi * fast_from, min(least, of_its_own), least)
        return bool(np.all(-s.real / np.abs(s) >= need))

    def damping(self, values: Mapping[str, float]) -> float:
        """Least damping ratio of any mode of one bed; −1 where it grows without swinging."""
        return float(self.dampings(values)[0])

    def dampings(self, values: Mapping[str, float]) -> np.ndarray:
        """Damping ratios (m,) of the least damped modes of one bed, least first, which is :meth:`damping`; 1 beyond."""
        z = np.linalg.eigvals(self._bed(values).closed(self.law))
        stable, ratio = self._poles(z)
        s = self._swinging(z)
        s = s[s.imag > 0]
        least = np.sort(np.append(-s.real / np.abs(s), np.ones(MODES)))[:MODES]
        least[0] = ratio if stable or ratio < 0 else -1.0
        return least

    def _bed(self, values: Mapping[str, float]) -> DrawnBed:
        of_rig = {name.removeprefix("rig."): value for name, value in values.items() if name.startswith("rig.")}
        return DrawnBed(self.case, self.rig.with_values(of_rig), values)

    def _poles(self, z: np.ndarray) -> tuple[bool, float]:
        resting = np.abs(z - 1) < AT_REST
        stable = bool(np.all(np.abs(z[~resting]) < 1)) and int(resting.sum()) <= self._at_rest
        s = self._swinging(z)
        return stable, float(np.min(-s.real / np.abs(s), initial=1.0))

    def _swinging(self, z: np.ndarray) -> np.ndarray:
        """Poles that swing, 1/s, of poles from sample to sample."""
        alive = z[(np.abs(z - 1) >= AT_REST) & (np.abs(z) > LOWEST_Z)]
        s: np.ndarray = np.log(alive.astype(complex)) / self.law.sample_time
        return s[np.abs(s.imag) > SLOWEST_SWING_RAD_S]

    def planned(self) -> tuple[np.ndarray, np.ndarray]:
        """I + L at the commands (f, k, k) of the bed as planned, and the law's commands for readings (f, k, y)."""
        return self._return_difference(self._bed({})), self._of_readings

    def _return_difference(self, bed: DrawnBed) -> np.ndarray:
        A, B, C = bed.stepped
        z = np.exp(2j * np.pi * self.frequencies * self.law.sample_time)
        loop = C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(z), *B.shape)))
        return np.eye(B.shape[1]) - self._of_readings @ loop

    def _errors(self, bed: DrawnBed, vehicle: Chain) -> tuple[float, float]:
        """Response errors over the compared functions, rig torques known as the case says, and unknown."""
        s = 2j * np.pi * self.frequencies
        k, on_rig = len(bed.gains), [source for source in self._sources if source in self._rig_inputs]
        moved = bed.moved(s, np.hstack([bed.drive, bed.rig.drive(on_rig)]))
        by_command, sensed = moved[:, :, :k] * bed.command_at(s)[:, None, :], bed.sensors(s) @ moved[:, :, k:]
        commanded = {known: self._commands(sensed, on_rig, known) for known in (True, False)}
        commands = np.linalg.solve(self._return_difference(bed), np.concatenate([*commanded.values()], axis=2))
        i = len(self._sources)
        wanted = plain_responses(vehicle, s, self._sources, self._sensors)
        rows = np.stack([bed.rig.reading(sensor, s) for sensor in self._sensors], axis=1)
        answered = rows @ by_command @ commands
        alone = rows @ moved[:, :, k:]
        squares: dict[bool, list[np.ndarray]] = {True: [], False: []}
        for pair in self.case.compared:
            row, column = self._sensors.index(pair.sensor), self._sources.index(pair.input)
            of_rig = alone[:, row, on_rig.index(pair.input)] if pair.input in on_rig else 0.0
            for known, first in ((True, 0), (False, i)):
                response = of_rig + answered[:, row, first + column]
                squares[known].append(np.abs(np.log(response / wanted[:, row, column])) ** 2)
        return float(np.sqrt(np.mean(squares[True]))), float(np.sqrt(np.mean(squares[False])))

    def _commands(self, sensed: np.ndarray, on_rig: list[str], known: bool) -> np.ndarray:
        """What the controller makes (f, k, i) of the sources, before its commands return; readings (f, y, rig)."""
        made = np.zeros((*self._of_known.shape[:2], len(self._sources)), complex)
        for column, source in enumerate(self._sources):
            if source in on_rig:
                made[:, :, column] += (self._of_readings @ sensed[:, :, [on_rig.index(source)]])[:, :, 0]
            if source not in on_rig or (known and source in self.law.known):
                made[:, :, column] += self._of_known[:, :, self.law.known.index(source)]
        return made


def check_beds(
    case: Case, law: ControlLaw, required_damping: float, count: int, seed: int, rolled_off_from: float = np.inf
) -> BedsCheck:  # fmt: skip
    """Draw fresh beds from the case's box and judge every one; then look for the worst of the box.

    ``rolled_off_from`` (Hz) says from where on no control can be asked to damp a mode of the bed's own.
    """
    try:
        judge = Judge(case, law, required=(required_damping, rolled_off_from))
        positions = case.uncertainty.draw(count, seed)
        verdicts = [judge.verdict(case.uncertainty.at(position)) for position in positions]
        # rounded: beds whose least damped mode is the same that none of them moves stay as they were drawn
        order = np.argsort(np.round([verdict.damping_ratio for verdict in verdicts], 9), kind="stable")
        worst = worst_bed(judge.dampings, case.uncertainty, positions[order])
        largest = _largest_error(judge, positions, verdicts)
        opened, alone = dampings_opened(case, judge.damping)
    except NotCovered as reason:
        return BedsCheck(0, 0, 0, float("nan"), required_damping, (), (), None, None, str(reason))
    stable = [verdict for verdict in verdicts if verdict.stable]
    return BedsCheck(
        count, len(stable), sum(verdict.damped for verdict in stable),
        min(verdict.damping_ratio for verdict in verdicts), required_damping,
        tuple(sorted(verdict.measured for verdict in stable)), tuple(sorted(verdict.unmeasured for verdict in stable)),
        worst, largest, opened=opened, opened_alone=alone,
    )  # fmt: skip


def _largest_error(judge: Judge, positions: np.ndarray, verdicts: Sequence[BedVerdict]) -> LargestError | None:
    """From the stable drawn bed with the largest error, over all frequencies: fewer of them lead elsewhere."""
    errors = [verdict.unmeasured if verdict.stable else -np.inf for verdict in verdicts]
    worst = int(np.argmax(errors))
    if not verdicts[worst].stable:
        return None

    def error(values: Mapping[str, float]) -> float:
        verdict = judge.verdict(values)
        return verdict.unmeasured if verdict.stable else np.inf

    return largest_error(error, judge.case.uncertainty, positions[worst])


# --- What the independent method says of a tuned case, beside what the search and the verification found.

MARGIN_TOLERANCE = 1e-3  # of the modulus margin: both sides look for its minimum on grids of their own
RESPONSE_TOLERANCE = 1e-6  # relative: the same linear equations, solved in two ways
LOWEST, HIGHEST = 1e-3, 5e3  # Hz, between which the margin is looked for


@dataclass(frozen=True)
class IndependentCheck:
    """The tuned case by dynamic stiffness.

    Attributes
    ----------
    not_covered : str
        What of the case this method does not know; all else is None then.
    unstable_poles : int or None
        Closed-loop poles in the right half plane.
    modulus_margin, margin_frequency : float or None
        Least singular value of I + L, and where, Hz.
    vehicle_difference, rig_difference : float or None
        Largest relative difference of the responses of vehicle and controlled rig (unmeasured torques) from those
        that the verification reports.
    """

    not_covered: str
    unstable_poles: int | None = None
    modulus_margin: float | None = None
    margin_frequency: float | None = None
    vehicle_difference: float | None = None
    rig_difference: float | None = None

    def disagreements(self, stable: bool, modulus_margin: float) -> list[str]:
        """Sentences on where it differs from a verdict on stability and a modulus margin."""
        if self.not_covered:
            return []
        assert self.modulus_margin is not None
        differences = []
        if (self.unstable_poles == 0) != stable:
            differences.append(f"{self.unstable_poles} closed-loop poles in the right half plane by dynamic stiffness")
        if stable and abs(self.modulus_margin - modulus_margin) > MARGIN_TOLERANCE:
            differences.append(
                f"a modulus margin of {self.modulus_margin:.4f} by dynamic stiffness, {modulus_margin:.4f} here"
            )
        for name, difference in (("vehicle", self.vehicle_difference), ("controlled rig", self.rig_difference)):
            if difference is not None and not difference <= RESPONSE_TOLERANCE:
                differences.append(f"responses of the {name} that differ by {difference:.2g} by dynamic stiffness")
        return differences

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return dict(vars(self))


def check(case: Case, frequencies: np.ndarray, vehicle: np.ndarray, controlled: np.ndarray) -> IndependentCheck:
    """Judge a tuned case.

    Parameters
    ----------
    frequencies : ndarray (f,)
        Hz.
    vehicle, controlled : ndarray (f, h)
        Responses of the vehicle and of the rig to unmeasured torques as the verification has them, for the compared
        functions of the case.
    """
    try:
        loop, reference = IndependentLoop(case), Chain(case.vehicle)
        s = 2j * np.pi * np.asarray(frequencies)
        pairs = [(pair.input, pair.sensor) for pair in case.compared]
        of_vehicle = np.stack([plain_response(reference, s, *pair) for pair in pairs], axis=1)
        of_rig = np.stack([loop.response(s, *pair) for pair in pairs], axis=1)
        unstable = loop.unstable_poles()
    except NotCovered as reason:
        return IndependentCheck(not_covered=str(reason))
    margin, where = _margin(loop)
    return IndependentCheck(
        "", unstable, margin, where, _difference(of_vehicle, vehicle), _difference(of_rig, controlled)
    )


def _difference(first: np.ndarray, second: np.ndarray) -> float:
    """Largest difference (f, h), relative to each function's largest magnitude."""
    return float((np.abs(first - second) / np.abs(first).max(axis=0)).max())


def _margin(loop: IndependentLoop) -> tuple[float, float]:
    """Least singular value of I + L over a fine grid, its lowest minima refined; and where, Hz."""

    def least(f: np.ndarray) -> np.ndarray:
        return np.linalg.svd(loop.return_difference(2j * np.pi * f), compute_uv=False)[:, -1]

    grid = np.geomspace(LOWEST, HIGHEST, 3000)
    sizes = least(grid)
    inner = np.flatnonzero((sizes[1:-1] <= sizes[:-2]) & (sizes[1:-1] <= sizes[2:])) + 1
    best = float(sizes.min()), float(grid[np.argmin(sizes)])
    for i in inner[np.argsort(sizes[inner])][:8]:
        minimum = scipy.optimize.minimize_scalar(
            lambda f: float(least(np.array([f]))[0]), bounds=(grid[i - 1], grid[i + 1]), method="bounded",
            options={"xatol": 1e-7 * grid[i]},
        )  # fmt: skip
        best = min(best, (float(minimum.fun), float(minimum.x)))
    return best


# --- Loop check

LOOP_POINTS = 240  # log-spaced frequencies from the band's lower edge to half the sampling frequency
HIGHEST_SHARE = 0.499  # of the sampling frequency


@dataclass(frozen=True)
class LoopCheck:
    """Least singular value of I + L from where it counts on and where (Hz), largest of T, noise of commands (k,), N·m.

    NaN where the case holds what this room does not know.
    """

    modulus_margin: float
    margin_at: float
    largest_rolled_off: float
    command_noise: tuple[float, ...]


def check_loop(
    case: Case, law: ControlLaw, uncertainty: np.ndarray, margin_from: float, rolled_off_from: float
) -> LoopCheck:
    """Judge a law on the bed as planned.

    Parameters
    ----------
    uncertainty : ndarray (y,)
        Standard deviations of the readings, SI.
    margin_from, rolled_off_from : float
        Hz, from where on the margin counts and T has to be small.
    """
    top = HIGHEST_SHARE / law.sample_time
    f = np.geomspace(min(case.band[0], top / 2), top, LOOP_POINTS)
    try:
        difference, of_readings = Judge(case, law, f).planned()
    except NotCovered:
        return LoopCheck(np.nan, np.nan, np.nan, (np.nan,) * len(law.dynamometers))
    sizes = np.linalg.svd(difference, compute_uv=False)[:, -1]
    sizes[f < min(margin_from, f[-1])] = np.inf
    at = int(np.argmin(sizes))
    T = np.linalg.solve(difference, np.eye(difference.shape[-1]) - difference)[f >= rolled_off_from]
    power = (np.abs(np.linalg.solve(difference, of_readings * uncertainty)) ** 2).sum(axis=2)
    # a sample's noise is spread evenly up to half the sampling frequency; below the band it counts as at its edge
    noise = np.sqrt((np.trapezoid(power, f, axis=0) + power[0] * f[0]) / f[-1])
    rolled_off = float(np.linalg.svd(T, compute_uv=False).max(initial=0.0)) if len(T) else 0.0
    return LoopCheck(float(sizes[at]), float(f[at]), rolled_off, tuple(noise.tolist()))
