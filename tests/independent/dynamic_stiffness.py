"""A sampled control law on any variant of a bed, by dynamic stiffness: nothing of the product's loop is used."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import expm, null_space

from matching.match.case import Case
from modelling.bed.bed import ControlLaw
from modelling.system import Effect, System

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
        """Rows (c, nodes) that are 0 for angles that rigid gears, differentials and planetary gears allow."""
        rows = []
        for gear in self.system.gears:
            first, second = (self.unit(end) for end in gear.between)
            rows.append(first - self._value[f"gears.{gear.name}.ratio"] * second)
        for part in self.system.differentials:
            rows.append(self.unit(part.cage) - (self.unit(part.left) + self.unit(part.right)) / 2)
        for part in self.system.planetary_gears:
            teeth = self._value[f"planetary_gears.{part.name}.ratio"]
            members = zip((part.sun, part.ring, part.carrier), (1.0, teeth, -1.0 - teeth), strict=True)
            rows.append(sum(factor * self.unit(name) for name, factor in members))
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


# --- Responses of a system with nothing closed round it.


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
# matrices are taken as they are, step by step as it runs.

POLYNOMIAL = 1e-9  # relative: so well must M·s² + D·s + K give the dynamic stiffness at a further s


@dataclass(frozen=True)
class DrawnBed:
    """A bed with values of its own; n coordinates, k dynamometers, y sensors of the controller.

    ``values`` are named as :class:`matching.match.box.Uncertain` has them.
    """

    case: Case
    rig: Chain
    values: Mapping[str, float]

    def _value(self, name: str) -> float:
        return self.values.get(f"loop.{name}", self.case.loop[name])

    @property
    def _delays(self) -> np.ndarray:
        """From a sample to the moment its command acts (k,), s: the dead time counts half a sample of hold.

        A drawn dead time adds the same to those that dynamometers have of their own.
        """
        more, common = self._value("dead_time") - self.case.loop["dead_time"], self.case.loop["dead_time"]
        own = [common if one.dead_time is None else one.dead_time for one in self.case.loop.dynamometers]
        return np.maximum(np.array(own) + more - self.case.loop["sample_time"] / 2, 0.0)

    def _lags(self, name: str) -> np.ndarray:
        """Of every dynamometer (k,), s; a drawn one scales those that dynamometers have of their own."""
        own = [getattr(one, name) for one in self.case.loop.dynamometers]
        factor = self._value(name) / self.case.loop[name]
        return np.array([factor * (self.case.loop[name] if lag is None else lag) for lag in own])

    @property
    def _flange_lags(self) -> dict[str, float]:
        """s, by the torque sensor of every flange that there is."""
        lags = zip(self.case.loop.dynamometers, self._lags("torque_sensor_lag").tolist(), strict=True)
        return {one.torque_sensor: lag for one, lag in lags if one.torque_sensor is not None}

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
        names, flanges = self.case.loop.controller_sensors, self._flange_lags
        rows = np.stack([self.rig.reading(name, s) for name in names], axis=1) * self.sensor_gains[:, None]
        lags = np.array([flanges.get(name, 0.0) for name in names])
        rows /= (1 + s[:, None] * lags)[:, :, None]
        return rows

    def moved(self, s: np.ndarray, torques: np.ndarray) -> np.ndarray:
        """Coordinates (f, n, d) in rad for generalised torques (n, d) in N·m at s (f,)."""
        load = np.broadcast_to(torques.astype(complex), (len(s), *torques.shape))
        return np.linalg.solve(self.rig.stiffness(s), load)

    def command_at(self, s: np.ndarray) -> np.ndarray:
        """Air-gap torques (f, k) at a frequency for sampled commands: hold, dead time, lag and gain."""
        step = self.case.loop["sample_time"]
        hold = (1 - np.exp(-s * step)) / (s * step)
        late = np.exp(-s[:, None] * self._delays) / (1 + s[:, None] * self._lags("inverter_lag"))
        return hold[:, None] * late * self.gains

    @cached_property
    def rates(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A (x, x), B (x, k), C (y, x) in continuous time; states [coordinates, rates, air gap, flanges, sensors]."""
        K, plus, minus, other = np.real(self.rig.stiffness(np.array([0.0, 1.0, -1.0, 2.0], complex)))
        M, D = (plus + minus) / 2 - K, (plus - minus) / 2
        if np.abs(4 * M + 2 * D + K - other).max() > POLYNOMIAL * np.abs(other).max():
            raise NotCovered("a rig whose dynamic stiffness is no polynomial")
        n, k = len(M), len(self.gains)
        names = self.case.loop.controller_sensors
        flanges = self._flange_lags
        first = 2 * n + k + len(flanges)
        size = first + sum(time > 0 for name in names for *_, time in self.rig.sections(name))
        A, B, C = np.zeros((size, size)), np.zeros((size, k)), np.zeros((len(self.sensor_gains), size))
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n, : 2 * n + k] = np.linalg.solve(M, np.hstack([-K, -D, self.drive * self.gains]))
        lag = self._lags("inverter_lag")
        A[2 * n : 2 * n + k, 2 * n : 2 * n + k], B[2 * n : 2 * n + k] = -np.diag(1 / lag), np.diag(1 / lag)
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
            if name in flanges:  # they come first
                A[2 * n + k + i] += row / flanges[name]
                A[2 * n + k + i, 2 * n + k + i] -= 1 / flanges[name]
                C[i, 2 * n + k + i] = 1
            else:
                C[i] = row
        return A, B, C

    @cached_property
    def stepped(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A (x, x), B (x, k), C (y, x) from sample to sample; states end with commands on their way, oldest first."""
        A, B, C = self.rates
        x, k, step = len(A), B.shape[1], self.case.loop["sample_time"]
        late = self._delays / step
        waiting = np.maximum(np.ceil(late - 1e-9).astype(int), 1)  # commands that a sample may still wait for
        size = x + int(waiting.sum())
        whole, drive, begin = np.zeros((size, size)), np.zeros((size, k)), x
        whole[:x, :x] = expm(A * step)
        for j, (count, delay) in enumerate(zip(waiting.tolist(), late.tolist(), strict=True)):
            switch = count - delay  # of the sample, from where the next command arrives to its end
            augmented = np.block([[A, B[:, [j]]], [np.zeros((1, x + 1))]])
            first, rest = expm(augmented * step * (1 - switch)), expm(augmented * step * switch)
            whole[:x, begin] = rest[:x, :x] @ first[:x, x]
            if count > 1:
                whole[:x, begin + 1] = rest[:x, x]
                whole[begin : begin + count - 1, begin + 1 : begin + count] = np.eye(count - 1)
            else:
                drive[:x, j] = rest[:x, x]
            drive[begin + count - 1, j] = 1.0
            begin += count
        return whole, drive, np.hstack([C, np.zeros((len(C), size - x))])

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


# --- Variants of the bed, judged.

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

    def against(self, values: Mapping[str, float], vehicle: Chain) -> tuple[float, float]:
        """Response errors, rig torques known and unknown, of one bed against a vehicle with values of its own."""
        return self._errors(self._bed(values), vehicle)

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
                if known or pair.input in on_rig or not on_rig:  # what acts in the residual vehicle is always known
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


def in_balance(matrices: np.ndarray, case: Case, law: ControlLaw, uncertainty: np.ndarray) -> np.ndarray:
    """Matrices (…, k, k) from commands to commands, in units of what noise of its encoder asks of each machine.

    The product documents it so: rotor's inertia times noise of its speed sensor, counted where they differ by 1 %.
    """
    on, inertia = (
        {part.name: part.on for part in case.rig.inputs},
        {part.name: part.J.value for part in case.rig.inertias},
    )
    asks = np.array([
        inertia[on[one.torque_input]] * uncertainty[list(law.sensors).index(one.speed_sensor)]
        for one in case.loop.dynamometers
    ])  # fmt: skip
    if max(asks) - min(asks) <= 0.01 * max(asks):
        return matrices
    return np.linalg.solve(np.diag(asks), matrices @ np.diag(asks))


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
    sizes = np.linalg.svd(in_balance(difference, case, law, uncertainty), compute_uv=False)[:, -1]
    sizes[f < min(margin_from, f[-1])] = np.inf
    at = int(np.argmin(sizes))
    T = np.linalg.solve(difference, np.eye(difference.shape[-1]) - difference)[f >= rolled_off_from]
    power = (np.abs(np.linalg.solve(difference, of_readings * uncertainty)) ** 2).sum(axis=2)
    # a sample's noise is spread evenly up to half the sampling frequency; below the band it counts as at its edge
    noise = np.sqrt((np.trapezoid(power, f, axis=0) + power[0] * f[0]) / f[-1])
    alike = in_balance(T, case, law, uncertainty) if len(T) else T
    rolled_off = float(np.linalg.svd(alike, compute_uv=False).max(initial=0.0)) if len(T) else 0.0
    return LoopCheck(float(sizes[at]), float(f[at]), rolled_off, tuple(noise.tolist()))
