"""What stands where in an FMU: names that the FMI standards ask for."""

import zipfile
from dataclasses import replace

import fmpy
import pytest

from matching.export import read_export_source
from modelling.fmu import export
from modelling.fmu.export import LICENCE, fmu


@pytest.mark.parametrize(("fmi", "wrapper"), [("2.0", "fmi2.c"), ("3.0", "fmi3.c")])
def test_names_of_the_files(lashed_model, fmi, wrapper, tmp_path):
    made = fmu(read_export_source(lashed_model).block, fmi)
    path = tmp_path / "a.fmu"
    path.write_bytes(made.content)
    able = fmpy.read_model_description(str(path)).coSimulation
    assert able.canHandleVariableCommunicationStepSize
    assert fmi == "3.0" or able.canInterpolateInputs
    with zipfile.ZipFile(path) as file:
        names = set(file.namelist())
        assert file.read("documentation/licenses/license.txt").decode() == LICENCE
        assert "<html" in file.read("documentation/index.html").decode()
    plain = {name for name in names if not name.startswith(("sources/", "binaries/"))}
    assert plain == {"modelDescription.xml", "documentation/index.html", "documentation/licenses/license.txt"}
    assert f"sources/{wrapper}" in names
    assert ("sources/buildDescription.xml" in names) == (fmi == "3.0")
    assert all(name.startswith(f"binaries/{made.platform}/{made.identifier}.") for name in names if "binaries/" in name)


@pytest.mark.parametrize(("name", "identifier"), [
    ("drive (left)", "drive_left"),
    ("3-mass drive", "model_3_mass_drive"),  # names of C begin with a letter
    ("§", "model"),
    ("_x_", "x"),
])  # fmt: skip
def test_identifier_is_a_name_in_c(monkeypatch, lashed_model, name, identifier):
    monkeypatch.setattr(export, "binary", lambda code, model: None)
    assert fmu(replace(read_export_source(lashed_model).block, name=name)).identifier == identifier
