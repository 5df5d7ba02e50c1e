"""Libraries that read foreign files run in a process of their own: a crash, a hang or a full memory is one line."""

import subprocess
import sys

import numpy as np
import pytest

from modelling.errors import InputError
from modelling.recordings import readers
from modelling.recordings.readers import read_table

READER = """
import os, signal, tempfile, time
import numpy as np
from modelling.errors import InputError
from modelling.recordings import readers
from modelling.recordings.table import Column, Table

def read(path, used, kind):
    print("said by the library")
    os.write(2, b"said by the library")
    if kind == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if kind == "hang":
        time.sleep(60)
    if kind == "memory":
        np.ones(2_000_000_000)
    if kind == "leaves":
        tempfile.mkstemp()
    if kind == "error":
        raise InputError("file: channel 'a'", "holds no numbers", "record it")
    if kind == "missing":
        import no_such_package
    if kind == "crash at the end":
        import atexit, ctypes
        atexit.register(lambda: ctypes.string_at(0))
    columns = Column("time", "s", np.array([0.0, 1.0])), Column(*used, "N*m", np.array([np.nan, -np.inf]))
    return Table(columns, notes=("n",), others=("o",))

readers.READERS[".x"] = read
"""


@pytest.fixture
def reading(tmp_path, monkeypatch):
    """A function that reads by the reader above."""
    (tmp_path / "sitecustomize.py").write_text(READER, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(readers, "LEAST_BYTES", 3_000_000_000)
    path = tmp_path / "file.x"
    path.write_bytes(b"...")

    def read(kind):
        return readers.read_in_child(path, {"a"}, {"kind": kind})

    return read


@pytest.mark.parametrize("kind", ["plain", "crash at the end"])
def test_a_table_comes_back_as_it_was_made(reading, kind, capfd):
    got = reading(kind)
    np.testing.assert_array_equal(got["time"].values, [0.0, 1.0])
    np.testing.assert_array_equal(got["a"].values, [np.nan, -np.inf])
    assert (got.names, got["a"].unit, got.notes, got.others) == (["time", "a"], "N*m", ("n",), ("o",))
    got["a"].values[0] = 5.0  # writable as any other table
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("kind", "line"),
    [
        ("crash", "file.x: the library that reads it crashed (SIGSEGV); it is probably damaged"),
        ("memory", "file.x: needs more than 3.0 GB to be read; it is probably damaged"),
        ("error", "file: channel 'a': holds no numbers; record it"),
    ],
)
def test_what_goes_wrong_is_one_line(reading, kind, line, capfd):
    with pytest.raises(InputError) as error:
        reading(kind)
    assert line in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_a_hang_ends(reading, monkeypatch):
    monkeypatch.setattr(readers, "LEAST_SECONDS", 0.5)
    monkeypatch.setattr(readers, "WAITED", 4.0)
    with pytest.raises(InputError, match=r"file.x: is not read within 0 s|file.x: is not read within 1 s"):
        reading("hang")


def test_a_package_that_is_missing_is_named(reading):
    with pytest.raises(ModuleNotFoundError) as error:
        reading("missing")
    assert error.value.name == "no_such_package"


def test_mdf_parquet_and_mat_are_read_apart(tmp_path):
    """None of their libraries comes into this process."""
    (tmp_path / "a.parquet").write_bytes(b"PAR1" + bytes(50) + b"PAR1")
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(600))
    (tmp_path / "b.mat").write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + bytes(600))
    code = f"""
import sys
from modelling.errors import InputError
from modelling.recordings.readers import read_table
for name in ("a.parquet", "a.mat", "b.mat"):
    try:
        read_table({str(tmp_path)!r} + "/" + name)
    except InputError as error:
        print(str(error).split(";")[0])
print(sorted({{"asammdf", "pyarrow", "h5py", "scipy.io"}} & {{*sys.modules}}))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert [" is no " in line for line in lines] == [True, True, True, False], lines
    assert lines[-1] == "[]"
    assert done.stderr == ""


@pytest.mark.parametrize("cut", [3, 100, 200, 260])
def test_a_damaged_mat_file_is_one_line(tmp_path, cut):
    from scipy.io import savemat

    path = tmp_path / "run.mat"
    savemat(path, {"time": np.arange(5.0), "motor_torque": np.ones(5)})
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(InputError) as error:
        read_table(path, {"time", "motor_torque"})
    assert "is no .mat file" in str(error.value)
    assert "\n" not in str(error.value)
