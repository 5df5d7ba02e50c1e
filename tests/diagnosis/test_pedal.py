"""A recording with a pedal instead of a torque: what its map made, and what the model lacks, against own equations."""

import numpy as np
import pytest

import rigmatch as rm
from matching.diagnosis.causes import acting_torques
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.plausible import as_one_rigid_body

SPEEDS, PEDALS = [84.0, 210.0, 628.0], [0.0, 0.3, 1.0]
TORQUES = [[20.0, 60, 120], [-15, 50, 160], [-40, 20, 140]]
LAG, STEP = 0.08, 2e-3
MODEL = {
    "inertias": {"engine": {"J": 0.15, "drag": 0.02}, "car": {"J": 130, "drag": 1}},
    "shafts": {"link": {"between": ["engine", "car"], "ratio": 5, "stiffness": 3000, "damping": 10}},
    "inputs": {"pedal": {"on": "engine"}},
    "sensors": {"speed": {"measures": "speed", "of": "engine"}, "torque": {"measures": "torque", "of": "link"}},
    "effects": [
        {"kind": "torque_map", "at": "inputs.pedal", "speed": SPEEDS, "pedal": PEDALS, "torque": TORQUES},
    ],
}  # fmt: skip


def of_map(speed, pedal):
    return np.interp(speed, SPEEDS, [np.interp(pedal, PEDALS, row) for row in TORQUES])


def driven(seconds, seed):
    """Time, pedal, engine speed, torque of the shaft, torque of the map: the torque builds up with a lag."""
    random, time = np.random.default_rng(seed), np.arange(round(seconds / STEP)) * STEP
    pedal = 0.35 + 0.25 * np.sin(random.uniform(0.7, 1.2) * time)
    pedal = np.clip(pedal + 0.2 * np.sign(np.sin(random.uniform(2.5, 4) * time)) * (time > 1), 0, 1)

    def rates(x, p):
        engine, car, twist, torque = x
        link = 3000 * twist + 10 * (engine / 5 - car)
        return np.array([
            (torque - 0.02 * engine - link / 5) / 0.15, (link - car) / 130, engine / 5 - car,
            (of_map(engine, p) - torque) / LAG,
        ])  # fmt: skip

    x, rows, h = np.array([150.0, 30.0, 0.0, of_map(150, pedal[0])]), [], STEP / 6
    for now, then in zip(pedal, [*pedal[1:], pedal[-1]], strict=True):
        rows.append([x[0], 3000 * x[2] + 10 * (x[0] / 5 - x[1]), of_map(x[0], now)])
        for piece in range(6):
            p, q, r = (now + (then - now) * (piece + part) / 6 for part in (0, 0.5, 1))
            a = rates(x, p)
            b = rates(x + h / 2 * a, q)
            c = rates(x + h / 2 * b, q)
            x = x + h / 6 * (a + 2 * b + 2 * c + rates(x + h * c, r))
    out = np.array(rows)
    noisy = out[:, :2] + random.normal(size=(len(time), 2)) * [0.1, 0.5]
    return time, pedal, *noisy.T, out[:, 2]


@pytest.fixture
def recorded(tmp_path):
    def of(seconds, seed, unit="%", scale=100.0):
        time, pedal, speed, torque, made = driven(seconds, seed)
        text = ",".join(["time [s]", f"pedal [{unit}]" if unit else "pedal", "speed [rad/s]", "torque [N*m]"])
        file = tmp_path / "run.csv"
        columns = np.stack([time, scale * pedal, speed, torque], axis=1)
        np.savetxt(file, columns, "%.7g", ",", header=text, comments="")
        return file, pedal, speed, made

    return of


def test_a_pedal_is_read_in_per_cent_and_refused_without_its_unit(recorded):
    system = from_dict(MODEL)
    file, pedal, _, _ = recorded(2.0, 1)
    np.testing.assert_allclose(rm.read_recording(file, system)["pedal"], pedal, atol=1e-6)
    file, *_ = recorded(2.0, 1, unit="")
    with pytest.raises(InputError, match=r"run\.csv: column 'pedal': is 35 at 0 s: a pedal is 0 to 1; .* pedal \[%\]"):
        rm.read_recording(file, system)


def test_what_the_map_made_stands_for_the_pedal(recorded):
    system = from_dict(MODEL)
    file, pedal, speed, made = recorded(2.0, 2)
    found = acting_torques(system, np.stack([speed, speed / 5], axis=1), pedal[:, None])
    np.testing.assert_allclose(found[:, 0], made, atol=0.3)  # the speed has noise
    recording = rm.read_recording(file, system)
    (body,) = as_one_rigid_body(recording.time, recording.channels, system)
    np.testing.assert_allclose(body.torque, made, atol=0.3)


@pytest.mark.long
def test_a_lag_of_the_engine_s_torque_is_found_behind_the_pedal(recorded, tmp_path):
    file, *_ = recorded(16.0, np.random.SeedSequence().entropy)
    found = rm.diagnose(from_dict(MODEL), [file])
    (cause,) = found.causes
    assert (cause.kind, cause.at) == ("lag", "inputs.pedal")
    value = cause.parameters["time_constant"]
    assert value.value == pytest.approx(LAG, rel=0.01)
