"""Rigs of other kinds than the reference, every number drawn, on which commissioning is tried; and a linear bed.

Two axles with four dynamometers, an engine behind a rubber coupling, a chain without a differential, a gear between
the cut and the rotor, and a differential that turns its sides against each other.
"""

import tomllib
from pathlib import Path

import numpy as np
import tomli_w
from match_beds.drawn_cases import EXAMPLES, scale
from scipy.linalg import expm, null_space
from small_bed import CASE, RIG, VEHICLE

from virtual_bed.bed import VirtualBed

KINDS = ("two_axles", "engine", "chain", "geared_rotor", "differential")
LIMITS = {"dynamometer_torque": 1500.0, "dynamometer_speed": 125.0}
ENGINE = """
[inertias.flywheel]
J = 0.12
[shafts.rubber]
between = ["engine", "flywheel"]
stiffness = 900
damping = 1.5
"""  # between the engine and what was the motor's shaft


def write_rig(kind: str, rng: np.random.Generator, folder: Path) -> Path:
    """Vehicle, rig and case of a kind with drawn numbers in a folder; the case file."""
    vehicle, rig, case = _tables(kind)
    factors: dict = {}
    for model in (vehicle, rig):
        scale(model, rng, factors)
    case["limits"] = {key: value * rng.uniform(0.6, 1.4) for key, value in LIMITS.items()}
    case["loop"]["sample_time"] = float(rng.choice([0.0005, 0.001]))
    case.pop("move", None)
    rig["title"] = kind.replace("_", " ")
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in (("vehicle", vehicle), ("rig", rig), ("case", case)):
        (folder / f"{name}.toml").write_text(tomli_w.dumps(content), encoding="utf-8")
    return folder / "case.toml"


def _tables(kind: str) -> tuple[dict, dict, dict]:
    if kind in ("two_axles", "differential"):
        folder = EXAMPLES / {"two_axles": "four_wheel", "differential": "compact_bev"}[kind]
        return tuple(tomllib.loads((folder / f"{name}.toml").read_text()) for name in ("vehicle", "rig", "case"))  # type: ignore[return-value]
    vehicle, rig, case = (tomllib.loads(text) for text in (VEHICLE, RIG, CASE))
    if kind == "engine":
        for model in (vehicle, rig):
            model["inertias"] = {"engine": model["inertias"].pop("motor"), **model["inertias"]}
            model["inertias"]["engine"]["J"] = 0.25
            more = tomllib.loads(ENGINE)
            model["inertias"] |= more["inertias"]
            model["shafts"] |= more["shafts"]
            model["shafts"]["side"] |= {"between": ["flywheel", model["shafts"]["side"]["between"][1]], "ratio": 4.0}
            model["inputs"] = {"engine_torque": {"on": "engine"}, **model["inputs"]}
            del model["inputs"]["motor_torque"], model["sensors"]["motor_speed"]
            model["sensors"]["engine_speed"] = {"measures": "speed", "of": "engine"}
            model["sensors"]["flywheel_speed"] = {"measures": "speed", "of": "flywheel"}
        case["loop"] |= {"knows": ["engine_torque"], "measures": ["engine_speed"]}
        case["response"]["compare"] = [
            {"input": "engine_torque", "sensor": "engine_speed"}, {"input": "engine_torque", "sensor": "side_torque"},
        ]  # fmt: skip
        case["manoeuvre"] = {"engine_torque": {"kind": "tip_in", "amplitude": 60.0, "duration": 2}}
    if kind == "geared_rotor":  # a fast dynamometer: the rotor turns 3.5 times as fast as the hub
        rig["shafts"]["flange"] |= {"ratio": 1 / 3.5, "stiffness": 2e4, "damping": 2.0}
        rig["inertias"]["rotor"] |= {"J": 0.12, "drag": 0.01}
    return vehicle, rig, case


class LinearBed:
    """A bed with rigid gears and differentials, by the matrices of this file and exact steps; stepped as an FMU is.

    Values, actuators (dead times in whole samples) and readers are those of ``bed``; no play and no friction.
    """

    def __init__(self, bed: VirtualBed, rig: dict, step: float, rng: np.random.Generator):
        drive, values = bed.drive, bed.drive.values
        self.readers, self.wired, self.sensors = bed.readers, bed.wired, tuple(drive.sensors)
        driven = list(bed.actuators)
        self.inputs = (*driven, *(name for name in drive.inputs if name not in driven))

        def row(*pairs):
            coefficients = np.zeros(len(drive.inertias))
            for name, coefficient in pairs:
                coefficients[drive.inertias.index(name)] += coefficient
            return coefficients

        def of_shafts(key):
            return np.array([values[f"shafts.{name}.{key}"] for name in drive.shafts])

        rigid = [row((g["between"][0], 1.0), (g["between"][1], -g["ratio"])) for g in rig.get("gears", {}).values()]
        rigid += [
            row((d["cage"], 2.0), (d["left"], -1.0), (d["right"], -1.0)) for d in rig.get("differentials", {}).values()
        ]
        free = null_space(np.array(rigid)) if rigid else np.eye(len(drive.inertias))
        ratios = [values.get(f"shafts.{name}.ratio", 1.0) for name in drive.shafts]
        twist = np.array([
            row((first, 1 / ratio), (second, -1.0))
            for (first, second), ratio in zip(drive.shafts.values(), ratios, strict=True)
        ]) @ free  # fmt: skip
        J, drag = ([values[f"inertias.{name}.{key}"] for name in drive.inertias] for key in ("J", "drag"))
        k, c, m, n = of_shafts("stiffness"), of_shafts("damping"), free.shape[1], len(driven)
        mass = np.linalg.inv(free.T @ np.diag(J) @ free)
        push = np.array([row((drive.inputs[name], 1.0)) @ free for name in self.inputs]).T
        lag, factor = (np.array([getattr(one, key) for one in bed.actuators.values()]) for key in ("lag", "factor"))
        A, B = np.zeros((2 * m + n, 2 * m + n)), np.zeros((2 * m + n, len(self.inputs)))
        A[:m, m : 2 * m] = np.eye(m)
        A[m : 2 * m, :m] = -mass @ twist.T @ (k[:, None] * twist)
        A[m : 2 * m, m : 2 * m] = -mass @ (twist.T @ (c[:, None] * twist) + free.T @ np.diag(drag) @ free)
        A[m : 2 * m, 2 * m :], B[m : 2 * m, n:] = mass @ push[:, :n], mass @ push[:, n:]
        A[2 * m :, 2 * m :], B[2 * m :, :n] = -np.diag(1 / lag), np.diag(factor / lag)
        C = np.zeros((len(self.sensors), 2 * m + n))
        for i, (measures, of) in enumerate(drive.sensors.values()):
            if measures == "torque":
                at = list(drive.shafts).index(of)
                C[i, : 2 * m] = np.concatenate([k[at] * twist[at], c[at] * twist[at]])
            else:
                C[i, m : 2 * m] = row((of, 1.0)) @ free
        whole = expm(step * np.block([[A, B], [np.zeros((B.shape[1], sum(B.shape)))]]))
        self._A, self._B, self._C, self._rng = whole[: len(A), : len(A)], whole[: len(A), len(A) :], C, rng
        self._late = [round(one.delay / step) for one in bed.actuators.values()]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def begin(self, speed: float) -> None:
        """At rest."""
        self._x = np.zeros(len(self._A))
        self._sent = [[0.0] * late for late in self._late]

    def readings(self) -> np.ndarray:
        """By channel."""
        true, noise = self._C @ self._x, self._rng.standard_normal(len(self.sensors))
        own = [self.readers[name] for name in self.sensors]
        read = np.array([r.gain * true[i] + r.offset + r.noise * noise[i] for i, r in enumerate(own)])
        return read[[self.sensors.index(self.wired.get(name, name)) for name in self.sensors]]

    def step(self, commands: np.ndarray, span: float) -> None:
        """Torques held over a sample; the dynamometers' act late."""
        arrived = commands.copy()
        for j, waiting in enumerate(self._sent):
            waiting.append(commands[j])
            arrived[j] = waiting.pop(0)
        self._x = self._A @ self._x + self._B @ arrived
