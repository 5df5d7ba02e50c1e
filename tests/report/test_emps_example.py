"""The EMPS example reads the authors' file; the recording itself is diagnosed in ``tests/diagnosis``."""

import importlib.util
from pathlib import Path

import numpy as np
from scipy.io import savemat

from modelling.model_file import load
from modelling.recordings.read import read_recording

EXAMPLE = Path(__file__).parents[2] / "examples" / "emps"


def test_the_authors_file_becomes_a_recording_of_the_model(tmp_path):
    spec = importlib.util.spec_from_file_location("emps_run", EXAMPLE / "run.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    time = np.arange(200)[:, None] * 1e-3
    savemat(tmp_path / "DATA_EMPS.mat", {"t": time, "vir": np.sin(time), "qm": time**2, "qg": time, "gtau": 35.15})
    rows = module.rows(tmp_path / "DATA_EMPS.mat")
    np.savetxt(tmp_path / "r.csv", rows, delimiter=",", header=module.HEADER, comments="", fmt="%.10g")
    system = load(EXAMPLE / "model.toml")
    recording = read_recording(tmp_path / "r.csv", system)
    np.testing.assert_allclose(recording["drive_force"], 35.15 * np.sin(time[:, 0]), atol=1e-9)
    np.testing.assert_allclose(recording["position"], time[:, 0] ** 2, atol=1e-9)
