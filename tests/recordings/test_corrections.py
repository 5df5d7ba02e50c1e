"""What loggers do to values, on random motions: wraps, missing signs, overrange numbers, slow and held channels."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.corrections import corrected_wraps, held_rows
from modelling.recordings.read import Channel, read_recording, recording_from_table
from modelling.recordings.table import Column, Table

SYSTEM = from_dict({
    "inertias": {"motor": {"J": 0.1}, "load": {"J": 1.0}},
    "shafts": {"link": {"between": ["motor", "load"], "stiffness": 200.0, "damping": 0.5}},
    "inputs": {"torque": {"on": "motor"}},
    "sensors": {
        "angle": {"measures": "angle", "of": "motor"},
        "load_angle": {"measures": "angle", "of": "load"},
        "speed": {"measures": "speed", "of": "motor"},
    },
})  # fmt: skip
TIME = np.arange(2000) * 0.002


def smooth(rng, size=1.0, highest=8.0):
    waves = rng.normal(size=(6, 1)) * np.sin(np.outer(rng.uniform(1, 2 * np.pi * highest, 6), TIME) + rng.uniform(0, 6))
    return size * waves.sum(axis=0) / np.abs(waves.sum(axis=0)).max()


def read(channels, units=None):
    columns = [Column(name, (units or {}).get(name, ""), values) for name, values in channels.items()]
    return recording_from_table(Table((Column("time", "s", TIME), *columns)), SYSTEM, "run.x")


seeds = st.integers(0, 10_000)


@given(seeds, st.sampled_from([0.0, -180.0, -77.0]), st.sampled_from([0.0, 0.1, 0.01]), st.booleans())
def test_angles_of_one_turn(seed, lowest, resolution, signed):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-500, 500) + rng.uniform(-40, 40) * 60 * TIME + smooth(rng, rng.uniform(0, 200))
    load = angle + 3 * np.sin(9 * TIME) + rng.normal(0, 0.05, len(TIME))
    shown = {}
    for name, degrees in (("angle", angle), ("load_angle", load)):
        degrees = np.round(degrees / resolution) * resolution if resolution else degrees
        shown[name] = (degrees - lowest) % 360 + lowest
    got = read({"torque": smooth(rng), **shown}, {"angle": "deg", "load_angle": "deg"})
    wrapped = [name for name in shown if np.abs(np.diff(shown[name])).max() > 180]
    for name, degrees in (("angle", angle), ("load_angle", load)):
        np.testing.assert_allclose(np.diff(np.rad2deg(got[name])), np.diff(degrees), atol=2.1 * resolution + 1e-6)
        assert any(f"{name} jumps by 360°" in note for note in got.notes) == (name in wrapped)
    if len(wrapped) == 2:
        assert np.abs(got["angle"] - got["load_angle"])[0] < np.pi


@given(seeds, st.sampled_from([16, 32]), st.sampled_from([1.0, 0.1, 1 / 128, 0.5]))
def test_torques_stored_without_sign_and_counters(seed, bits, lsb):
    rng = np.random.default_rng(seed)
    counts = np.round(smooth(rng, 300.0) + rng.uniform(-100, 100))
    if counts.min() >= -3 or counts.max() <= 3:
        return
    stored = np.where(counts < 0, counts + 2.0**bits, counts) * lsb
    got, _, notes = corrected_wraps("torque", stored, angle=False)
    np.testing.assert_allclose(got, counts * lsb, atol=1e-6 * lsb * 2.0 ** (bits - 16))
    assert "stored without sign" in notes[0]
    running = np.round(2.0 ** (bits - 8) * rng.uniform(1, 6) * np.arange(2000) * 0.1 + 300 * smooth(rng))
    if bits == 16:
        got, period, notes = corrected_wraps("angle", (running % 2**16) * lsb, angle=True)
        if np.abs(np.diff(running % 2**16)).max() > 2**15:
            assert period == pytest.approx(2**16 * lsb, rel=1e-9)
            np.testing.assert_allclose(np.diff(got), np.diff(running) * lsb, atol=1e-6 * lsb)


@given(seeds, st.sampled_from(["steps", "noise", "slow", "quantised"]))
def test_motions_that_do_not_wrap_are_left_as_they_are(seed, kind):
    rng = np.random.default_rng(seed)
    values = {
        "steps": np.repeat(rng.integers(-3, 4, 40), 50) * rng.uniform(0.1, 10),
        "noise": rng.normal(0, 3, len(TIME)),
        "slow": smooth(rng, 6.0),
        "quantised": np.round(smooth(rng, 6.0), 1),
    }[kind]
    for angle in (True, False):
        np.testing.assert_array_equal(corrected_wraps("x", values, angle=angle)[0], values)


def test_a_period_in_the_channel_file(tmp_path):
    angle = 3.0 + 700 * TIME
    rows = np.stack([TIME, np.sin(TIME), angle % 40], axis=1)
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="time,torque,phi", comments="")
    got = read_recording(tmp_path / "run.csv", SYSTEM, {"angle": Channel("phi", "deg", 2.0, period=40.0)})
    np.testing.assert_allclose(got["angle"], np.deg2rad(2 * angle), atol=1e-6)


@pytest.mark.parametrize("number", [9.9e37, 9.91e37, -9.9e37, 3.4028235e38, 1e30, -1e30, np.inf, 1e300])
@pytest.mark.parametrize("name", ["torque", "speed"])
def test_overrange_numbers_are_missing(number, name):
    rng = np.random.default_rng(4)
    channels = {"torque": smooth(rng), "speed": smooth(rng)}
    true = channels[name].copy()
    channels[name][100:120] = number
    got = read(channels)
    assert any(f"{name}: 20 numbers" in note for note in got.notes)
    there = np.isfinite(got[name])
    np.testing.assert_allclose(got[name][there], true[there], atol=0.5)
    assert there.sum() == (2000 if name == "torque" else 1980)


@pytest.mark.parametrize("sentinel", [-9999.0, 32767.0, 65535.0])
def test_a_value_far_beyond_all_others_is_noted(sentinel):
    speed = smooth(np.random.default_rng(2), 30.0)
    assert not read({"torque": np.sin(TIME), "speed": speed}).notes
    got = read({"torque": np.sin(TIME), "speed": np.where(np.arange(2000) % 400 == 7, sentinel, speed)})
    assert any("far beyond all other values" in note for note in got.notes)


@given(seeds, st.integers(2, 120), st.sampled_from(["missing", "held"]), st.sampled_from(["torque", "speed"]))
def test_slow_and_held_channels_keep_the_rows_of_the_others(seed, every, kind, name):
    rng = np.random.default_rng(seed)
    true = smooth(rng, 5.0, 0.04 / (0.002 * every))
    offset = int(rng.integers(0, every))
    at = np.arange(offset, 2000, every)
    if len(at) < 25:
        return
    slow = np.full(2000, np.nan)
    slow[at] = true[at]
    if kind == "held":
        slow = np.concatenate([np.full(offset, true[at[0]]), np.repeat(true[at], every)])[:2000]
    channels = {"torque": smooth(rng), "speed": smooth(rng)} | {name: slow}
    got = read(channels)
    first, last = (at[0], at[-1]) if name == "torque" else (0, 1999)
    assert len(got.time) >= last - first + 1 - every
    assert any(name in note and ("slower" in note or "bridged" in note) for note in got.notes)
    there = np.isfinite(got[name])
    np.testing.assert_allclose(got[name][there], np.interp(got.time, TIME, true)[there], atol=0.6)


@given(seeds, st.integers(2, 60))
def test_a_staircase_that_is_real_is_kept(seed, every):
    steps = np.repeat(np.random.default_rng(seed).normal(size=2000 // every + 1), every)[:2000]
    np.testing.assert_array_equal(held_rows(steps, input_torque=True)[0], steps)
    coarse = np.round(np.linspace(0, 50, 2000) * 3) / 3
    np.testing.assert_array_equal(held_rows(coarse, input_torque=False)[0], coarse)


@given(seeds)
def test_a_speed_without_its_sign_is_noted(seed):
    speed = smooth(np.random.default_rng(seed), 30.0)
    turns = int((np.diff(np.sign(speed)) != 0).sum())
    for values, expected in ((speed, False), (np.abs(speed), True), (speed + 60, False)):
        said = any("magnitude without sign" in note for note in read({"torque": np.sin(TIME), "speed": values}).notes)
        assert said == expected or (expected and turns < 8)


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
def test_the_master_of_a_group_is_time(tmp_path, kind):
    asammdf = pytest.importorskip("asammdf")
    signals = [
        asammdf.Signal(np.sin(TIME), TIME, "", name, master_metadata=("master", kind)) for name in ("torque", "speed")
    ]
    with asammdf.MDF(version="4.10") as file:
        file.append(signals)
        file.save(tmp_path / "run.mf4", overwrite=True)
    if kind == 1:
        assert len(read_recording(tmp_path / "run.mf4", SYSTEM).time) == 2000
        return
    with pytest.raises(InputError, match=r"recorded over an? (angle|distance|index)"):
        read_recording(tmp_path / "run.mf4", SYSTEM)


@pytest.mark.parametrize("kind", ["external", "virtual", "link"])
def test_a_mat_file_reads_no_other_file(tmp_path, kind):
    h5py = pytest.importorskip("h5py")
    secret, path = tmp_path / "secret", tmp_path / "run.mat"
    secret.write_bytes(np.arange(100.0).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.arange(100.0)
    with h5py.File(path, "w", userblock_size=512) as file:
        file["time"], file["speed"] = np.arange(100) * 0.01, np.arange(100.0)
        if kind == "external":
            file.create_dataset("torque", (100,), "f8", external=[(str(secret), 0, 800)])
        elif kind == "link":
            file["torque"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/x")
        else:
            layout = h5py.VirtualLayout((100,), "f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", (100,))
            file.create_virtual_dataset("torque", layout)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    with pytest.raises(InputError, match=r"'torque': (is a link|has its values in another file)"):
        read_recording(path, SYSTEM)
