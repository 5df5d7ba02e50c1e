"""Laws of actuators, springs and friction against Runge-Kutta steps of their own; what a diagnosis finds of them."""

from math import copysign, exp, sin, sqrt, tanh

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording
from modelling.simulation.simulate import simulate

STEP, FINE, COUNT = 2e-3, 4, 3000  # s between samples, steps between two of them, samples
J, DRAG, STIFFNESS, DAMPING = (0.1, 1.0), (0.03, 0.6), 350.0, 0.8
NOISE = {"motor_speed": 0.01, "load_speed": 0.01, "link_torque": 0.03}
TIME = STEP * np.arange(COUNT)
PLACES = {
    "saturation": "inputs.motor_torque", "rate_limit": "inputs.motor_torque",
    "falling_torque_constant": "inputs.motor_torque", "directional_stiffness": "shafts.link",
    "warming_friction": "inertias.load", "double_relaxation": "shafts.link", "hum": "sensors.load_speed",
}  # fmt: skip


def drawn(kind, rng):
    """Parameters of a kind."""
    size = float(rng.uniform(0.8, 1.25))
    return {
        "saturation": {"limit": 9.0 * size}, "rate_limit": {"rate": 150.0 * size},
        "falling_torque_constant": {"torque": 20.0 * size}, "directional_stiffness": {"factor": 0.6 * size},
        "warming_friction": {"torque": 3.0 * size, "change": -0.6, "time_constant": 2.0 * size},
        "double_relaxation": {"stiffness": 200 * size, "time_constant": 0.01 * size,
                              "stiffness_2": 120 * size, "time_constant_2": 0.15 * size},
        "hum": {"amplitude": 0.1 * size, "frequency": 50.0, "phase": 1.1},
    }[kind]  # fmt: skip


def torque_of(rng):
    """Vibrations, steps that reverse, and a mean."""
    lines = [(2 * np.pi * rng.uniform(*band), rng.uniform(0, 6), a) for *band, a in
             ((0.2, 0.6, 6.0), (0.8, 1.6, 4.0), (2.0, 5.0, 3.0), (5.0, 9.0, 2.0))]  # fmt: skip
    return np.array([sum(a * sin(r * t + p) for r, p, a in lines) + 3 * copysign(1, sin(1.7 * t)) for t in TIME])


def motion(kind, p, torque):
    """Readings (t,) by sensor, without noise. The torque is straight between samples."""
    state, h = [0.0] * 6, STEP / FINE  # speeds, twist, two relaxing twists or the actuator's torque, unused
    state[5] = torque[0]
    out = {name: np.empty(COUNT) for name in NOISE}

    def shaft(x):
        spring = STIFFNESS * (p["factor"] if kind == "directional_stiffness" and x[2] < 0 else 1) * x[2]
        if kind == "double_relaxation":
            spring += p["stiffness"] * x[3] + p["stiffness_2"] * x[4]
        return spring + DAMPING * (x[0] - x[1])

    def rates(t, x, u):
        if kind == "saturation":
            u = min(max(u, -p["limit"]), p["limit"])
        elif kind == "falling_torque_constant":
            u = u / sqrt(1 + (u / p["torque"]) ** 2)
        link, friction = shaft(x), 0.0
        if kind == "warming_friction":
            friction = p["torque"] * (1 + p["change"] * (1 - exp(-t / p["time_constant"]))) * tanh(x[1] / 1e-3)
        twist = x[0] - x[1]
        relaxing = [0.0, 0.0]
        if kind == "double_relaxation":
            relaxing = [twist - x[3] / p["time_constant"], twist - x[4] / p["time_constant_2"]]
        return [(u - link - DRAG[0] * x[0]) / J[0], (link - DRAG[1] * x[1] - friction) / J[1], twist, *relaxing, 0.0]

    def moved(x, d, by):
        return [a + by * b for a, b in zip(x, d, strict=True)]

    for i in range(COUNT):
        out["motor_speed"][i], out["load_speed"][i], out["link_torque"][i] = state[0], state[1], shaft(state)
        for n in range(FINE if i < COUNT - 1 else 0):
            t, inputs = TIME[i] + n * h, [torque[i] + (torque[i + 1] - torque[i]) * (n + s) / FINE for s in (0, 0.5, 1)]
            if kind == "rate_limit":  # follows at once, or at its rate: exact where the torque is straight
                begin = state[5]
                changes = [min(max(u - begin, -p["rate"] * s * h), p["rate"] * s * h)
                           for s, u in zip((0, 0.5, 1), inputs, strict=True)]  # fmt: skip
                inputs = [begin + change for change in changes]
            a = rates(t, state, inputs[0])
            b = rates(t + h / 2, moved(state, a, h / 2), inputs[1])
            c = rates(t + h / 2, moved(state, b, h / 2), inputs[1])
            d = rates(t + h, moved(state, c, h), inputs[2])
            state = [x + h / 6 * (e + 2 * f + 2 * g + k) for x, e, f, g, k in zip(state, a, b, c, d, strict=True)]
            state[5] = inputs[2]
    if kind == "hum":
        out["load_speed"] += p["amplitude"] * np.sin(2 * np.pi * p["frequency"] * TIME + p["phase"])
    return out


def model(rng=None):
    """The drive as stated; with a generator, up to 20 % off within its ranges."""

    def about(value):
        return value if rng is None else {"value": value * float(rng.uniform(0.85, 1.2)), "tolerance": 0.4}

    return {
        "inertias": {"motor": {"J": J[0], "drag": about(DRAG[0])}, "load": {"J": J[1], "drag": about(DRAG[1])}},
        "shafts": {"link": {
            "between": ["motor", "load"], "stiffness": about(STIFFNESS), "damping": about(DAMPING),
        }},
        "inputs": {"motor_torque": {"on": "motor"}},
        "sensors": {name: {"measures": measures, "of": of, "uncertainty": NOISE[name]} for name, measures, of in (
            ("motor_speed", "speed", "motor"), ("load_speed", "speed", "load"), ("link_torque", "torque", "link"),
        )},
    }  # fmt: skip


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[pytest.mark.long] * (kind == "rate_limit")) for kind in PLACES]
)
def test_it_moves_as_its_law_says(kind):
    rng = np.random.default_rng([4, *map(ord, kind)])
    p, torque = drawn(kind, rng), torque_of(rng)
    system = from_dict(model() | {"effects": [{"kind": kind, "at": PLACES[kind], **p}]})
    got = simulate(system, TIME, {"motor_torque": torque}, start="rest")
    without, expected = motion("none", {}, torque), motion(kind, p, torque)
    share = {"warming_friction": 0.01}.get(kind, 1e-3)  # friction has another width at rest
    for name, own in expected.items():
        off = np.abs(got[name] - own).max() / np.ptp(own)
        assert off < share, name
        assert off < got.integration_error[name] + share / 3, name  # what is stated, and what the own steps leave
    assert max(np.abs(without[name] - own).max() / np.ptp(own) for name, own in expected.items()) > 3 * share


@pytest.mark.long
@pytest.mark.parametrize("kind", [kind for kind in PLACES if kind != "hum"])
def test_a_diagnosis_names_it_with_its_value(kind):
    rng = np.random.default_rng([9, *map(ord, kind)])
    p, torque = drawn(kind, rng), torque_of(rng)
    channels = {name: own + NOISE[name] * rng.standard_normal(COUNT) for name, own in motion(kind, p, torque).items()}
    found = diagnose(from_dict(model(rng)), [Recording(TIME, {"motor_torque": torque, **channels})])
    (cause,) = (one for one in found.causes if one.in_model)  # what is weaker is no part of the answer
    assert (cause.kind, cause.at) == (kind, PLACES[kind])
    assert cause.confidence > 0.5
    for key, value in p.items():
        assert cause.parameters[key].value == pytest.approx(value, rel=0.1 if "2" not in key else 0.3), key
