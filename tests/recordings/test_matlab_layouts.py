"""The layouts in which MATLAB, Simulink and real-time recorders save a recording, all the same motion."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from matching.channel_names import channel_list
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.matlab import _sizes, read_matlab
from modelling.recordings.read import Channel, read_recording

TIME = np.arange(300) * 0.004
TORQUE, SPEED = np.sin(7 * TIME), 20 + np.cos(3 * TIME)
SYSTEM = from_dict(
    {
        "inertias": {"rotor": {"J": 0.02}},
        "inputs": {"motor_torque": {"on": "rotor"}},
        "sensors": {"speed": {"measures": "speed", "of": "rotor"}},
    }
)


def structs(*entries):
    """A structure array."""
    out = np.empty(len(entries), dtype=[(name, object) for name in entries[0]])
    for i, entry in enumerate(entries):
        out[i] = tuple(entry.values())
    return out


def scope(names=("motor_torque", "speed"), time=TIME):
    signals = [
        {"values": values, "dimensions": 1.0, "label": name, "blockName": "bed/Scope"}
        for name, values in zip(names, (TORQUE, SPEED), strict=True)
    ]
    return {"time": time, "signals": structs(*signals), "blockName": "bed/Scope"}


def recorder(names=("motor_torque", "speed")):
    rows = [
        {"Name": name, "Path": f"Model Root/{name}", "Unit": "-", "Data": values, "XIndex": 1.0}
        for name, values in zip(names, (TORQUE, SPEED), strict=True)
    ]
    return {"X": {"Name": "Raster", "Data": TIME, "Unit": "s"}, "Y": structs(*rows)}


OWN = {"time": Channel("t"), "motor_torque": Channel("M"), "speed": Channel("n")}
PLACES = {"motor_torque": Channel("log.bed.M"), "speed": Channel("log.bed.n"), "time": Channel("log.bed.t")}
ROWS = {"time": Channel("ans(1,:)"), "motor_torque": Channel("ans[1,:]"), "speed": Channel("ans(3,:)")}
COLUMNS = {"time": Channel("d(:,1)"), "motor_torque": Channel("d(:,2)"), "speed": Channel("d[:,2]")}
SCALAR = {"J": 0.02, "name": "run 7"}
LAYOUTS = {
    "vectors t, M, n": ({"t": TIME, "M": TORQUE, "n": SPEED} | SCALAR, OWN),
    "columns of one matrix": ({"d": np.stack([TIME, TORQUE, SPEED], 1)} | SCALAR, COLUMNS),
    "rows of one matrix": ({"ans": np.stack([TIME, TORQUE, SPEED])}, ROWS),
    "structure with time": ({"ScopeData": scope()} | SCALAR, {}),
    "structure with time, own labels": (
        {"ScopeData": scope(("M", "n"))},
        {name: own for name, own in OWN.items() if name != "time"},
    ),
    "two scopes of two rates": (
        {"slow": {"time": TIME[::10], "signals": {"values": TIME[::10], "label": "other"}}, "fast": scope()},
        {},
    ),
    "two runs with the same names": (
        {"run1": {"time": TIME[:100], "motor_torque": TORQUE[:100], "speed": SPEED[:100]}, "run2": scope()},
        {"motor_torque": Channel("run2.signals(1).values"), "speed": Channel("run2.signals(2).values"),
         "time": Channel("run2.time")},
    ),
    "recorder": ({"rec001": recorder()}, {}),
    "recorder with two rasters": (
        {"rec001": {
            "X": structs({"Name": "slow", "Data": TIME[::2], "Unit": "s"}, {"Name": "fast", "Data": TIME, "Unit": "s"}),
            "Y": structs(
                {"Name": "motor_torque", "Unit": "N*m", "Data": TORQUE, "XIndex": 2.0},
                {"Name": "speed", "Unit": "1/min", "Data": SPEED * 30 / np.pi, "XIndex": 2.0},
                {"Name": "temperature", "Unit": "degC", "Data": TIME[::2], "XIndex": 1.0},
            ),
        }},
        {},
    ),
    "structs in a struct": ({"log": {"bed": {"t": TIME, "M": TORQUE, "n": SPEED}, "settings": SCALAR}}, PLACES),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_is_the_same_recording(tmp_path, layout):
    content, channels = LAYOUTS[layout]
    savemat(tmp_path / "run.mat", content)
    got = read_recording(tmp_path / "run.mat", SYSTEM, channels)
    np.testing.assert_allclose(got.time, TIME, atol=1e-12)
    np.testing.assert_allclose(got["motor_torque"], TORQUE, atol=1e-12)
    np.testing.assert_allclose(got["speed"], SPEED, rtol=1e-12)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_list_of_channels_has_all_that_a_channel_file_needs(tmp_path, layout):
    savemat(tmp_path / "run.mat", LAYOUTS[layout][0])
    listed = channel_list(tmp_path / "run.mat", SYSTEM)
    seen = " ".join([*(row["name"] for row in listed["channels"]), *listed["notes"]])
    if "runs" not in layout:
        assert {row["samples"] for row in listed["channels"]} == {len(TIME)}
    for name in {"structure with time": ("time", "speed"), "structs in a struct": ("M", "n")}.get(layout, ()):
        assert name in seen
    if "matrix" in layout:
        assert len(listed["channels"]) == 3
    assert "motor_torque" in listed["channel_file"]


def test_what_is_not_there_is_one_line(tmp_path):
    savemat(tmp_path / "run.mat", {"t": TIME, "u": TORQUE, "n": SPEED})
    with pytest.raises(InputError, match="was not recorded; known are u, n"):
        read_recording(tmp_path / "run.mat", SYSTEM)
    savemat(tmp_path / "numbers.mat", SCALAR)
    with pytest.raises(InputError, match="has no column 'time'; there are J, name"):
        read_recording(tmp_path / "numbers.mat", SYSTEM)


def test_a_structure_array_of_version_7_3(tmp_path):
    """As MATLAB lays it out: every field a list of references, numbers transposed, texts as UTF-16."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "run.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        refs = file.create_group("#refs#")

        def kept(name, value):
            if isinstance(value, str):
                made = refs.create_dataset(name, data=np.frombuffer(value.encode("utf-16-le"), np.uint16)[:, None])
                made.attrs["MATLAB_class"] = np.bytes_("char")
            else:
                made = refs.create_dataset(name, data=value[None, :])
                made.attrs["MATLAB_class"] = np.bytes_("double")
            return made.ref

        data = file.create_group("ScopeData")
        data.attrs["MATLAB_class"] = np.bytes_("struct")
        data.create_dataset("time", data=TIME[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
        signals = data.create_group("signals")
        signals.attrs["MATLAB_class"] = np.bytes_("struct")
        for field, pair in {"values": (TORQUE, SPEED), "label": ("motor_torque", "speed")}.items():
            rows = [[kept(f"{field}{i}", value)] for i, value in enumerate(pair)]
            signals.create_dataset(field, data=rows, dtype=h5py.ref_dtype)
        matrix = file.create_dataset("d", data=np.stack([TIME, TORQUE, SPEED]))
        matrix.attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    for channels in ({}, COLUMNS):
        got = read_recording(path, SYSTEM, channels)
        np.testing.assert_allclose(got["motor_torque"], TORQUE)
        np.testing.assert_allclose(got["speed"], SPEED)


def test_parquet_holds_numbers_as_decimals_or_text(tmp_path):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    texts = [None if i == 7 else f"{value:.6f}".replace(".", ",") for i, value in enumerate(SPEED)]
    decimals = pyarrow.array(TORQUE).cast(pyarrow.decimal128(18, 6), safe=False)
    parquet.write_table(pyarrow.table({"time": TIME, "motor_torque": decimals, "speed": texts}), tmp_path / "a.parquet")
    got = read_recording(tmp_path / "a.parquet", SYSTEM)
    np.testing.assert_allclose(got["motor_torque"], TORQUE, atol=1e-6)
    assert np.isnan(got["speed"][7])
    np.testing.assert_allclose(np.delete(got["speed"], 7), np.delete(SPEED, 7), atol=1e-6)


def test_parquet_with_words_is_said(tmp_path):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    words = ["on"] * len(TIME)
    parquet.write_table(pyarrow.table({"time": TIME, "motor_torque": TORQUE, "speed": words}), tmp_path / "a.parquet")
    assert "speed is unused: its column holds no numbers" in read_recording(tmp_path / "a.parquet", SYSTEM).notes
    parquet.write_table(pyarrow.table({"time": TIME, "M": words, "speed": SPEED}), tmp_path / "b.parquet")
    with pytest.raises(InputError, match="'motor_torque': holds no numbers"):
        read_recording(tmp_path / "b.parquet", SYSTEM, {"motor_torque": Channel("M")})


def inflating(path: Path, version: str, count: int) -> Path:
    """A recording with a channel of so many zeros, which compress to nearly nothing."""
    time = np.arange(1000) * 1e-3
    names = {"time": time, "motor_torque": np.sin(time), "film": np.zeros(count)}
    if version == "5":
        savemat(path, names, do_compression=True)
        return path
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in names.items():
            file.create_dataset(name, data=values[None], compression="gzip").attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_what_inflates_beyond_a_recording_is_one_line_before_it_is_read(tmp_path, version, monkeypatch):
    """The same file is read where the channel that inflates is none of those asked for."""
    monkeypatch.setattr("modelling.recordings.table.LARGEST_READ", 1_000_000)
    path = inflating(tmp_path / "long.mat", version, 2_000_000)
    assert path.stat().st_size < 100_000
    with pytest.raises(InputError, match=r"long\.mat: 'film': holds 0\.016 GB of numbers in 0\.0\d+ MB; at most"):
        read_matlab(path)
    with pytest.raises(InputError, match="'film': holds"):
        read_matlab(path, ["film"])
    table = read_matlab(path, ["motor_torque"])
    assert table["motor_torque"].values == pytest.approx(np.sin(np.arange(1000) * 1e-3))
    assert "film" in table.others


def test_the_size_that_a_file_says_is_that_of_its_numbers(tmp_path):
    """Of names short and long, packed and not, in a struct too."""
    for compressed in (True, False):
        path = tmp_path / f"{compressed}.mat"
        values = {"t": np.zeros(3000), "a_longer_name_than_most": np.zeros((2, 500)), "s": {"x": np.zeros(700)}}
        savemat(path, values, do_compression=compressed)
        sizes = _sizes(path)
        assert list(sizes) == list(values)
        for name, count in {"t": 3000, "a_longer_name_than_most": 1000, "s": 700}.items():
            assert 8 * count <= sizes[name] < 8 * count + 400
