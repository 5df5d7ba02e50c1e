"""Files as other programs write them: spreadsheets of other countries, rows of units, dates for times, MDF 3."""

import datetime

import numpy as np
import pytest

from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.read import Channel, read_recording

SYSTEM = from_dict({
    "inertias": {"motor": {"J": 0.1}},
    "inputs": {"motor_torque": {"on": "motor"}},
    "sensors": {"motor_speed": {"measures": "speed", "of": "motor", "uncertainty": 0.1}},
})  # fmt: skip
TIME, TORQUE, SPEED = np.arange(4) * 0.5, np.array([1.5, -2.25, 1e-3, 0.125]), np.array([60.0, 30.0, 0.0, -15.5])
RAD = SPEED * np.pi / 30  # SPEED is in 1/min
ROWS = list(zip(TIME, TORQUE, SPEED, strict=True))
CALLED = {"time": Channel("Zeit"), "motor_torque": Channel("M"), "motor_speed": Channel("n")}


def written(path, head, mark, decimal, encoding="utf-8"):
    rows = [mark.join(f"{value:.6g}".replace(".", decimal) for value in row) for row in ROWS]
    path.write_text("\n".join([*head, *rows, ""]), encoding=encoding)
    return path


def check(got):
    np.testing.assert_allclose(got.time, TIME, atol=1e-12)
    np.testing.assert_allclose(got["motor_torque"], TORQUE, rtol=1e-12)
    np.testing.assert_allclose(got["motor_speed"], RAD, rtol=1e-12)


@pytest.mark.parametrize("decimal", [",", "."])
@pytest.mark.parametrize("mark", [";", "\t"])
def test_semicolons_tabs_and_decimal_commas(tmp_path, mark, decimal):
    head = [mark.join(["time [s]", "motor_torque [N*m]", "motor_speed [1/min]"])]
    check(read_recording(written(tmp_path / "run.csv", head, mark, decimal), SYSTEM))


@pytest.mark.parametrize("below", ["s;Nm;1/min", "[s];[Nm];[1/min]"])
def test_units_in_a_row_of_their_own(tmp_path, below):
    path = written(tmp_path / "run.csv", ["Zeit;M;n", below], ";", ",")
    check(read_recording(path, SYSTEM, CALLED))
    path.write_text(path.read_text(encoding="utf-8").replace("-2,25", "off"), encoding="utf-8")
    with pytest.raises(InputError, match="line 4: 'off' in column 'M"):
        read_recording(path, SYSTEM, CALLED)


def test_a_spreadsheet_of_windows(tmp_path):
    head = ["time [s];motor_torque [N·m];motor_speed [1/min];Öltemperatur [°C]"]
    path = written(tmp_path / "run.csv", head, ";", ",", "cp1252")
    path.write_bytes(path.read_bytes().replace(b"\n", b";80,5\r\n").replace(b"C];80,5", b"C]"))
    got = read_recording(path, SYSTEM)
    check(got)
    assert any("Windows-1252" in note for note in got.notes)


def test_missing_values_between_semicolons(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time;motor_torque;motor_speed\n0;0,5;\n0,5;1;2,5\n1;1;-\n", encoding="utf-8")
    got = read_recording(path, SYSTEM)
    np.testing.assert_array_equal(np.isnan(got["motor_speed"]), [True, False, True])
    assert got["motor_speed"][1] == 2.5


@pytest.mark.parametrize("cell", ["1.234,5", "1.5"])
def test_points_beside_commas_are_refused(tmp_path, cell):
    """1.234 may be a thousand or one: nobody knows."""
    path = tmp_path / "run.csv"
    path.write_text(f"time;motor_torque\n0;0,5\n0,5;{cell}\n", encoding="utf-8")
    with pytest.raises(InputError, match="line 3: numbers have points here and commas there"):
        read_recording(path, SYSTEM)


@pytest.mark.parametrize("name", ["t", "Zeit", "Timestamp", "TIME", "Time (s)", "time_s"])
def test_a_time_by_another_name_is_the_time(tmp_path, name):
    check(read_recording(written(tmp_path / "run.csv", [f"{name},motor_torque,motor_speed (rpm)"], ",", "."), SYSTEM))


def test_two_columns_that_may_be_the_time_are_asked_about(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,Zeit,motor_torque\n0,0,1\n1,1,2\n2,2,3\n")
    with pytest.raises(InputError, match='write time = "t" into a channel file'):
        read_recording(path, SYSTEM)


@pytest.mark.parametrize("kind", ["duration", "date"])
def test_parquet_with_dates_or_durations_for_times_as_the_last_column(tmp_path, kind):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    start = datetime.datetime(2026, 3, 29, 1, 59, 59) if kind == "date" else datetime.timedelta()
    stamps = [start + datetime.timedelta(seconds=float(time)) for time in TIME]
    path = tmp_path / "run.parquet"
    parquet.write_table(pyarrow.table({"motor_torque": TORQUE, "motor_speed [1/min]": SPEED, "Zeit": stamps}), path)
    check(read_recording(path, SYSTEM, {"time": Channel("Zeit")}))
    check(read_recording(path, SYSTEM))


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("kind", ["duration", "timestamp"])
def test_ticks_of_parquet_are_counted_in_their_unit(tmp_path, kind, unit):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    ticks = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    stamps = pyarrow.array(2 * ticks * np.arange(4) + 7 * ticks, getattr(pyarrow, kind)(unit))
    path = tmp_path / "run.parquet"
    parquet.write_table(pyarrow.table({"time": stamps, "motor_torque": TORQUE}), path, version="2.6")
    np.testing.assert_allclose(read_recording(path, SYSTEM).time, 2.0 * np.arange(4), atol=1e-12)


@pytest.mark.parametrize("suffix", [".mdf", ".dat"])
def test_mdf_of_version_3(tmp_path, suffix):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="3.30") as file:
        file.append([asammdf.Signal(TORQUE, TIME, "Nm", "motor_torque")])
        file.append([asammdf.Signal(SPEED, TIME, "1/min", "motor_speed")])
        file.save(tmp_path / "run.mdf", overwrite=True)
    check(read_recording((tmp_path / "run.mdf").rename(tmp_path / f"run{suffix}"), SYSTEM))


def test_a_unit_that_overrides_the_file_is_told(tmp_path):
    path = written(tmp_path / "run.csv", ["time [s],motor_torque [N*m],motor_speed [rad/s]"], ",", ".")
    got = read_recording(path, SYSTEM, {"motor_speed": Channel("motor_speed", "1/min")})
    check(got)
    assert any("rad/s by the file, taken in 1/min" in note for note in got.notes)
    assert not read_recording(path, SYSTEM).notes
    path.write_text(path.read_text(encoding="utf-8").replace("rad/s", "U/min"), encoding="utf-8")
    assert not read_recording(path, SYSTEM, {"motor_speed": Channel("motor_speed", "1/min")}).notes


@pytest.mark.parametrize("names", [("data[:,0]", "data[:,2]", "data[:, 1]"), ("data(:,1)", "data(:,3)", "data(:,2)")])
def test_columns_of_a_matrix(tmp_path, names):
    """As a .mat with one matrix of all signals: columns count from 0 in brackets, from 1 in parentheses."""
    from scipy.io import savemat

    path = tmp_path / "run.mat"
    savemat(path, {"data": np.stack([TIME, SPEED, TORQUE], axis=1), "beside": 3.0})
    called = dict(zip(("time", "motor_torque", "motor_speed"), map(Channel, names), strict=True))
    check(read_recording(path, SYSTEM, called | {"motor_speed": Channel(names[2], "1/min")}))
    with pytest.raises(InputError, match=r"'data\[:,3\]': is no column of a 4 × 3 matrix; columns are data\[:,0\]"):
        read_recording(path, SYSTEM, called | {"motor_speed": Channel("data[:,3]")})
    with pytest.raises(InputError, match=r"'beside\[:,0\]': is no column of a 1 matrix"):
        read_recording(path, SYSTEM, called | {"motor_speed": Channel("beside[:,0]")})
