"""Exported models with live clutches: against rigid friction by equations of the tests' own, and the own simulation."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from fmu.slave import slave
from needs import compiles
from simulation.own_gearbox import drawn
from simulation.test_gearbox import INPUTS, READ

from matching.export import read_export_source
from modelling.fmu.export import block, fmu
from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate

pytestmark = compiles


def readings(data, folder, time, torques, every=1, fmi="2.0"):
    """Readings (t', 3) of a model file's tables as an FMU under inputs (t, 3), straight between communication steps."""
    path = folder / "box.fmu"
    path.write_bytes(fmu(block([from_dict(data)], "box", "box"), fmi).content)
    step = time[1] - time[0]
    with slave(path) as one:
        one.begin()
        rows = [one.get(READ)]
        for now, after in zip(torques[:-every:every], torques[every::every], strict=True):
            one.set(dict(zip(INPUTS, now, strict=True)))
            one.slope(dict(zip(INPUTS, (after - now) / (every * step), strict=True)))
            one.step(every * step)
            rows.append(one.get(READ))
    return np.array(rows)


def of_rigid_friction(seed, folder, deflection=5e-4):
    """Rms and largest error, %, of the FMU over the range of a drawn shift of rigid friction."""
    shift = drawn(np.random.default_rng(seed), deflection)
    own = shift.own.simulate(shift.time, shift.torques)
    found = readings(tomllib.loads(shift.toml), folder, shift.time, shift.torques)
    right = np.stack([own[name] for name in READ], axis=1)
    assert np.abs(own["slip_1"]).max() > 5
    off = 100 * (found - right) / np.ptp(right, axis=0)
    return np.sqrt(np.mean(off**2, axis=0)).max(), np.abs(off).max()


@pytest.mark.parametrize("seed", [883001])
def test_a_shift_is_that_of_rigid_friction(seed, tmp_path):
    rms, largest = of_rigid_friction(seed, tmp_path)
    assert rms < 0.2
    assert largest < 1.0


@pytest.mark.long
def test_many_shifts_are_those_of_rigid_friction(tmp_path):
    found = np.array([of_rigid_friction(seed, tmp_path) for seed in range(884000, 884030)])
    print(found.max(axis=0), np.median(found, axis=0))
    assert found[:, 0].max() < 0.2
    assert found[:, 1].max() < 1.0


def ours(data, time, torques):
    """Readings (t, 3) of the own simulation."""
    found = simulate(from_dict(data), time, dict(zip(INPUTS, torques.T, strict=True)), start="rest")
    return np.stack([found[name] for name in READ], axis=1)


@pytest.mark.parametrize(
    ("deflection", "settling", "every", "effects"),
    [
        pytest.param(0.02, 2e-5, 1, [], marks=pytest.mark.long),
        pytest.param(5e-4, 2e-3, 1, [], marks=pytest.mark.long),
        (0.002, 1e-4, 10, []),
        (0.005, 1e-4, 1, [
            {"kind": "dead_time", "at": "inputs.clutch_2", "delay": 0.03},
            {"kind": "lag", "at": "inputs.clutch_1", "time_constant": 0.02},
            {"kind": "input_gain", "at": "inputs.clutch_2", "factor": 0.9},
        ]),
    ],
    ids=["soft", "hard and damped", "steps of 10 ms", "late and weak"],
)  # fmt: skip
def test_a_shift_is_that_of_the_simulation(deflection, settling, every, effects, tmp_path):
    shift = drawn(np.random.default_rng(885001), deflection)
    data = tomllib.loads(shift.toml)
    data["gearboxes"]["box"]["settling"] = settling
    if effects:
        data["effects"] = effects
    time, torques = shift.time[: 1 + 10 * ((len(shift.time) - 1) // 10)], shift.torques
    torques = torques[: len(time)]
    # between communication steps inputs are straight
    straight = np.stack([np.interp(time, time[::every], each[::every]) for each in torques.T], axis=1)
    right = ours(data, time, straight)
    found = readings(data, tmp_path, time, torques, every)
    off = np.abs(found - right[::every]) / np.ptp(right, axis=0)
    assert off.max() < 2e-3, off.max(axis=0)


@pytest.mark.long
def test_it_stays_stable_as_open_clutches_slip_fast_and_close(tmp_path):
    """400 rad/s and more over a deflection of 0.0005 rad: a step of 1 ms is 300 times too long for it."""
    shift = drawn(np.random.default_rng(885002), 5e-4)
    data, time = tomllib.loads(shift.toml), np.arange(0, 1.5, 1e-3)
    motor = 40.0 * (time < 1.2)
    close = 300 * np.clip((time - 1.2) / 0.1, 0, 1)
    torques = np.stack([motor, close, 0 * time], axis=1)
    found, own = readings(data, tmp_path, time, torques), shift.own.simulate(time, torques)
    right = np.stack([own[name] for name in READ], axis=1)
    assert own["slip_1"].max() > 400
    assert (np.abs(found - right) / np.ptp(right, axis=0)).max() < 0.01


def test_noise_below_zero_is_zero(tmp_path):
    """A logger's offset on an open clutch drives nothing."""
    shift = drawn(np.random.default_rng(885003), 0.01)
    data, time = tomllib.loads(shift.toml), shift.time[:300]
    torques = np.stack([50 + 0 * time, 0 * time, 0 * time], axis=1)
    below = torques - np.array([0.0, 3.0, 2.0])
    assert np.array_equal(readings(data, tmp_path, time, below), readings(data, tmp_path, time, torques))


def test_the_example_is_exported_with_its_clutches(tmp_path):
    source = read_export_source(Path(__file__).parents[2] / "examples" / "gear_change" / "gearbox.toml")
    assert [one.name for one in source.block.inputs][1:3] == ["clutch_low", "clutch_high"]
    assert source.notes == ("gearboxes.box: its clutches carry what their inputs say, clutch_low, clutch_high (N*m)",)
    assert [one.unit for one in source.block.states if one.name.startswith("gearboxes.")] == ["rad", "rad"]
    assert "Clutches" in source.block.about
