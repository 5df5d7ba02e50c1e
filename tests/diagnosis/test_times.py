"""Times, signs and gains of channels from pairs of them, where the model is wrong: with own Runge-Kutta steps."""

from dataclasses import dataclass
from math import sin, tanh

import numpy as np
import pytest

from matching.diagnosis.audit import time_hypotheses
from matching.diagnosis.base import as_hypothesis
from matching.diagnosis.data import prepare_data
from matching.diagnosis.descent import FitOptions, solve
from matching.diagnosis.problem import base_problem
from matching.diagnosis.times import channel_times
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

FINE = 4  # steps between two samples


@dataclass
class TwoMasses:
    """Two inertias on a shaft, with friction and a load that no model of theirs has."""

    J: tuple[float, float]
    k: float
    c: float
    drag: float
    friction: float
    load: float  # N·m·s²/rad², times a wave that nobody records
    gravity: float

    def motion(self, time, torque, wave, speed):
        """Speeds of both and the torque of the shaft, (t, 3)."""
        step = (time[1] - time[0]) / FINE

        def rates(t, x):
            q, p, w, v = x
            shaft = self.k * (q - p) + self.c * (w - v)
            first = torque(t) - shaft - self.drag * w - self.friction * tanh(w / 0.02)
            second = shaft - self.load * (1 + wave(t)) * v * abs(v) - self.gravity * sin(p / 30)
            return w, v, first / self.J[0], second / self.J[1]

        x = (self.load * speed**2 / self.k, 0.0, speed, speed)
        out = np.empty((len(time), 3))
        for i, begin in enumerate(time):
            out[i] = x[2], x[3], self.k * (x[0] - x[1]) + self.c * (x[2] - x[3])
            for n in range(FINE):
                t = begin + n * step
                a = rates(t, x)
                b = rates(t + step / 2, [u + step / 2 * d for u, d in zip(x, a, strict=True)])
                c = rates(t + step / 2, [u + step / 2 * d for u, d in zip(x, b, strict=True)])
                d = rates(t + step, [u + step * e for u, e in zip(x, c, strict=True)])
                x = [u + step / 6 * (e + 2 * f + 2 * g + h) for u, e, f, g, h in zip(x, a, b, c, d, strict=True)]
        return out


def waves(rng, lowest, highest, size):
    """A sum of ten sines as a function of time."""
    rate, phase = 2 * np.pi * rng.uniform(lowest, highest, 10), rng.uniform(0, 2 * np.pi, 10)
    lines = list(zip(rate.tolist(), phase.tolist(), (size * rng.uniform(0.5, 1, 10)).tolist(), strict=True))
    return lambda t: sum(a * sin(r * t + p) for r, p, a in lines)


def recorded(rng, plant, torque, wave, speed, rate, seconds, late, noise):
    """A model that is up to 30 % off, and its recording with these sensors late."""
    time = np.arange(int(-1.5 * rate), int(seconds * rate)) / rate
    motion = plant.motion(time, torque, wave, speed)
    kept = np.arange(int(seconds * rate)) / rate
    channels = {"drive": np.array([torque(t) for t in kept])}
    for j, name in enumerate(noise):
        channels[name] = np.interp(kept - late.get(name, 0.0), time, motion[:, j])
        channels[name] += noise[name] * rng.standard_normal(len(kept))

    def off(value):
        value *= float(np.exp(rng.uniform(-0.3, 0.3)))
        return {"value": value, "lower": 0.4 * value, "upper": 2.5 * value}

    model = {
        "inertias": {"first": {"J": off(plant.J[0]), "drag": off(plant.drag)},
                     "second": {"J": off(plant.J[1]), "drag": off(max(plant.load * 2 * speed, plant.drag))}},
        "shafts": {"shaft": {"between": ["first", "second"], "stiffness": off(plant.k), "damping": off(plant.c)}},
        "inputs": {"drive": {"on": "first"}},
        "sensors": {name: {"measures": "torque" if name == "torque" else "speed",
                           "of": "shaft" if name == "torque" else name, "uncertainty": noise[name]}
                    for name in noise},
    }  # fmt: skip
    return from_dict(model), Recording(kept, channels)


def suspected(system, recording):
    data, _ = prepare_data(system, [recording])
    fit = solve(*base_problem(system, data), None, FitOptions(10))
    assert not as_hypothesis(system, fit).fit.cost < 2 * data.readings_count  # the model is far from the noise
    times = channel_times(system, fit)
    return time_hypotheses(system, fit, times), times


def axis(seed, late, gains=None):
    rng = np.random.default_rng(seed)
    plant = TwoMasses((0.01, 0.03), 2500.0, 1.0, 0.02, 0.8, 0.0, 1.2)
    torque = waves(rng, 0.2, 6.0, 1.0)
    noise = {"first": 0.05, "second": 0.05} | ({"torque": 0.01} if gains else {})
    system, recording = recorded(rng, plant, torque, lambda t: 0.0, 0.0, 250.0, 10.0, late, noise)
    for name, gain in (gains or {}).items():
        recording.channels[name] *= gain
    return system, recording


@pytest.mark.parametrize(("name", "gain"), [("first", -1.0), ("second", -1.0), ("torque", -1.0), ("second", 1.12)])
def test_the_sign_and_gain_of_a_channel_are_told_whatever_rubs_and_however_late_it_is(name, gain):
    """The other speed is of the same stiff joint; a torque tells less, for the inertias are uncertain."""
    hypotheses, times = suspected(*axis(29 + len(name), {name: 0.01}, {name: gain}))
    sensors = ["first", "second", "torque"]
    assert {n for n, sign in zip(sensors, times.sign[1:], strict=True) if sign < 0} == ({name} if gain < 0 else set())
    pair = next(p for p in times.pairs if (p.first, p.second) == (0, 1))
    assert pair.gain_uncertainty < 0.05
    expected = {"first": 1 / gain, "second": gain, "torque": 1.0}[name]
    assert abs(pair.gain - expected) < 3 * pair.gain_uncertainty
    if gain < 0:
        assert [at for kind, at, _ in hypotheses if kind == "sensor_gain"] == [f"sensors.{name}"]


@pytest.mark.parametrize("name", ["first", "second"])
def test_a_late_speed_of_a_stiff_joint_is_found_whatever_rubs(name):
    hypotheses, _ = suspected(*axis(11 + len(name), {name: 0.022}))
    ((kind, at, values),) = hypotheses
    other = {"first": "second", "second": "first"}[name]
    moved, late = (name, 0.022) if kind == "sensor_delay" else (other, -0.022)
    assert at == f"sensors.{moved}"
    assert next(iter(values.values())) == pytest.approx(late, abs=1e-3)


def test_channels_of_one_time_have_it_though_the_model_is_wrong():
    hypotheses, times = suspected(*axis(5, {}))
    assert not hypotheses
    assert abs(times.late.value[2] - times.late.value[1]) < 5 * times.late.uncertainty[1, 2] < 5e-3


def test_the_clock_of_a_long_line_is_found_though_nobody_knows_its_load():
    rng = np.random.default_rng(3)
    plant = TwoMasses((120.0, 260.0), 4e5, 900.0, 6.0, 0.0, 8.0, 0.0)
    push = waves(rng, 0.03, 0.9, 350.0)
    system, recording = recorded(
        rng, plant, lambda t: 2600 + push(t), waves(rng, 0.08, 0.35, 0.06), 18.0, 50.0, 40.0,
        {"second": 0.465, "torque": 0.465}, {"first": 0.02, "second": 0.02, "torque": 10.0},
    )  # fmt: skip
    ((kind, at, values),) = suspected(system, recording)[0]
    assert (kind, at) == ("clock_offset", "sensors.second+sensors.torque")
    assert values["offset"] == pytest.approx(0.465, abs=0.02)


def test_channels_that_are_slower_than_the_recording_is_long_tell_no_times() -> None:
    """A shaft that stands after a step, once the fault of a diagnosis: no line of a spectrum is left."""
    time = np.arange(400) / 50
    system = from_dict({
        "inertias": {"a": {"J": 1.0}, "b": {"J": 2.0}},
        "shafts": {"s": {"between": ["a", "b"], "stiffness": 100, "damping": 1.0}},
        "inputs": {"drive": {"on": "a"}},
        "sensors": {x: {"measures": "speed", "of": x, "uncertainty": 0.5} for x in ("a", "b")},
    })  # fmt: skip
    slow = np.sin(np.pi * time / time[-1] / 2)
    channels = {"a": slow, "b": slow, "drive": np.where(time > 0.5, 0.4, 0.0)}
    data = prepare_data(system, [Recording(time, channels, (), "made", {})])[0]
    times = channel_times(system, solve(*base_problem(system, data), None, FitOptions(2)))
    assert times.pairs == []
