"""Small rigs drawn for planned excitations, and how each moves by the equations of this file alone."""

import tomllib
from dataclasses import dataclass

import numpy as np
import tomli_w
from scipy.linalg import expm, null_space
from small_bed import CASE, RIG, VEHICLE

from tests.match_beds.drawn_cases import models, scale

BUILDS = ("four_wheel", "differential", "chain", "motors", "compact_bev")
FINE = 5  # steps a sample
LOCKED = """
[inertias.cage]
J = 0.3
[inertias.stub_left]
J = 0.03
[inertias.stub_right]
J = 0.03
[shafts.belt_left]
between = ["stub_left", "rotor"]
stiffness = 6e4
damping = 8
[shafts.belt_right]
between = ["stub_right", "rotor"]
stiffness = 5e4
damping = 8
[differentials.axle]
cage = "cage"
left = "stub_left"
right = "stub_right"
"""  # both ends of an axle drive one rotor


def tables(build):
    """Vehicle, rig and case; one dynamometer on both ends of a differential is of this file."""
    if build != "differential":
        return models(build)
    rig, case, locked = tomllib.loads(RIG), tomllib.loads(CASE), tomllib.loads(LOCKED)
    for table, parts in locked.items():
        rig[table] = rig.get(table, {}) | parts
    del rig["inertias"]["adapter"], rig["shafts"]["flange"]
    rig["shafts"]["side"]["between"] = ["motor", "cage"]
    rig["sensors"]["flange_torque"]["of"] = "belt_left"
    vehicle = tomllib.loads(VEHICLE)
    return vehicle, rig, case


def draw(number, folder):
    """Write drawn case ``number``; its file."""
    random = np.random.default_rng([47, number])
    vehicle, rig, case = tables(BUILDS[number % len(BUILDS)])
    factors = {}
    for model in (vehicle, rig):
        scale(model, random, factors)
    shaft, other = random.choice(list(rig["shafts"]), 2)
    case["limits"] = {
        "dynamometer_torque": random.uniform(100, 1000), "dynamometer_speed": random.uniform(60, 200),
        f"shafts.{shaft}.twist": random.uniform(0.01, 0.1), f"shafts.{other}.torque": random.uniform(200, 1000),
    }  # fmt: skip
    if random.random() < 0.5:
        case["limits"]["dynamometer_power"] = random.uniform(5e3, 4e4)
    case["loop"] = {"structure": "pi", "dead_time": random.uniform(1e-3, 6e-3), "inverter_lag": 0.002}
    case.pop("move", None)
    case["uncertainty"] = {
        "rig.inertias.*.J": 0.05, "rig.shafts.*.stiffness": 0.08, "loop.dead_time": 2e-4, "loop.torque_gain": 0.05,
    }  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in (("vehicle", vehicle), ("rig", rig), ("case", case)):
        (folder / f"{name}.toml").write_text(tomli_w.dumps(content), encoding="utf-8")
    return folder / "case.toml"


@dataclass
class Rig:
    """A rig's tables with values of what is uncertain: matrices over the angles that gears and differentials leave."""

    data: dict
    case: dict
    values: dict

    def __post_init__(self):
        get, self.names, shafts = self.value, list(self.data["inertias"]), self.data["shafts"]
        constraints = [
            [(g["between"][0], 1.0), (g["between"][1], -g["ratio"])] for g in self.data.get("gears", {}).values()
        ]
        constraints += [
            [(part["cage"], 2.0), (part["left"], -1.0), (part["right"], -1.0)]
            for part in self.data.get("differentials", {}).values()
        ]
        free = (
            null_space(np.array([self.row(pairs) for pairs in constraints])) if constraints else np.eye(len(self.names))
        )
        twist = np.array([
            self.row([(part["between"][0], 1 / get(f"shafts.{name}.ratio", 1.0)), (part["between"][1], -1.0)])
            for name, part in shafts.items()
        ]) @ free  # fmt: skip
        k, c = (np.array([get(f"shafts.{name}.{key}", 0.0) for name in shafts]) for key in ("stiffness", "damping"))
        J, d = (np.array([get(f"inertias.{name}.{key}", 0.0) for name in self.names]) for key in ("J", "drag"))
        self.dynos = list(self.case["dynamometers"].values())
        self.driven = [part["torque_input"] for part in self.dynos]
        self.others = [name for name in self.data["inputs"] if name not in self.driven]
        on = {name: self.row([(part["on"], 1.0)]) @ free for name, part in self.data["inputs"].items()}
        gain = [get(f"dynamometers.{name}.torque_gain", 1.0) for name in self.case["dynamometers"]]
        lag, m, n = get("loop.inverter_lag", 0.002), free.shape[1], len(self.dynos)
        mass = np.linalg.inv(free.T @ np.diag(J) @ free)
        push = np.array([on[name] for name in self.driven]).T
        A = np.zeros((2 * m + n, 2 * m + n))  # angles, speeds, air gaps
        A[:m, m : 2 * m] = np.eye(m)
        A[m : 2 * m, :m] = -mass @ twist.T @ np.diag(k) @ twist
        A[m : 2 * m, m : 2 * m] = -mass @ (twist.T @ np.diag(c) @ twist + free.T @ np.diag(d) @ free)
        A[m : 2 * m, 2 * m :] = mass @ push * gain
        A[2 * m :, 2 * m :] = -np.eye(n) / lag
        B = np.zeros((2 * m + n, n + len(self.others)))
        B[2 * m :, :n] = np.eye(n) / lag
        for j, name in enumerate(self.others):
            B[m : 2 * m, n + j] = mass @ on[name]
        self.A, self.B, self.m = A, B, m
        zero, rest = np.zeros_like(twist), np.zeros((len(shafts), n))
        self.twists = np.hstack([twist, zero, rest])
        self.torques = np.hstack([k[:, None] * twist, c[:, None] * twist, rest])
        self.speeds = np.hstack([np.zeros_like(push.T), push.T, np.zeros((n, n))])
        self.rates = np.hstack([zero, twist, rest])

    def value(self, name, other=None):
        """A quantity as drawn, else as the file has it."""
        if f"rig.{name}" in self.values or name in self.values:
            return self.values.get(f"rig.{name}", self.values.get(name))
        table, part, key = (*name.split("."), "")[:3]
        return self.data.get(table, {}).get(part, {}).get(key, other) if key else self.case["loop"].get(part, other)

    def row(self, pairs):
        """Coefficients (n,) of the inertias."""
        row = np.zeros(len(self.names))
        for name, coefficient in pairs:
            row[self.names.index(name)] += coefficient
        return row

    def steady(self, speed):
        """State and commands with every rotor at a speed, nothing accelerated and no twist changing."""
        x, k = len(self.A), len(self.dynos)
        wanted = np.vstack([
            np.hstack([self.A[self.m :], self.B[self.m :, :k]]),
            np.hstack([self.rates, np.zeros((len(self.rates), k))]),
            np.hstack([self.speeds, np.zeros((k, k))]),
        ])  # fmt: skip
        right = np.concatenate([np.zeros(len(wanted) - k), np.full(k, speed)])
        solution, _, _, _ = np.linalg.lstsq(wanted, right, rcond=None)
        assert np.allclose(wanted @ solution, right, atol=1e-6 * speed)
        return solution[:x], solution[x:]

    def peaks(self, plan, step):
        """Largest use of each limit under a plan, from its torques and the gains of its speed hold."""
        k, h = len(self.dynos), step / FINE
        x, start = self.steady(plan.speed)
        P, integral_gain = (np.array([plan.hold[name][i] for name in self.case["dynamometers"]]) for i in (0, 1))
        whole = expm(np.block([[self.A, self.B], [np.zeros((self.B.shape[1], len(self.A) + self.B.shape[1]))]]) * h)
        n = len(self.A)
        late = round((self.value("loop.dead_time") - step / 2) / h)
        queue, total = [start] * late, start.copy()
        order = [plan.inputs.index(name) for name in (*self.driven, *self.others) if name in plan.inputs]
        assert len(order) == len(plan.inputs)
        demand = plan.torques[:, order]
        applied = np.vstack([(demand[:-1] + demand[1:]) / 2, demand[-1:]])
        states, commands = np.zeros((len(demand) * FINE, n)), np.zeros((len(demand), k))
        for i, now in enumerate(applied):
            error = plan.speed - self.speeds @ x
            commands[i] = now[:k] + total + P * error
            total = total + integral_gain * step * error
            for j in range(FINE):
                queue.append(commands[i])
                states[i * FINE + j] = x
                x = whole[:n, :n] @ x + whole[:n, n:] @ np.concatenate([queue.pop(0), now[k:]])
        return self.shares(plan, states, commands, demand[:, k:])

    def shares(self, plan, states, commands, others):
        """Of every limit, over all fine steps."""
        limits, speeds = self.case["limits"], states @ self.speeds.T
        largest = {
            "dynamometer_torque": np.abs(commands).max(), "dynamometer_speed": np.abs(speeds).max(),
            "dynamometer_power": np.abs(commands * speeds[::FINE]).max(),
        }  # fmt: skip
        for j, name in enumerate(self.data["shafts"]):
            largest[f"shafts.{name}.twist"] = np.abs(states @ self.twists[j]).max()
            largest[f"shafts.{name}.torque"] = np.abs(states @ self.torques[j]).max()
        shares = {name: float(largest[name] / limit) for name, limit in limits.items()}
        shares["slowest rotor"] = float((1 - speeds.min() / plan.speed) / (1 - 0.2))
        for j, name in enumerate(self.others):
            amplitude = self.case["manoeuvre"].get(name, {}).get("amplitude", 0.0)
            assert np.abs(others[:, j]).max() <= amplitude * (1 + 1e-9)
        return shares
