"""Recordings: what is read, mended, told and refused."""

import numpy as np
import pytest

from modelling.errors import InputError
from modelling.recordings.read import csv_text, read_recording
from modelling.recordings.recording import Recording
from tests.simulation.drives import system_with

HEADER = "time [s],motor_torque [N*m],brake_torque [N*m],motor_speed [1/min],link_torque"
SYSTEM = system_with()


def rows(count=20, step=0.001):
    return [f"{k * step:.6g},{0.1 * k:.4g},1.5,{60 * k},{-k}" for k in range(count)]


def written(tmp_path, lines, header=HEADER, name="recording.csv", end="\n"):
    path = tmp_path / name
    path.write_bytes((end.join([header, *lines]) + end).encode())
    return path


def test_channels_come_in_si_by_name(tmp_path):
    got = read_recording(written(tmp_path, rows()), SYSTEM)
    assert got.notes == ()
    np.testing.assert_allclose(got.time, np.arange(20) * 0.001, atol=1e-12)
    np.testing.assert_allclose(got["motor_speed"], 2 * np.pi * np.arange(20))
    np.testing.assert_allclose(got["link_torque"], -np.arange(20.0))
    np.testing.assert_allclose(got.inputs(SYSTEM), np.column_stack([0.1 * np.arange(20), np.full(20, 1.5)]))
    assert got.sensors(SYSTEM) == ["motor_speed", "link_torque"]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_line_ends_quotes_byte_order_mark_and_blank_lines(tmp_path, end):
    lines = [*rows(5), "", '"0.005","0.5","1.5","300",-5']
    got = read_recording(written(tmp_path, lines, "\ufeff" + HEADER, end=end), SYSTEM)
    np.testing.assert_allclose(got["link_torque"], -np.arange(6.0))


def test_units_other_than_si(tmp_path):
    header = "time [ms],motor_torque [kN*m],brake_torque [N*m],motor_speed [deg/s]"
    got = read_recording(written(tmp_path, ["0,1,2,180", "1,2,2,360"], header), SYSTEM)
    np.testing.assert_allclose(got.time, [0, 0.001])
    np.testing.assert_allclose(got["motor_torque"], [1000, 2000])
    np.testing.assert_allclose(got["motor_speed"], [np.pi, 2 * np.pi])


def test_missing_values_are_bridged_in_inputs_and_left_out_of_sensors(tmp_path):
    lines = rows()
    lines[3], lines[4] = "0.003,,1.5,180,-3", "0.004,NaN,1.5,,-4"
    got = read_recording(written(tmp_path, lines), SYSTEM)
    np.testing.assert_allclose(got["motor_torque"], 0.1 * np.arange(20))
    assert np.isnan(got["motor_speed"][4])
    assert np.isfinite(got["motor_speed"]).sum() == 19
    assert "motor_torque lacks 2 values, first at 0.003 s; bridged" in got.notes[0]
    assert "motor_speed lacks 1 value, first at 0.004 s; left out" in got.notes[1]


def test_a_sensor_without_any_value_is_unused(tmp_path):
    got = read_recording(written(tmp_path, [f"{k},1,1,,{k}" for k in range(4)]), SYSTEM)
    assert got.sensors(SYSTEM) == ["link_torque"]
    assert "motor_speed has no value" in got.notes[0]


def test_columns_that_the_model_lacks_are_told(tmp_path):
    header = "time [s],motor_torque,brake_torque,oil_temperature [degC]"
    got = read_recording(written(tmp_path, ["0,1,1,80", "1,1,1,81"], header), SYSTEM)
    assert got.notes == ("not in the model, unused: oil_temperature",)


def test_duplicates_gaps_and_uneven_steps_are_told(tmp_path):
    lines = rows(40)
    got = read_recording(written(tmp_path, [*lines[:10], lines[9], *lines[10:]]), SYSTEM)
    assert len(got.time) == 40
    assert "1 time stamps are repeated, first at 0.009 s" in got.notes[0]
    got = read_recording(written(tmp_path, lines[:10] + lines[25:]), SYSTEM)
    assert "gaps in time (0.016 s at 0.009 s)" in got.notes[0]
    about = np.arange(40) * 0.001 + np.random.default_rng(0).uniform(-1, 1, 40) * 1e-4
    slower = np.cumsum(np.linspace(0.001, 0.0012, 40))
    for stamps in (about, slower):
        got = read_recording(written(tmp_path, [f"{t:.9g},1,1,1,1" for t in stamps]), SYSTEM)
        step = np.diff(stamps)
        assert got.notes[0] == f"uneven time steps, {step.min():.4g} to {step.max():.4g} s"
        np.testing.assert_allclose(got.time, stamps, atol=1e-9)


def test_a_gap_is_one_whether_cells_are_empty_or_rows_are_missing(tmp_path):
    """Up to 0.1 s of an input are bridged; a longer gap divides the recording, and nothing is made up in it."""
    lines = rows(500)
    short = (
        lines[:100] + [line.replace(f",{0.1 * k:.4g},", ",,", 1) for k, line in enumerate(lines)][100:199] + lines[199:]
    )
    for kept in (short, lines[:100] + lines[199:]):
        got = read_recording(written(tmp_path, kept), SYSTEM)
        np.testing.assert_allclose(np.interp(0.15, got.time, got["motor_torque"]), 15.0)
        got.check_continuous()
    assert len(read_recording(written(tmp_path, short), SYSTEM).time) == 500
    empty = [line.replace(f",{0.1 * k:.4g},", ",,", 1) for k, line in enumerate(lines)]
    for kept in (lines[:100] + empty[100:200] + lines[200:], lines[:100] + lines[200:]):
        got = read_recording(written(tmp_path, kept), SYSTEM)
        assert len(got.time) == 400
        assert not ((got.time > 0.0995) & (got.time < 0.1995)).any()
        with pytest.raises(InputError, match=r"has a gap from 0\.099 to 0\.2 s; cut the recording there"):
            got.check_continuous()


def test_rows_before_the_first_value_of_an_input_are_left_out(tmp_path):
    lines = [f"{k * 0.001:.6g},{k if k >= 7 else ''},{k if k < 95 else ''},{60 * k},1" for k in range(100)]
    got = read_recording(written(tmp_path, lines), SYSTEM)
    np.testing.assert_allclose(got["motor_torque"], np.arange(7, 95))
    np.testing.assert_allclose(got["motor_speed"], 2 * np.pi * np.arange(7, 95))
    assert "motor_torque lacks 7 values, first at 0 s" in got.notes[0]
    assert "7 rows left out" in got.notes[0]


def test_columns_that_are_not_used_may_hold_anything(tmp_path):
    """Text, no name, no cells, a name that is there twice; blank lines before the header."""
    header = "\n \ntime [s],remark,motor_torque,brake_torque,x,,x,motor_speed [1/min],"
    lines = ["0,start,1,1.5,,,7,0,", "0.001,,2,1.5,off,,8,60,,", "0.002,done,3,1.5,,,9,120,"]
    got = read_recording(written(tmp_path, lines, header), SYSTEM)
    np.testing.assert_allclose(got["motor_torque"], [1, 2, 3])
    np.testing.assert_allclose(got["motor_speed"], 2 * np.pi * np.arange(3))
    assert got.notes == ("not in the model, unused: remark, x, x",)
    with pytest.raises(InputError, match="line 5: 'x' in column 'motor_torque'"):
        read_recording(written(tmp_path, [lines[0], lines[1].replace("2", "x", 1)], header), SYSTEM)


def test_an_absolute_time_starts_at_zero_and_needs_enough_digits(tmp_path):
    lines = [f"{1.7e9 + 0.001 * k:.3f},{k},1,1,1" for k in range(3000)]
    got = read_recording(written(tmp_path, lines), SYSTEM)
    np.testing.assert_allclose(got.time, 0.001 * np.arange(3000), atol=1e-8)
    assert "time starts at 1700000000 s in the file" in got.notes[0]
    rounded = [f"{1.7e9 + 0.001 * k:.10g},{k},1,1,1" for k in range(3000)]
    with pytest.raises(InputError, match=r"2996 of 3000 time stamps are repeated.*write time with more digits"):
        read_recording(written(tmp_path, rounded), SYSTEM)
    single = [f"{float(np.float32(1.7e9 + 0.001 * k)):.10g},{k},1,1,1" for k in range(3000)]  # all in one step of 128 s
    with pytest.raises(InputError, match=r"all rows have the same time, 1700000000 s; write time with more digits"):
        read_recording(written(tmp_path, single), SYSTEM)


def test_time_stamps_that_were_rounded_lie_on_the_grid(tmp_path):
    step = 1 / 3000
    got = read_recording(written(tmp_path, [f"{k * step:.6f},1,1,1,1" for k in range(500)]), SYSTEM)
    assert got.notes == ()
    np.testing.assert_allclose(np.diff(got.time), step, rtol=1e-5)
    assert np.ptp(np.diff(got.time)) < 1e-12


ROWS = "\n0,1,1,1,1\n1,1,1,1,1\n"
BAD = {
    "empty": ("", "is empty"),
    "header only": (HEADER + "\n", "has 0 rows"),
    "one row": (HEADER + "\n0,1,1,1,1\n", "has 1 row of numbers"),
    "no time": ("motor_torque,brake_torque\n1,2\n2,3\n", "has no column 'time'; there are motor_torque, brake_torque"),
    "text in numbers": (HEADER + "\n0,1,1,1,1\n0.001,1,off,1,1\n", r"line 3: 'off' in column 'brake_torque \[N\*m\]'"),
    "short row": (HEADER + "\n0,1,1,1,1\n0.001,1,1\n", "line 3: 3 cells; the header has 5"),
    "all rows short": (HEADER + "\n0,1,1\n0.001,1,1\n", "line 2: 3 cells"),
    "unknown unit": (
        HEADER.replace("1/min", "furlongs") + ROWS,
        "column 'motor_speed'.*furlongs",
    ),
    "unit of another kind": (HEADER.replace("1/min", "kg") + ROWS, "unit 'kg' does not fit"),
    "hertz": (HEADER.replace("1/min", "Hz") + ROWS, "radians or turns"),
    "time falls": (HEADER + "\n0,1,1,1,1\n1,1,1,1,1\n0.5,1,1,1,1\n", "line 4: time falls from 1 to 0.5 s"),
    "time missing": (HEADER + "\n0,1,1,1,1\n,1,1,1,1\n2,1,1,1,1\n", "line 3: time is missing"),
    "time stands": (HEADER + "\n0,1,1,1,1\n0,1,1,1,1\n", "all rows have the same time"),
    "near miss": (
        HEADER.replace("motor_torque", "motor_torqe") + ROWS,
        "did you mean 'motor_torqe'",
    ),
    "input without value": (HEADER + "\n0,,1,1,1\n1,,1,1,1\n", "column 'motor_torque': has no value"),
    "column twice": (
        HEADER + ",motor_speed\n0,1,1,1,1,1\n1,1,1,1,1,1\n",
        "line 1: column 'motor_speed' is there twice",
    ),
    "thousands": ("time [s];motor_torque;brake_torque\n0;1.500,5;2\n", "points here and commas there"),
    "underscored number": (HEADER + "\n0,1,1,1,1\n1,1_0,1,1,1\n", "line 3: '1_0'"),
    "zero bytes": ("\0" * 50, "line 1 is no header row"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_told_in_one_line(tmp_path, case):
    text, line = BAD[case]
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=line) as told:
        read_recording(path, SYSTEM)
    assert str(path) in str(told.value)
    assert "\n" not in str(told.value)


def test_bytes_that_are_no_text_and_files_that_are_not_there(tmp_path):
    path = tmp_path / "bad.csv"
    path.write_bytes(np.random.default_rng(0).bytes(5000))
    with pytest.raises(InputError, match=r"bad\.csv"):
        read_recording(path, SYSTEM)
    with pytest.raises(InputError, match="does not exist"):
        read_recording(tmp_path / "none.csv", SYSTEM)
    with pytest.raises(InputError, match=r"'\.xls' is no known format"):
        read_recording(tmp_path / "none.xls", SYSTEM)
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError):
        read_recording(tmp_path / "folder.csv", SYSTEM)


def test_cut_and_resampled():
    time = np.arange(101) * 0.01
    recording = Recording(time, {"motor_torque": time**2, "motor_speed": np.where(time == time[50], np.nan, time)})
    assert recording.resampled() is recording
    finer = recording.resampled(200.0)
    assert len(finer.time) == 201
    np.testing.assert_allclose(finer["motor_torque"][::2], time**2)
    assert np.isnan(finer["motor_speed"][100])
    assert "resampled to 200 Hz" in finer.notes[0]
    assert "frequencies above 10 Hz alias" in recording.resampled(20.0).notes[1]
    assert len(recording.resampled(99.5).notes) == 1  # half a percent below the recorded rate: nothing to speak of
    assert "frequencies above 49 Hz alias" in recording.resampled(98.0).notes[1]
    part = recording.cut(0.2, 0.4)
    assert part.time[0] == pytest.approx(0.2)
    assert len(part.time) == 20
    with pytest.raises(InputError, match="fewer than two rows"):
        recording.cut(5, 6)


def test_what_is_written_is_read_again(tmp_path):
    values = np.random.default_rng(0).normal(size=(3, 50))
    columns = {"motor_torque": values[0], "brake_torque": values[1], "motor_speed": values[2]}
    units = {"motor_torque": "N*m", "brake_torque": "N*m", "motor_speed": "rad/s"}
    path = tmp_path / "written.csv"
    path.write_text(csv_text(np.arange(50) * 0.001, columns, units))
    got = read_recording(path, SYSTEM)
    for name, value in columns.items():
        np.testing.assert_allclose(got[name], value, rtol=1e-8)


def test_mat_files(tmp_path):
    from scipy.io import savemat

    time = np.arange(30) * 0.002
    channels = {"motor_torque": time, "brake_torque": time**2, "motor_speed": 60 * time}
    savemat(tmp_path / "a.mat", {"time": time, **channels, "units": {"motor_speed": "1/min"}, "comment": "x"})
    savemat(tmp_path / "b.mat", {"run": {"time": time, **channels}})
    np.testing.assert_allclose(read_recording(tmp_path / "a.mat", SYSTEM)["motor_speed"], 2 * np.pi * time)
    np.testing.assert_allclose(read_recording(tmp_path / "b.mat", SYSTEM)["brake_torque"], time**2)
    savemat(tmp_path / "d.mat", {"time": time, **channels, "motor_speed": 60 * time[:-1], "remark": time[:7]})
    with pytest.raises(InputError, match=r"d\.mat: 'motor_speed': has 29 values, time 30"):
        read_recording(tmp_path / "d.mat", SYSTEM)
    (tmp_path / "c.mat").write_text("no such thing " * 40)
    with pytest.raises(InputError, match=r"is no \.mat file"):
        read_recording(tmp_path / "c.mat", SYSTEM)


def test_parquet_files(tmp_path):
    parquet, pyarrow = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("pyarrow")
    time = np.arange(30) * 0.002
    torques = {"motor_torque": time, "brake_torque": time}
    table = pyarrow.table({"time [s]": time, **torques, "motor_speed [1/min]": 60 * time})
    parquet.write_table(table, tmp_path / "a.parquet")
    np.testing.assert_allclose(read_recording(tmp_path / "a.parquet", SYSTEM)["motor_speed"], 2 * np.pi * time)
    (tmp_path / "b.parquet").write_text("no such thing")
    with pytest.raises(InputError, match="is no Parquet file"):
        read_recording(tmp_path / "b.parquet", SYSTEM)


def test_mdf_files(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    time = np.arange(30) * 0.002
    signals = [
        asammdf.Signal(60 * time, time, "1/min", "motor_speed"),
        asammdf.Signal(time, time, "Nm", "motor_torque"),
    ]
    signals.append(asammdf.Signal(time[::2], time[::2], "Nm", "brake_torque"))
    with asammdf.MDF(version="4.10") as file:
        for signal in signals:
            file.append([signal])
        file.save(tmp_path / "a.mf4")
    got = read_recording(tmp_path / "a.mf4", SYSTEM)
    np.testing.assert_allclose(got["motor_speed"], 2 * np.pi * time[:-1])  # the slower input ends a step earlier
    np.testing.assert_allclose(got["brake_torque"], time[:-1], atol=1e-12)
    assert "brake_torque lacks 15 values, first at 0.002 s" in got.notes[0]
    (tmp_path / "b.mf4").write_text("no such thing")
    with pytest.raises(InputError, match="is no MDF file"):
        read_recording(tmp_path / "b.mf4", SYSTEM)


def test_newton_metres_as_test_beds_write_them(tmp_path):
    header = "time [s],motor_torque [Nm],brake_torque [kNm],motor_speed [rpm]"
    got = read_recording(written(tmp_path, ["0,1,2,60", "1,2,3,60"], header), SYSTEM)
    np.testing.assert_allclose(got["motor_torque"], [1, 2])
    np.testing.assert_allclose(got["brake_torque"], [2000, 3000])
    np.testing.assert_allclose(got["motor_speed"], 2 * np.pi)
