"""The diagnosis example runs as a script does, with its own asserted numbers."""

import importlib.util
from pathlib import Path

import pytest

RUN = Path(__file__).parents[2] / "examples" / "diagnosis" / "run.py"


@pytest.mark.long
def test_four_recordings_end_in_four_verdicts(tmp_path, capsys):
    spec = importlib.util.spec_from_file_location("diagnosis_run", RUN)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = module.main(tmp_path)
    assert found["play"].gain.nrmse_after < 1.1 * found["play"].gain.noise_floor
    assert "The shaft link has 0.024" in capsys.readouterr().out
