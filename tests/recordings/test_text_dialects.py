"""One recording in random dialects of text: separators, quotes, encodings, units, dates, lines above the header."""

import datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.read import ChannelFile, read_channels, read_recording
from modelling.recordings.text import read_csv

SYSTEM = from_dict({
    "inertias": {"motor": {"J": 0.1}},
    "inputs": {"torque": {"on": "motor"}},
    "sensors": {"speed": {"measures": "speed", "of": "motor"}},
})  # fmt: skip
NAMES, UNITS = ["time", "torque", "speed"], ["s", "N*m", "rad/s"]
COUNT = 60
TIME = np.arange(COUNT) * 0.02
VALUES = {"time": TIME, "torque": np.round(3 * np.sin(5 * TIME) - 1, 5), "speed": np.round(40 * np.cos(3 * TIME), 4)}
ABOVE = {
    "nothing": [], "comments": ["# logger 3", "# 2024-03-05"], "etas": ["ETASAsciiItemFile{0}record{0}CrLf", "n{0}60"],
    "scope": ["Model{0}MSO24", "", "Sample Interval{0}0.02", "Vertical Units{0}V{0}", "Label{0}{0}"],
    "free text": ["A recording of the bed", "made on Tuesday; driver: Jo, all well"],
}  # fmt: skip
MISSING = ["", "nan", "1.#QNAN", "-1.#IND", "#N/A", "OL", "NaN", "***"]


def check(got, missing=()):
    np.testing.assert_allclose(got.time, TIME, atol=1e-6)
    np.testing.assert_allclose(got["torque"], VALUES["torque"], atol=1e-9)
    there = ~np.isin(np.arange(COUNT), missing)
    np.testing.assert_array_equal(np.isfinite(got["speed"]), there)
    np.testing.assert_allclose(got["speed"][there], VALUES["speed"][there], atol=1e-9)


@given(
    separator=st.sampled_from([",", ";", "\t", " ", "  "]),
    comma=st.booleans(),
    quoted=st.booleans(),
    units=st.sampled_from(["none", "header", "row", "row and types"]),
    above=st.sampled_from(sorted(ABOVE)),
    sep_line=st.booleans(),
    order=st.permutations(range(3)),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252"]),
    end=st.sampled_from(["\n", "\r\n"]),
    word=st.sampled_from(MISSING),
)
def test_any_dialect(tmp_path_factory, separator, comma, quoted, units, above, sep_line, order, encoding, end, word):
    blanks = separator.isspace() and separator != "\t"
    missing = [] if blanks and not word else [7, 31]

    def cell(text):
        return f'"{text}"' if quoted or (separator == "," and "," in text) else text

    def row(cells):
        return separator.join(cell(cells[i]) for i in order)

    heads = [f"{n} [{u}]" for n, u in zip(NAMES, UNITS, strict=True)] if units == "header" else NAMES
    lines = [line.format(separator) for line in ABOVE[above]] if not blanks else [*ABOVE[above][:2]]
    lines = [f"sep={separator}", *lines] if sep_line and separator in ",;\t" else lines
    lines = [line.replace("{0}", " ") for line in lines] + [row(heads)]
    lines += [row(["f8", "f8", "f8"])] * (units == "row and types") + [row(UNITS)] * units.startswith("row")
    for k in range(COUNT):
        texts = [repr(float(VALUES[name][k])) for name in NAMES]
        texts = [text.replace(".", ",") for text in texts] if comma else texts
        if k in missing:
            texts[2] = word
        lines.append(row(texts))
    path = tmp_path_factory.mktemp("dialect") / "run.csv"
    path.write_bytes((end.join(lines) + end).encode(encoding))
    got = read_recording(path, SYSTEM)
    check(got, missing)
    assert any("the header is line" in note for note in got.notes) == (above not in ("nothing", "comments"))


START = datetime.datetime(2024, 3, 5, 23, 59, 59, 500_000)
STAMPS = {
    "iso": "%Y-%m-%d %H:%M:%S.%f", "iso with T": "%Y-%m-%dT%H:%M:%S.%f", "german": "%d.%m.%Y %H:%M:%S,%f",
    "american": "%m/%d/%Y %I:%M:%S.%f %p", "clock": "%H:%M:%S.%f", "colons": "%H:%M:%S:%f",
}  # fmt: skip


@pytest.mark.parametrize("kind", STAMPS)
@pytest.mark.parametrize("zone", ["", "Z", "+01:00"])
def test_dates_and_times_of_day_across_midnight(tmp_path, kind, zone):
    if zone and not kind.startswith("iso"):
        zone = ""
    lines = ["time;torque;speed"]
    for k in range(COUNT):
        stamp = (START + datetime.timedelta(seconds=float(TIME[k]))).strftime(STAMPS[kind])
        lines.append(f"{stamp}{zone};{VALUES['torque'][k]};{VALUES['speed'][k]}")
    (tmp_path / "run.csv").write_text("\n".join(lines))
    got = read_recording(tmp_path / "run.csv", SYSTEM)
    check(got)
    assert any("date or time of day" in note for note in got.notes)


@pytest.mark.parametrize("rate", [7.0, 50.0, 333.0, 1000.0])
def test_rows_that_share_a_stamp_of_whole_seconds(tmp_path, rate):
    time = np.arange(int(9 * rate)) / rate
    lines = ["time,torque,speed"]
    for t in time:
        stamp = START + datetime.timedelta(seconds=float(t))
        lines.append(f"{stamp:%Y-%m-%d %H:%M:%S},{np.sin(t):.9f},{t:.9f}")
    (tmp_path / "run.csv").write_text("\n".join(lines))
    got = read_recording(tmp_path / "run.csv", SYSTEM)
    assert len(got.time) == len(time)
    np.testing.assert_allclose(np.diff(got.time), 1 / rate, rtol=0.5 / (8 * rate) * 8)
    assert any("share a time stamp" in note for note in got.notes)
    kept = np.random.default_rng(1).uniform(size=len(lines)) < np.array([1.0, 0.3])[np.arange(len(lines)) // 1500 % 2]
    shuffled = [line for k, line in enumerate(lines) if not k or kept[k]]
    (tmp_path / "run.csv").write_text("\n".join(shuffled))
    if rate > 100:
        with pytest.raises(InputError, match="several rows have the same time, in no regular way"):
            read_recording(tmp_path / "run.csv", SYSTEM)


@pytest.mark.parametrize("x_columns", ["One", "No"])
def test_labview(tmp_path, x_columns):
    rows = [
        f"{TIME[k]:.6f}\t{VALUES['torque'][k]}\t{VALUES['speed'][k]}"[0 if x_columns == "One" else 8 :]
        for k in range(COUNT)
    ]
    head = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Separator\tTab",
        f"X_Columns\t{x_columns}",
        "Date\t2024/03/05",
    ]
    head += [
        "Time\t12:00:00,5",
        "***End_of_Header***\t",
        "",
        "Channels\t2\t",
        "Samples\t60\t60",
        "X_Dimension\tTime\tTime",
    ]
    head += ["Y_Unit_Label\tN*m\trad/s", "X0\t0\t0", "Delta_X\t0.02\t0.02", "***End_of_Header***\t\t\t"]
    (tmp_path / "run.lvm").write_text("\n".join([*head, "X_Value\ttorque\tspeed\tComment", *rows]) + "\n")
    check(read_recording(tmp_path / "run.lvm", SYSTEM))


def test_campbell_scientific(tmp_path):
    lines = [
        '"TOA5","CR1000","7"',
        '"TIMESTAMP","RECORD","torque","speed"',
        '"TS","RN","Nm","rad/s"',
        '"","","Smp","Avg"',
    ]
    for k in range(COUNT):
        stamp = START + datetime.timedelta(seconds=float(TIME[k]))
        lines.append(f'"{stamp:%Y-%m-%d %H:%M:%S.%f}",{k},{VALUES["torque"][k]},{VALUES["speed"][k]}')
    (tmp_path / "run.dat").write_text("\n".join(lines))
    (tmp_path / "c.toml").write_text('[channels]\ntime = "TIMESTAMP"\n')
    check(read_recording(tmp_path / "run.dat", SYSTEM, read_channels(tmp_path / "c.toml")))


def test_the_channel_file_names_the_header_and_the_sampling_rate(tmp_path):
    rows = [f"{VALUES['torque'][k]},{VALUES['speed'][k]}" for k in range(COUNT)]
    (tmp_path / "run.csv").write_text("\n".join(["torque,speed", "1,2", "torque,speed", *rows]))
    (tmp_path / "c.toml").write_text('sampling_rate = "50 Hz"\nheader = 3\n')
    channels = read_channels(tmp_path / "c.toml")
    assert isinstance(channels, ChannelFile)
    check(read_recording(tmp_path / "run.csv", SYSTEM, channels))
    channels.header = None
    with pytest.raises(InputError, match="line 3: 'torque' in column 'torque'"):
        read_recording(tmp_path / "run.csv", SYSTEM, channels)
    (tmp_path / "run.csv").write_text("\n".join(["torque,speed", *rows]))
    with pytest.raises(InputError, match="write sampling_rate = HZ"):
        read_recording(tmp_path / "run.csv", SYSTEM)
    for wrong in ("sampling_rate = 0", "sampling_rate = '3 s'", "header = 0", "header = 1.5", "sampling_rat = 3"):
        (tmp_path / "c.toml").write_text(f"{wrong}\n")
        with pytest.raises(InputError):
            read_channels(tmp_path / "c.toml")


@pytest.mark.parametrize("cells", ['"1,234","5,678"', '"-1,234,567","3,456"'])
def test_thousands_or_decimals_are_not_guessed(tmp_path, cells):
    (tmp_path / "run.csv").write_text(f"time,torque,speed\n0,{cells}\n1,{cells}\n")
    with pytest.raises(InputError, match="thousands"):
        read_recording(tmp_path / "run.csv", SYSTEM)


def test_a_row_that_was_cut_off_is_left_out_with_a_note(tmp_path):
    """A logger without power: cut between two cells, or within a number that still reads as one."""
    rows = "".join(f"{k / 100:.3f},{k % 7},{k % 5 + 0.757843}\n" for k in range(40))
    whole, path = f"time [s],torque [N*m],speed [rad/s]\n{rows}", tmp_path / "cut.csv"
    for cut in (2, 4, 8, 11):
        path.write_text(whole[:-cut])
        table = read_csv(path)
        assert [len(column.values) for column in table.columns] == [39] * 3
        assert any("ends within a number" in note for note in table.notes)
    for complete in (whole, whole[:-1]):  # many programs write no end of line after the last row
        path.write_text(complete)
        table = read_csv(path)
        assert len(table.columns[0].values) == 40
        assert table.columns[2].values[-1] == 4.757843
        assert not table.notes
    path.write_text("time [s],torque [N*m],speed [rad/s]\n0,1,2")  # one row: there is nothing to compare it with
    assert len(read_csv(path).columns[0].values) == 1
