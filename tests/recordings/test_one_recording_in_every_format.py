"""One recording from CSV, ``.mat``, Parquet and MDF4, with a channel that is slower than the rest."""

import csv
import sys

import numpy as np
import pytest
from scipy.io import savemat

from modelling.errors import InputError
from modelling.model_file import from_dict, to_dict
from modelling.recordings.read import Channel, read_recording
from modelling.units import factor

SYSTEM = from_dict({
    "inertias": {"motor": {"J": 0.1, "drag": 0.05}, "load": {"J": 1.2, "drag": 0.2}},
    "shafts": {"link": {"between": ["motor", "load"], "stiffness": 330, "damping": 0.5}},
    "inputs": {"motor_torque": {"on": "motor"}},
    "sensors": {
        "motor_speed": {"measures": "speed", "of": "motor"},
        "load_speed": {"measures": "speed", "of": "load"},
    },
})  # fmt: skip
TIME = np.arange(1500) * 0.002
UNITS = {"motor_torque": "N*m", "motor_speed": "1/min", "load_speed": "1/min"}
SI = {"motor_torque": "N*m", "motor_speed": "rad/s", "load_speed": "rad/s"}
SLOW = slice(0, None, 4)


@pytest.fixture(scope="module")
def channels():
    """Values (t,) in the units of the file, no two alike; the load's speed only in every fourth row."""
    torque, speed, slow = np.random.default_rng(5).normal(0, 30, (3, len(TIME))).cumsum(axis=1)
    load = np.full(len(TIME), np.nan)
    load[SLOW] = slow[SLOW]
    return {"motor_torque": torque, "motor_speed": speed, "load_speed": load}


def write_csv(path, channels):
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["time [s]", *(f"{name} [{UNITS[name]}]" for name in channels)])
        for row in zip(TIME, *channels.values(), strict=True):
            table.writerow(["" if np.isnan(value) else repr(float(value)) for value in row])


def write_mat(path, channels):
    savemat(path, {"run": {"time": TIME, **channels, "units": UNITS}})


def write_mat73(path, channels):
    """As MATLAB's save -v7.3 lays it out: HDF5 behind 512 bytes of header, numbers transposed, texts as UTF-16."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        run = file.create_group("run")
        run.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, value in {"time": TIME, **channels}.items():
            run.create_dataset(name, data=value[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
        units = run.create_group("units")
        for name, text in UNITS.items():
            letters = np.frombuffer(text.encode("utf-16-le"), np.uint16)[:, None]
            units.create_dataset(name, data=letters).attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def write_parquet(path, channels):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    fields = [pyarrow.field(name, pyarrow.float64(), metadata={"unit": UNITS[name]}) for name in channels]
    schema = pyarrow.schema([pyarrow.field("time", pyarrow.float64(), metadata={"unit": "s"}), *fields])
    parquet.write_table(pyarrow.table([TIME, *channels.values()], schema=schema), path)


def write_mf4(path, channels, late=0.0):
    """A group a channel, as loggers write them; the slow group's clock may be late by some of a second."""
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        for name, value in channels.items():
            there = np.isfinite(value)
            stamps = TIME[there] + (late if name == "load_speed" else 0.0)
            file.append([asammdf.Signal(value[there], stamps, UNITS[name], name)])
        file.save(path, overwrite=True)


def write_hdf5(path, channels):
    """Each channel a dataset in a group, its unit an attribute; beside them what is no channel."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["remark"] = "warm"
        file["calibration"] = np.eye(3)
        for name, value in {"time": TIME, **channels}.items():
            file[f"run/{name}"] = value
            file[f"run/{name}"].attrs["unit"] = UNITS.get(name, "s")


def write_h5_table(path, channels):
    """One table, as pandas and PyTables write it: fields of a compound type, units behind the names."""
    h5py = pytest.importorskip("h5py")
    names = ["time", *(f"{name} [{UNITS[name]}]" for name in channels)]
    with h5py.File(path, "w") as file:
        file["run"] = np.rec.fromarrays([TIME, *channels.values()], names=names)


def write_tdms(path, channels):
    """As LabVIEW writes waveforms: a group, units as properties, the time as an increment."""
    nptdms = pytest.importorskip("nptdms")
    written = [
        nptdms.ChannelObject("run", name, values, {"unit_string": UNITS[name], "wf_increment": 0.002})
        for name, values in channels.items()
    ]
    with nptdms.TdmsWriter(path) as file:
        file.write_segment(written)


WRITERS = {
    ".csv": write_csv, ".mat": write_mat, "73.mat": write_mat73, ".parquet": write_parquet, ".mf4": write_mf4,
    ".h5": write_hdf5, ".hdf5": write_h5_table, ".tdms": write_tdms,
}  # fmt: skip


def recorded(folder, suffix, channels, **how):
    path = folder / f"run{suffix}"
    WRITERS[suffix](path, channels, **how)
    return read_recording(path, SYSTEM)


@pytest.mark.parametrize("suffix", WRITERS)
def test_the_same_recording_from_every_format(suffix, tmp_path, channels):
    got = recorded(tmp_path, suffix, channels)
    np.testing.assert_allclose(got.time, TIME, atol=1e-12)
    for name, unit in UNITS.items():
        np.testing.assert_array_equal(got[name], channels[name] * factor(unit, SI[name]))


def test_stamps_that_differ_in_their_last_digits_are_one(tmp_path, channels):
    got = recorded(tmp_path, ".mf4", channels, late=1e-12)
    assert len(got.time) == len(TIME)
    np.testing.assert_allclose(got["load_speed"][SLOW] * 30 / np.pi, channels["load_speed"][SLOW], rtol=1e-12)


def test_a_slow_group_with_a_late_clock_keeps_its_rate(tmp_path):
    ramp = {"motor_torque": TIME, "motor_speed": 60 * TIME, "load_speed": np.full(len(TIME), np.nan)}
    ramp["load_speed"][SLOW] = 60 * (TIME[SLOW] + 0.0007)  # 60/min a second, seen 0.7 ms after each fourth row
    got = recorded(tmp_path, ".mf4", ramp, late=0.0007)
    np.testing.assert_allclose(got.time, TIME, atol=1e-12)
    there = np.isfinite(got["load_speed"])
    assert there.sum() == len(TIME[SLOW]) - 1  # before its first sample nothing is known of it
    np.testing.assert_allclose(got["load_speed"][there], 2 * np.pi * TIME[there], atol=1e-9)
    assert any("load_speed; straight lines between samples" in note for note in got.notes)


def test_only_channels_that_are_used_decide_the_time_base(tmp_path, channels):
    asammdf = pytest.importorskip("asammdf")
    write_mf4(tmp_path / "run.mf4", channels)
    with asammdf.MDF(tmp_path / "run.mf4") as file:
        fast = np.arange(0, TIME[-1], 1e-4)
        file.append([asammdf.Signal(np.sin(fast), fast, "g", "accelerometer")])
        file.append([asammdf.Signal(channels["motor_speed"][SLOW], TIME[SLOW], "1/min", "motor_speed")])
        file.append([asammdf.Signal(np.array([b"warm"] * 3), TIME[:3], "", "remark", encoding="utf-8")])
        file.save(tmp_path / "more.mf4", overwrite=True)
    plain, got = (read_recording(tmp_path / f"{name}.mf4", SYSTEM) for name in ("run", "more"))
    np.testing.assert_array_equal(got.time, plain.time)
    for name in UNITS:
        np.testing.assert_array_equal(got[name], plain[name])
    assert any("motor_speed is in 2 groups, taken from group 1: with most samples" in own for own in got.notes)
    assert any("not in the model, unused: accelerometer, remark" in own for own in got.notes)


def test_samples_that_are_marked_invalid_are_missing(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    bad = (np.arange(len(TIME)) % 100) == 7
    with asammdf.MDF(version="4.10") as file:
        torque = asammdf.Signal(np.ones(len(TIME)), TIME, "Nm", "motor_torque")
        speed = asammdf.Signal(np.where(bad, 1e6, 5.0), TIME, "rad/s", "motor_speed", invalidation_bits=bad)
        file.append([torque, speed])
        file.save(tmp_path / "run.mf4", overwrite=True)
    got = read_recording(tmp_path / "run.mf4", SYSTEM)
    np.testing.assert_array_equal(np.isnan(got["motor_speed"]), bad)
    assert np.nanmax(got["motor_speed"]) == 5.0


def test_a_text_in_place_of_a_channel_is_told(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(np.array([b"x"] * len(TIME)), TIME, "", "motor_torque", encoding="utf-8")])
        file.save(tmp_path / "run.mf4", overwrite=True)
    with pytest.raises(InputError, match="channel 'motor_torque': holds no numbers"):
        read_recording(tmp_path / "run.mf4", SYSTEM)


@pytest.mark.parametrize("suffix", [".mat", "73.mat", ".mf4", ".h5", ".tdms"])
def test_other_names_in_files_without_a_header_row(suffix, tmp_path, channels):
    write = WRITERS[suffix]
    write(tmp_path / f"run{suffix}", channels)
    called = {"time": Channel("time"), "motor_torque": Channel("motor_torque")}
    model_name = from_dict(to_dict(SYSTEM) | {"inputs": {"T_EM": {"on": "motor"}}})
    got = read_recording(tmp_path / f"run{suffix}", model_name, called | {"T_EM": called.pop("motor_torque")})
    np.testing.assert_array_equal(got["T_EM"], channels["motor_torque"])
    with pytest.raises(InputError, match="did you mean 'motor_torque'"):
        read_recording(tmp_path / f"run{suffix}", model_name, {"T_EM": Channel("motor_toque")})


def test_a_mat_file_whose_time_is_called_otherwise(tmp_path, channels):
    savemat(tmp_path / "run.mat", {"t": TIME, **channels, "units": UNITS, "other": np.arange(3)})
    for channels in (None, {"time": Channel("t")}):
        np.testing.assert_allclose(read_recording(tmp_path / "run.mat", SYSTEM, channels).time, TIME, atol=1e-12)


def test_without_h5py_one_line_says_what_to_do(tmp_path, channels, monkeypatch):
    write_mat73(tmp_path / "run.mat", channels)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(InputError, match="save it with -v7"):
        read_recording(tmp_path / "run.mat", SYSTEM)


def test_groups_of_a_tdms_file_with_their_own_rates(tmp_path):
    """The channels that are used decide; one that stands in two groups is called by its group."""
    nptdms = pytest.importorskip("nptdms")
    torque = np.sin(TIME)
    with nptdms.TdmsWriter(tmp_path / "run.tdms") as file:
        file.write_segment([
            nptdms.ChannelObject("fast", "vibration", np.zeros(50), {"wf_increment": 1e-4}),
            nptdms.ChannelObject("fast", "temp", np.zeros(50), {"wf_increment": 1e-4}),
            nptdms.ChannelObject("bed", "Zeit", TIME, {"unit_string": "s"}),
            nptdms.ChannelObject("bed", "motor_torque (kNm)", torque),
            nptdms.ChannelObject("bed", "temp", np.zeros(len(TIME))),
        ])  # fmt: skip
    got = read_recording(tmp_path / "run.tdms", SYSTEM)
    np.testing.assert_allclose(got.time, TIME, atol=1e-12)
    np.testing.assert_allclose(got["motor_torque"], 1000 * torque)


@pytest.mark.parametrize("suffix", [".h5", ".tdms"])
def test_what_is_no_such_file_is_one_line(tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    path.write_bytes(b"TDSm" + bytes(range(200)) if suffix == ".tdms" else b"\x89HDF\r\n\x1a\n" + bytes(range(200)))
    with pytest.raises(InputError, match=r"is no (HDF5|TDMS) file|crashed|has no channel"):
        read_recording(path, SYSTEM)
