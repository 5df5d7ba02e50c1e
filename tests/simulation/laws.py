"""The documented law of every kind of effect, executable: two inertias, a shaft, one effect, many draws side by side.

Nothing of rigmatch is used. Smooth laws by Runge and Kutta's classical method; dry friction hard, as an impulse that
at most stops what slides, before and after each step (Strang); delays by interpolation; filters exactly where their
input is straight. Arrays are (b,), one entry a draw.
"""

from dataclasses import dataclass

import numpy as np

SPREAD = 1.6  # times and over what a quantity is drawn
SHAPE = 1.65  # of a tyre's curve unless stated
BASE = {"J_a": 0.1, "J_b": 1.0, "drag_a": 0.03, "drag_b": 0.5, "k": 300.0, "c": 0.6}
PLACE = {
    "shaft": "shafts.s", "a": "inertias.a", "b": "inertias.b", "u": "inputs.u", "v": "inputs.v",
    "w_a": "sensors.w_a", "w_b": "sensors.w_b", "m": "sensors.m", "phi": "sensors.phi", "J": "inertias.b.J",
    "k": "shafts.s.stiffness", "drag": "inertias.b.drag",
}  # fmt: skip
# Place and typical parameters of every kind; each is drawn about them.
KINDS = {
    "all_pass": ("w_b", {"delay": 0.004}), "angle_zero": ("phi", {"zero": 0.7}), "backlash": ("shaft", {"gap": 0.03}),
    "brake": ("v", {"deflection": 0.05}), "clock_offset": ("w_b", {"offset": 0.0043}),
    "compliance": ("shaft", {"stiffness": 900.0, "J": 0.02}), "constant_torque": ("b", {"torque": 1.1}),
    "coulomb_friction": ("b", {"torque": 2.2, "torque_reverse": 1.4}), "dead_time": ("u", {"delay": 0.0047}),
    "directional_stiffness": ("shaft", {"factor": 0.6}),
    "double_relaxation": (
        "shaft", {"stiffness": 150.0, "time_constant": 0.01, "stiffness_2": 100.0, "time_constant_2": 0.15},
    ),
    "falling_torque_constant": ("u", {"torque": 15.0}), "gain_drift": ("u", {"change": 0.3, "time_constant": 0.5}),
    "gear_loss": ("shaft", {"efficiency": 0.9, "efficiency_reverse": 0.8}),
    "geared_ripple": (("a", "b"), {"order": 3.0, "amplitude": 0.8, "phase": 0.3}),
    "hardening": ("shaft", {"cubic": 4e4}), "hum": ("w_b", {"amplitude": 0.1, "frequency": 50.0, "phase": 1.1}),
    "hysteresis": ("shaft", {"torque": 2.0, "angle": 0.01}), "imposed_motion": ("b", {}),
    "input_gain": ("u", {"factor": 1.1}), "input_offset": ("u", {"offset": 1.4}),
    "lag": ("u", {"time_constant": 0.006}),
    "load_friction": ("a", {"coefficient": 0.1}), "parameter_drift": ("k", {"change": -0.3, "time_constant": 0.5}),
    "position_torque": ("a", {"period": 1.5, "amplitude": 0.8, "phase": 0.3, "amplitude_2": 0.3}),
    "quadratic_damping": ("shaft", {"coefficient": 0.4}), "quadratic_drag": ("b", {"coefficient": 0.05}),
    "rate_limit": ("u", {"rate": 150.0}), "recording_friction": ("b", {"torque_1": 0.8, "torque_2": 1.6}),
    "relaxation": ("shaft", {"stiffness": 150.0, "time_constant": 0.02}), "saturation": ("u", {"limit": 7.0}),
    "sensor_delay": ("w_b", {"delay": 0.0043}), "sensor_drift": ("m", {"rate": 0.5}),
    "sensor_gain": ("m", {"factor": 1.1}), "sensor_offset": ("w_a", {"offset": 0.4}),
    "sensor_ripple": ("phi", {"order": 3.0, "amplitude": 0.02, "phase": 0.3}),
    "slip": ("shaft", {"coefficient": 15.0}),
    "stribeck_friction": ("b", {"torque": 1.2, "breakaway": 2.0, "speed": 0.8}),
    "table": (
        "b", {"speed_1": -3.0, "torque_1": 2.0, "speed_2": 1.0, "torque_2": 0.5, "speed_3": 4.0, "torque_3": -2.0},
    ),
    "torque_map": (
        "u", {
            "speed_1": 0.0, "speed_2": 4.0, "speed_3": 9.0, "pedal_1": 0.05, "pedal_2": 0.4, "pedal_3": 0.9,
            "torque_1_1": 1.0, "torque_1_2": 5.0, "torque_1_3": 7.0, "torque_2_1": -2.0, "torque_2_2": 3.0,
            "torque_2_3": 9.0, "torque_3_1": -4.0, "torque_3_2": 1.0, "torque_3_3": 6.0,
        },
    ),
    "torque_ripple": ("a", {"order": 3.0, "amplitude": 0.8, "phase": 0.3}),
    "tyre_slip": ("shaft", {"slip_stiffness": 300.0, "peak": 8.0}),
    "warming_friction": ("b", {"torque": 2.0, "change": -0.6, "time_constant": 0.8}),
    "wrong_parameter": ("J", {"value": 1.4}),
}  # fmt: skip
# Kinds at another place as well: their law is another there.
ELSEWHERE = {
    "lag at a sensor": ("lag", "w_b"),
    "gain_drift at a sensor": ("gain_drift", "m"),
    "table of a shaft": ("table", "shaft"),
    "sensor_ripple of a speed": ("sensor_ripple", "w_b"),
    "parameter_drift of a drag": ("parameter_drift", "drag"),
}
TWIST_TABLE = {
    "twist_1": -0.05, "torque_1": -1.0, "twist_2": 0.0, "torque_2": 0.0, "twist_3": 0.04, "torque_3": 4.0,
}  # fmt: skip
FRICTION = ("coulomb_friction", "stribeck_friction", "warming_friction", "recording_friction", "gear_loss")


@dataclass(frozen=True)
class Drawn:
    """A kind at a place with parameters (b,), the chains around it (b,), and torques (t, b) on both inertias."""

    kind: str
    at: str | tuple
    p: dict
    base: dict
    time: np.ndarray
    u: np.ndarray
    v: np.ndarray

    def model(self, number: int) -> dict:
        """One of them as tables of a model file."""
        base = {key: float(value[number]) for key, value in self.base.items()}
        at = [PLACE[one] for one in self.at] if isinstance(self.at, tuple) else PLACE[self.at]
        sensors = {"w_a": ("speed", "a"), "w_b": ("speed", "b"), "m": ("torque", "s"), "phi": ("angle", "b")}
        parameters = {key: float(value[number]) for key, value in self.p.items()}
        brake = {"measures": "speed"} if self.kind == "imposed_motion" else {}
        return {
            "inertias": {name: {"J": base[f"J_{name}"], "drag": base[f"drag_{name}"]} for name in "ab"},
            "shafts": {"s": {"between": ["a", "b"], "stiffness": base["k"], "damping": base["c"]}},
            "inputs": {"u": {"on": "a"}, "v": {"on": "b"} | brake},
            "sensors": {name: {"measures": measures, "of": of} for name, (measures, of) in sensors.items()},
            "effects": [{"kind": self.kind, "at": at, **parameters}],
        }  # fmt: skip


def drawn(name: str, count: int, seed: int, step: float = 1e-3, seconds: float = 1.2) -> Drawn:
    """So many chains, parameters and torques of a kind, or of one of :data:`ELSEWHERE`."""
    kind, at = ELSEWHERE.get(name, (name, None))
    own, p = KINDS[kind]
    at = own if at is None else at
    p = TWIST_TABLE if name == "table of a shaft" else p
    random, time = np.random.default_rng([seed, *map(ord, name)]), np.arange(round(seconds / step)) * step

    def some(value, spread=SPREAD):
        return value * spread ** random.uniform(-1, 1, count)

    fixed = ("efficiency", "efficiency_reverse", "order", "phase")
    narrow = 1.2 if kind in ("table", "gain_drift", "parameter_drift") else SPREAD
    base = {key: some(value) for key, value in BASE.items()}
    values = {
        key: np.full(count, value) if key in fixed or key.startswith(("pedal_", "speed_2")) else some(value, narrow)
        for key, value in p.items()
    }
    if kind == "stribeck_friction":
        values["breakaway"] = values["torque"] * (1.2 + 0.6 * random.uniform(size=count))

    def torque(size):
        parts = sum(
            some(size) * np.sin(2 * np.pi * f * time[:, None] + random.uniform(0, 6, count))
            for f in (0.7, 2.3, 6.0, 11.0)
        )
        begun = np.clip((time - 0.1) / 0.02, 0, 1)[:, None]
        return begun * (
            parts + some(size) * np.sign(np.sin(2 * np.pi * 1.1 * time[:, None] + random.uniform(0, 6, count)))
        )

    u, v = torque(4.0), torque(1.0)
    if kind == "torque_map":  # a pedal
        u = np.clip(0.4 + u / 20, -0.1, 1.1)
    if kind == "brake":
        v = 3 * np.maximum(v, 0.0)
    if kind == "imposed_motion":  # a speed, which begins at rest
        v = 0.5 * np.clip((time - 0.1) / 0.2, 0, 1)[:, None] * np.sin(2 * np.pi * some(2.0) * time[:, None])
    return Drawn(kind, at, values, base, time, u, v)


def readings(of: Drawn, pieces: int) -> dict[str, np.ndarray]:
    """Readings (t, b) by sensor, with so many steps between two samples."""
    kind, at, p, base, b = of.kind, of.at, of.p, dict(of.base), of.u.shape[1]
    h, count = (of.time[1] - of.time[0]) / pieces, len(of.time)
    if kind == "wrong_parameter":
        base["J_b"] = p["value"]
    fine = np.arange((count - 1) * pieces + 1) * h
    u, v = _input(of, fine, h)
    # speeds of a and b, their angles' difference and sum parts: twist, angle a, angle b; three states of the effect
    x, out = np.zeros((8, b)), {name: np.empty((len(fine), b)) for name in ("w_a", "w_b", "m", "phi")}

    def aged(t):
        return 1 + p["change"] * (1 - np.exp(-t / p["time_constant"]))

    def shaft(t, x):
        """Torque of the shaft and rates of the three states."""
        w_b = x[6] if kind == "compliance" else x[1]
        k = base["k"] * (aged(t) if kind == "parameter_drift" and at == "k" else 1.0)
        twist, rate, z = x[2], x[0] - w_b, np.zeros((3, b))
        if kind == "slip":
            torque = (k * x[5] + base["c"] * rate) / (1 + base["c"] / p["coefficient"])
            z[0] = rate - torque / p["coefficient"]
            return torque, z
        if kind == "tyre_slip":
            z[0] = (p["slip_stiffness"] * rate - np.abs(x[1]) * k * x[5]) / (
                p["slip_stiffness"] + np.abs(x[1]) * base["c"]
            )
            linear = k * x[5] + base["c"] * z[0]
            return p["peak"] * np.sin(SHAPE * np.arctan(linear / (SHAPE * p["peak"]))), z
        if kind == "backlash":
            over = np.sign(twist) * np.maximum(np.abs(twist) - p["gap"] / 2, 0.0)
            torque = k * over + base["c"] * rate
            return np.where((over != 0) & (np.sign(torque) == np.sign(over)), torque, 0.0), z
        torque = k * twist * (np.where(twist < 0, p["factor"], 1.0) if kind == "directional_stiffness" else 1.0)
        torque = torque + base["c"] * rate
        if kind == "hardening":
            torque = torque + p["cubic"] * twist**3
        elif kind == "quadratic_damping":
            torque = torque + p["coefficient"] * rate * np.abs(rate)
        elif kind in ("relaxation", "double_relaxation"):
            for i, more in enumerate(["", "_2"][: 1 + (kind == "double_relaxation")]):
                torque = torque + p["stiffness" + more] * x[5 + i]
                z[i] = rate - x[5 + i] / p["time_constant" + more]
        elif kind == "hysteresis":
            torque = torque + x[5]
            z[0] = rate * (1 - np.sign(rate) * x[5] / p["torque"]) * p["torque"] / p["angle"]
        elif kind == "table" and at == "shaft":
            torque = torque + _interpolated(p, "twist", twist)
        return torque, z

    def rates(t, x, u, v):
        d = np.zeros_like(x)
        torque, d[5:8] = shaft(t, x)
        into_b, on_a, on_b = torque, u - base["drag_a"] * x[0], -base["drag_b"] * x[1]
        if kind == "parameter_drift" and at == "drag":
            on_b = aged(t) * on_b
        if kind == "compliance":  # states 5 and 6: twist of the second spring, speed of the inertia between
            into_b = p["stiffness"] * x[5]
            d[5], d[6] = x[6] - x[1], (torque - into_b) / p["J"]
        if kind == "brake":
            d[5] = x[1] - np.abs(x[1]) * x[5] / p["deflection"]
            on_b = on_b - v / p["deflection"] * (x[5] + 0.002 * d[5])
        elif kind != "imposed_motion":
            on_b = on_b + v
        if kind == "torque_map":
            on_a = on_a - u + _bilinear(p, x[0], u)
        if kind == "constant_torque":
            on_b = on_b - p["torque"]
        elif kind == "quadratic_drag":
            on_b = on_b - p["coefficient"] * x[1] * np.abs(x[1])
        elif kind == "torque_ripple":
            on_a = on_a + p["amplitude"] * np.sin(p["order"] * x[3] + p["phase"])
        elif kind == "geared_ripple":
            on_a = on_a + p["amplitude"] * np.sin(p["order"] * x[4] + p["phase"])
        elif kind == "position_torque":
            turned = 2 * np.pi * x[3] / p["period"]
            on_a = on_a - p["amplitude"] * np.sin(turned + p["phase"]) - p["amplitude_2"] * np.sin(2 * turned)
        elif kind == "table" and at == "b":
            on_b = on_b + _interpolated(p, "speed", x[1])
        d[0], d[1] = (on_a - torque) / base["J_a"], (into_b + on_b) / base["J_b"]
        d[2], d[3], d[4] = x[0] - (x[6] if kind == "compliance" else x[1]), x[0], x[1]
        if kind == "imposed_motion":
            d[1] = 0.0
        return d

    def stopped(t, x, u, over):
        """Dry friction as an impulse that at most stops what slides."""
        if kind == "load_friction":
            most = p["coefficient"] * np.abs(u) * over / base["J_a"]
            x[0] = np.sign(x[0]) * np.maximum(np.abs(x[0]) - most, 0.0)
            return
        if kind not in FRICTION:
            return
        if kind == "coulomb_friction":
            torque = np.where(x[1] < 0, p["torque_reverse"], p["torque"])
        elif kind == "stribeck_friction":
            torque = p["torque"] + (p["breakaway"] - p["torque"]) * np.exp(-((x[1] / p["speed"]) ** 2))
        elif kind == "warming_friction":
            torque = p["torque"] * aged(t)
        elif kind == "recording_friction":
            torque = (p["torque_1"] + p["torque_2"]) / 2
        else:
            passed = shaft(t, x)[0]
            driven = passed * x[1] > 0
            torque = np.abs(passed) * np.where(driven, 1 - p["efficiency"], 1 / p["efficiency_reverse"] - 1)
        x[1] = np.sign(x[1]) * np.maximum(np.abs(x[1]) - torque * over / base["J_b"], 0.0)

    for n, t in enumerate(fine):
        if kind == "imposed_motion":
            x[1] = v[0][n]
        out["w_a"][n], out["w_b"][n], out["m"][n], out["phi"][n] = x[0], x[1], shaft(t, x)[0], x[4]
        if n == len(fine) - 1:
            break
        stopped(t, x, u[0][n], h / 2)
        inputs = [(u[0][n], v[0][n]), (u[1][n], v[1][n]), (u[2][n], v[2][n])]
        first = rates(t, x, *inputs[0])
        second = rates(t + h / 2, _moved(x, first, h / 2, kind, v[1][n]), *inputs[1])
        third = rates(t + h / 2, _moved(x, second, h / 2, kind, v[1][n]), *inputs[1])
        fourth = rates(t + h, _moved(x, third, h, kind, v[2][n]), *inputs[2])
        x = x + h / 6 * (first + 2 * second + 2 * third + fourth)
        stopped(t + h, x, u[2][n], h / 2)
    if kind == "sensor_ripple":  # the angle, before it is read wrongly
        turned, speed = p["order"] * out["phi"] + p["phase"], out["w_b"].copy()
        out["phi" if at == "phi" else "w_b"] += p["amplitude"] * (
            np.sin(turned) if at == "phi" else p["order"] * speed * np.cos(turned)
        )
        return {name: values[::pieces] for name, values in out.items()}
    return {name: _read(of, name, fine, values, h)[::pieces] for name, values in out.items()}


def _moved(x, d, by, kind, speed):
    x = x + by * d
    if kind == "imposed_motion":
        x[1] = speed
    return x


def _interpolated(p, axis, at):
    """A table (b,) between its points, constant beyond."""
    number = sum(key.startswith(axis) for key in p)
    order = np.argsort([float(p[f"{axis}_{i}"][0]) for i in range(1, number + 1)]) + 1
    return np.array([
        np.interp(at[j], [p[f"{axis}_{i}"][j] for i in order], [p[f"torque_{i}"][j] for i in order])
        for j in range(len(at))
    ])  # fmt: skip


def _bilinear(p, speed, pedal):
    """The torque (b,) of a map of three speeds and three pedals, constant beyond them."""
    made = np.empty(len(speed))
    for j in range(len(speed)):
        speeds, pedals = ([p[f"{axis}_{i}"][j] for i in (1, 2, 3)] for axis in ("speed", "pedal"))
        over = [np.interp(pedal[j], pedals, [p[f"torque_{i}_{k}"][j] for k in (1, 2, 3)]) for i in (1, 2, 3)]
        made[j] = np.interp(speed[j], speeds, over)
    return made


def _input(of, fine, h):
    """What acts at begin, middle and end of every fine step, by the law of an effect at an input."""
    p, at_time = of.p, of.time

    def recorded(values, t):
        return np.stack([np.interp(t, at_time, column) for column in values.T], axis=1)

    moments = (fine[:-1], fine[:-1] + h / 2, fine[1:])
    v = [np.vstack([recorded(of.v, t), np.zeros((1, of.v.shape[1]))]) for t in moments]
    v[0][-1] = recorded(of.v, fine[-1:])[0]
    if of.kind == "dead_time":
        u = [
            np.stack([np.interp(t - d, at_time, c) for c, d in zip(of.u.T, p["delay"], strict=True)], axis=1)
            for t in moments
        ]
    else:
        u = [recorded(of.u, t) for t in moments]
    if of.at == "u":
        if of.kind == "input_gain":
            u = [p["factor"] * one for one in u]
        elif of.kind == "input_offset":
            u = [p["offset"] + one for one in u]
        elif of.kind == "gain_drift":
            u = [
                one * (1 + p["change"] * (1 - np.exp(-t[:, None] / p["time_constant"])))
                for one, t in zip(u, moments, strict=True)
            ]
        elif of.kind == "saturation":
            u = [np.clip(one, -p["limit"], p["limit"]) for one in u]
        elif of.kind == "falling_torque_constant":
            u = [one / np.sqrt(1 + (one / p["torque"]) ** 2) for one in u]
        elif of.kind in ("lag", "rate_limit"):
            u = _filtered_input(of, u, h)
    u = [np.vstack([one, one[-1:]]) for one in u]
    return u, v


def _filtered_input(of, u, h):
    begin, middle, end = (np.empty_like(u[0]) for _ in range(3))
    now = u[0][0].copy()
    for n in range(len(u[0])):
        begin[n] = now
        if of.kind == "rate_limit":
            middle[n], end[n] = (_limited(now, u[0][n], u[2][n], h, part * h, of.p["rate"]) for part in (0.5, 1.0))
        else:
            middle[n] = _lagged(now, u[0][n], u[1][n], h / 2, of.p["time_constant"])
            end[n] = _lagged(now, u[0][n], u[2][n], h, of.p["time_constant"])
        now = end[n].copy()
    return begin, middle, end


def _limited(y, first, last, span, over, rate):
    """A limited rate after ``over`` s: at its rate until it meets the input, which is straight over ``span``, then with
    it."""
    slope, gap = (last - first) / span, first - y
    toward = np.sign(gap)
    nearing = rate - toward * slope  # by how much the gap shrinks in a second
    meets = np.where(gap == 0, 0.0, np.where(nearing > 0, np.abs(gap) / np.where(nearing > 0, nearing, 1.0), np.inf))
    alone = np.minimum(meets, over)
    return y + toward * rate * alone + np.clip(slope, -rate, rate) * (over - alone)


def _lagged(y, first, last, over, time):
    """A lag of first order after ``over`` s with an input that is straight: exact."""
    slope = (last - first) / over
    steady = first - slope * time
    return steady + slope * over + (y - steady) * np.exp(-over / time)


def _read(of, name, fine, values, h):
    """A reading (t, b) on the fine grid by the law of an effect at a sensor."""
    p, t = of.p, fine[:, None]
    if of.at != name:
        return values
    if of.kind in ("sensor_delay", "clock_offset"):
        late = p.get("delay", p.get("offset"))
        return np.stack([np.interp(fine - d, fine, c) for c, d in zip(values.T, late, strict=True)], axis=1)
    if of.kind in ("lag", "all_pass"):
        for _ in range(1 if of.kind == "lag" else 2):
            time = p["time_constant"] if of.kind == "lag" else p["delay"] / 4
            lagged = np.empty_like(values)
            lagged[0] = values[0]
            for n in range(len(values) - 1):
                lagged[n + 1] = _lagged(lagged[n], values[n], values[n + 1], h, time)
            values = lagged if of.kind == "lag" else 2 * lagged - values
        return values
    return {
        "sensor_gain": lambda: p["factor"] * values, "sensor_offset": lambda: values + p["offset"],
        "sensor_drift": lambda: values + p["rate"] * t, "angle_zero": lambda: values + p["zero"],
        "gain_drift": lambda: values * (1 + p["change"] * (1 - np.exp(-t / p["time_constant"]))),
        "hum": lambda: values + p["amplitude"] * np.sin(2 * np.pi * p["frequency"] * t + p["phase"]),
    }[of.kind]()  # fmt: skip
