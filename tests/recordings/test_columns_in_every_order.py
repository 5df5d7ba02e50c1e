"""Names, units and values of a channel stay together, wherever a file has its columns."""

from itertools import permutations

import numpy as np
import pytest
from scipy.io import savemat

from modelling.model_file import from_dict
from modelling.recordings.read import read_recording

SYSTEM = from_dict({
    "inertias": {"motor": {"J": 0.1}, "load": {"J": 1.0}},
    "shafts": {"link": {"between": ["motor", "load"], "stiffness": 200.0, "damping": 0.5}},
    "inputs": {"torque": {"on": "motor"}},
    "sensors": {"speed": {"measures": "speed", "of": "motor"}, "link_torque": {"measures": "torque", "of": "link"}},
})  # fmt: skip
TIME = np.arange(40) * 0.01
COLUMNS = {  # rising ones too: exchanged with time they would not be noticed
    "time": ("ms", 1e3 * TIME), "torque": ("kN*m", TIME**2), "speed": ("1/min", 30 + 60 * TIME),
    "link_torque": ("N*m", np.cos(TIME)),
}  # fmt: skip


def write_csv(path, names):
    header = ",".join(f"{name} [{COLUMNS[name][0]}]" for name in names)
    np.savetxt(path, np.stack([COLUMNS[name][1] for name in names], axis=1), delimiter=",", header=header, comments="")


def write_mat(path, names):
    units = {name: COLUMNS[name][0] for name in names}
    savemat(path, {**{name: COLUMNS[name][1] for name in names}, "units": units})


def write_parquet(path, names):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    fields = [pyarrow.field(name, pyarrow.float64(), metadata={"unit": COLUMNS[name][0]}) for name in names]
    parquet.write_table(pyarrow.table([COLUMNS[name][1] for name in names], schema=pyarrow.schema(fields)), path)


def write_mf4(path, names):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        for name in names:
            if name != "time":
                file.append([asammdf.Signal(COLUMNS[name][1], TIME, COLUMNS[name][0], name)])
        file.save(path, overwrite=True)


@pytest.mark.parametrize("write", [write_csv, write_mat, write_parquet, write_mf4])
def test_columns_in_every_order(tmp_path, write):
    path = tmp_path / f"run.{write.__name__.removeprefix('write_')}"
    for names in permutations(COLUMNS):
        write(path, names)
        got = read_recording(path, SYSTEM)
        assert got.notes == ()
        np.testing.assert_allclose(got.time, TIME, atol=1e-9)
        np.testing.assert_allclose(got["torque"], 1e3 * TIME**2, atol=1e-9)
        np.testing.assert_allclose(got["speed"], np.pi * (1 + 2 * TIME), rtol=1e-9)
        np.testing.assert_allclose(got["link_torque"], np.cos(TIME), rtol=1e-9)
