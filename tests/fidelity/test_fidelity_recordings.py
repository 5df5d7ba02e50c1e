"""Recordings of a fidelity case: one answer from every format, other people's channel names, slow channels, jitter."""

import json

import numpy as np
import pytest
from scipy.io import savemat
from scipy.signal import butter, lfilter

import rigmatch as rm
from matching.cli import main
from matching.fidelity import read_case
from modelling.errors import InputError

TIME = np.arange(2000) * 1e-3
LATE = 7  # samples
DOMAINS = """
f_max = "30 Hz"
weights = { system_dynamics = 1.0 }
"""
CASE = """
[recordings]
reference = "road.csv"
test = "rig%s"
%s
[system_dynamics.torque]
[system_dynamics.speed]
"""
CALLED = """
[channels]
time = "t"
torque = { channel = "M_dyno", unit = "kN*m", sign = -1 }
speed = "n_EM"
fuel = "not recorded and not asked for"
"""


@pytest.fixture(scope="module")
def signals():
    """Torque in N·m and speed in 1/min, (t,): noise of up to 20 Hz, the rig's late by seven samples."""
    rng = np.random.default_rng(8)
    torque, speed = lfilter(*butter(3, 20, fs=1000), rng.standard_normal((2, 3000)))[:, 500:2500] * 100
    return torque, 1000 + 3 * speed


def delayed(values):
    return np.concatenate([np.full(LATE, values[0]), values[:-LATE]])


def write_csv(path, names, units, columns, time=TIME):
    header = ",".join(f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True))
    np.savetxt(path, np.stack([time, *columns], axis=1), "%.17g", ",", header=header, comments="")


def write_mat(path, names, units, columns):
    savemat(path, {**dict(zip(names, [TIME, *columns], strict=True)), "units": dict(zip(names, units, strict=True))})


def write_parquet(path, names, units, columns):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    heads = [f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)]
    parquet.write_table(pyarrow.table([TIME, *columns], names=heads), path)


def write_mf4(path, names, units, columns):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        for name, unit, column in zip(names[1:], units[1:], columns, strict=True):
            file.append([asammdf.Signal(column, TIME, unit, name)])
        file.append([asammdf.Signal(np.zeros(9000), np.arange(9000) * 1e-4, "g", "accelerometer")])  # and not compared
        file.save(path, overwrite=True)


WRITERS = {".csv": write_csv, ".mat": write_mat, ".parquet": write_parquet, ".mf4": write_mf4}


def case(
    folder, signals, suffix=".csv", keys="", names=("time", "torque", "speed"), units=("s", "N*m", "1/min"), k=1.0
):
    write_csv(folder / "road.csv", ("time", "torque", "speed"), ("s", "Nm", "1/min"), signals)
    WRITERS[suffix](folder / f"rig{suffix}", names, units, [k * delayed(signals[0]), delayed(signals[1])])
    (folder / "case.toml").write_text(DOMAINS + CASE % (suffix, keys))
    return folder / "case.toml"


@pytest.fixture(scope="module")
def plain(tmp_path_factory, signals):
    """The answer from CSV files with the names of the case."""
    return rm.fidelity(case(tmp_path_factory.mktemp("plain"), signals), draws=200).to_dict()


OTHERS = {"names": ("t", "M_dyno", "n_EM"), "units": ("s", "", "1/min"), "k": -1e-3}


@pytest.mark.parametrize("suffix", WRITERS)
def test_one_answer_from_every_format_and_under_other_names(tmp_path, signals, plain, suffix):
    for one in plain["signals"]["system_dynamics"]:
        assert one["delay"] == pytest.approx(LATE * 1e-3, abs=2e-5)
    path = case(tmp_path, signals, suffix, **OTHERS)
    (tmp_path / "called.toml").write_text(CALLED)
    other = rm.fidelity(path, channels=tmp_path / "called.toml", draws=200).to_dict()
    assert other["R_XiL"] == pytest.approx(plain["R_XiL"], rel=1e-9)
    assert other["notes"] == []


def test_a_case_may_name_its_channel_file(tmp_path, signals, plain):
    (tmp_path / "called.toml").write_text(CALLED)
    named = case(tmp_path, signals, keys='test_channels = "called.toml"', **OTHERS)
    assert rm.fidelity(named, draws=200).R_XiL == pytest.approx(plain["R_XiL"], rel=1e-9)


def test_command_takes_a_channel_file(tmp_path, signals, capsys):
    path = case(tmp_path, signals, names=("t", "M_dyno", "n_EM"), units=("s", "", "1/min"), k=-1e-3)
    (tmp_path / "called.toml").write_text(CALLED)
    words = ["fidelity", str(path), "--out", str(tmp_path / "out"), "--draws", "200", "--json"]
    assert main(words) == 2
    assert "has no column 'torque'; it has M_dyno, n_EM" in capsys.readouterr().err.replace(" and ", ", ")
    assert main([*words, "--channels", str(tmp_path / "called.toml")]) == 0
    assert json.loads(capsys.readouterr().out)["R_XiL"] > 0.5
    (tmp_path / "called.toml").write_text(CALLED.replace("M_dyno", "M_dino"))
    assert main([*words, "--channels", str(tmp_path / "called.toml")]) == 2
    assert "did you mean 'M_dyno'?" in capsys.readouterr().err


def test_what_is_mended_is_noted(tmp_path, signals):
    path = case(tmp_path, signals)
    clean = read_case(path)[1]
    jitter = TIME + 2e-4 * np.sin(np.arange(len(TIME)))
    torque, speed = (np.interp(jitter, TIME, delayed(values)) for values in signals)
    torque[5] = np.nan
    write_csv(tmp_path / "rig.csv", ("time", "torque", "speed"), ("s", "N*m", "1/min"), (torque, speed), jitter)
    _, found = read_case(path)
    assert found.total == pytest.approx(clean.total, abs=5e-4)
    assert [note.split(":")[0] for note in found.notes] == ["rig.csv"] * 3
    step = np.diff(jitter)
    assert f"uneven time steps, {step.min():.4g} to {step.max():.4g} s" in found.notes[0]
    assert "torque lacks 1 value, first at 0.00480822 s" in found.notes[1]
    assert "brought to equal steps" in found.notes[2]


def test_channels_without_recordings(tmp_path):
    (tmp_path / "called.toml").write_text(CALLED)
    text = DOMAINS + "[system_dynamics.torque]\nnrmse_fidelity = 0.9\n"
    (tmp_path / "case.toml").write_text(text)
    with pytest.raises(InputError, match="has no recordings"):
        rm.fidelity(tmp_path / "case.toml", channels=tmp_path / "called.toml")
