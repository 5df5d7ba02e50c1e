"""What is in the file, and what happens where it cannot be made."""

import json
import platform

import fmpy
import pytest
from fmpy.validation import validate_fmu
from needs import compiles

from matching.cli import main
from matching.match.case_file import case_files, load_case
from modelling.fmu.export import binary, exponents
from modelling.simulation import compiled as build


@pytest.fixture(params=["reference_case", "lashed_model"])
def source(request):
    return request.getfixturevalue(request.param)


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setenv("RIGMATCH_COMPILE", "0")
    build.compiler.cache_clear()
    yield
    build.compiler.cache_clear()


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_valid_without_a_message(export, source, fmi):
    assert validate_fmu(str(export(source, fmi))) == []


def test_variables_keep_names_values_and_units(export, reference_case):
    about = fmpy.read_model_description(str(export(reference_case)))
    found = {own.name: own for own in about.modelVariables}
    assert {name for name, own in found.items() if own.causality == "input"} == {
        "side_left_torque", "side_right_torque", "road_left", "road_right",
    }  # fmt: skip
    stiffness = found["shafts.wheel_tyre_left.stiffness"]
    assert (stiffness.causality, stiffness.variability, stiffness.unit) == ("parameter", "tunable", "N*m/rad")
    assert float(stiffness.start) == 1.18e5
    assert "tuned within 60000 … 240000" in stiffness.description
    assert found["wheel_left_interface_speed"].causality == "output"
    unit = next(own for own in about.unitDefinitions if own.name == "N*m/rad").baseUnit
    assert (unit.kg, unit.m, unit.s, unit.rad) == (1, 2, -2, -1)


@pytest.mark.parametrize(("unit", "powers"), [
    ("N*m*s^2/rad^2", {"kg": 1, "m": 2, "rad": -2}),
    ("kg*m^2", {"kg": 1, "m": 2}),
    ("rad/s^2", {"rad": 1, "s": -2}),
    ("1", {}),
])  # fmt: skip
def test_units_as_powers(unit, powers):
    assert exponents(unit) == powers


def test_same_input_same_bytes(export, reference_case, tmp_path):
    again = tmp_path / "other name.fmu"
    assert main(["export", str(reference_case), "--fmu", str(again)]) == 0
    assert again.read_bytes() == export(reference_case).read_bytes()


def test_another_model_has_another_guid(export, reference_case, lashed_model):
    one, other = (fmpy.read_model_description(str(export(source))).guid for source in (reference_case, lashed_model))
    assert one != other


@compiles
@pytest.mark.skipif(platform.system() != "Linux" or platform.machine() != "x86_64", reason="names of another platform")
def test_binary_for_this_platform_and_sources(export, reference_case):
    assert set(fmpy.supported_platforms(str(export(reference_case)))) == {"linux64", "c-code"}


def test_without_a_compiler_the_sources(no_compiler, reference_case, tmp_path, capsys):
    target = tmp_path / "rvm.fmu"
    assert main(["export", str(reference_case), "--fmu", str(target)]) == 0
    assert "no C compiler was found: the FMU holds C sources only" in capsys.readouterr().out
    assert fmpy.supported_platforms(str(target)) == ["c-code"]
    assert validate_fmu(str(target)) == []


def test_a_compiler_that_fails_is_named(monkeypatch, reference_case, tmp_path, capsys):
    monkeypatch.setenv("CC", "false")
    build.compiler.cache_clear()
    try:
        assert main(["export", str(reference_case), "--fmu", str(tmp_path / "rvm.fmu")]) == 2
    finally:
        build.compiler.cache_clear()
    line = capsys.readouterr().err
    assert "false: the C compiler does not work" in line
    assert line.count("\n") == 1
    assert not (tmp_path / "rvm.fmu").exists()


@compiles
def test_sources_that_do_not_compile_are_an_error():
    with pytest.raises(RuntimeError, match=r"do not compile: .*error"):
        binary({"fmu.c": "int main( {"}, "fmu.c")


def result_folder(reference_case, folder, status, **tuned):
    """What a match leaves, as far as an export reads it."""
    for name, text in case_files(load_case(reference_case)).items():
        (folder / name).write_text(text, encoding="utf-8")
    rows = [{"name": f"residual_vehicle.{name}", "tuned": value} for name, value in tuned.items()]
    (folder / "result.json").write_text(json.dumps({"status": status, "parameters": rows}))
    return folder


def test_a_case_is_exported_with_its_start_values_and_says_so(reference_case, tmp_path, capsys):
    """A match of it would ship tuned values: which of the two it is must not be left to guessing."""
    assert main(["export", str(reference_case), "--fmu", str(tmp_path / "a.fmu"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert not found.keys() & {"states", "memory_bytes"}  # of a whole controller alone
    starts = {move.name: move.start for move in load_case(reference_case).moves}
    values = {own["name"]: own["value"] for own in found["parameters"]}
    assert values["inertias.body_left.J"] == starts["residual_vehicle.inertias.body_left.J"]
    assert found["notes"][0] == "a case, not a match: everything stands at its start value"


def test_result_of_a_match(reference_case, tmp_path, capsys):
    given = result_folder(reference_case, tmp_path, "limited", **{"inertias.body_left.J": 77.0})
    for name in (given, given / "result.json"):
        assert main(["export", str(name), "--fmu", str(tmp_path / "a.fmu"), "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        values = {own["name"]: own["value"] for own in found["parameters"]}
        assert values["inertias.body_left.J"] == values["inertias.body_right.J"] == 77.0
        assert "the match is 'limited', not 'matched'" in found["notes"][0]
        body = load_case(reference_case).vehicle.parameters["inertias.body_left.J"].value
        assert f"inertias.body_left.J 77 (vehicle {body:g})" in found["notes"][1]
    case = given / "case.toml"
    case.write_text(case.read_text().replace('"model_based"', '"pi"'))
    assert main(["export", str(given), "--fmu", str(tmp_path / "a.fmu"), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["notes"]) == 1  # the feedback is all there is


def test_result_object(export, reference_case, tmp_path, capsys):
    assert main(["export", str(reference_case), "--fmu", str(tmp_path / "a.fmu"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["of"] == "residual vehicle"
    assert found["communication_step"] == 0.001
    tuned = [own["name"] for own in found["parameters"] if own["tuned"]]
    assert "inertias.body_left.J" in tuned
    assert "inertias.body_right.J" in tuned


BAD = {
    "no such file": (["{t}/none.toml", "--fmu", "{t}/a.fmu"], "none.toml: does not exist"),
    "directory without a result": (["{t}/empty", "--fmu", "{t}/a.fmu"], "result.json: does not exist"),
    "other name": (["{t}/model.toml", "--fmu", "{t}/a.zip"], "let it end in .fmu"),
    "not a result": (["{t}/result.json", "--fmu", "{t}/a.fmu"], "holds no result of a match"),
    "not JSON": (["{t}/broken.json", "--fmu", "{t}/a.fmu"], "is not JSON"),
    "an endless file": (["{t}/endless.json", "--fmu", "{t}/a.fmu"], "is too large for the result of a match"),
    "alone": (["{t}/alone/result.json", "--fmu", "{t}/a.fmu"], "case.toml: does not exist"),
    "a bad model": (["{t}/bad.toml", "--fmu", "{t}/a.fmu"], "inertias.a.J"),
    "target in a file": (["{t}/model.toml", "--fmu", "{t}/model.toml/a.fmu"], "cannot be written"),
    "version": (["{t}/model.toml", "--fmu", "{t}/a.fmu", "--fmi", "1.0"], "invalid choice: '1.0'"),
}
MODEL = '[inertias.a]\nJ = 1\n[inputs.torque]\non = "a"\n'


@pytest.mark.parametrize(("words", "line"), BAD.values(), ids=BAD)
def test_bad_input_is_one_line_and_nothing_is_written(words, line, tmp_path, capsys):
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "bad.toml").write_text(MODEL.replace("J = 1", "J = 0"))
    (tmp_path / "result.json").write_text("{}")
    (tmp_path / "broken.json").write_text("{")
    (tmp_path / "endless.json").symlink_to("/dev/zero")
    (tmp_path / "empty").mkdir()
    (tmp_path / "alone").mkdir()
    (tmp_path / "alone" / "result.json").write_text('{"status": "matched", "parameters": []}')
    before = sorted(tmp_path.rglob("*"))
    assert main(["export", *(word.format(t=tmp_path) for word in words)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert line in said.err
    assert sorted(tmp_path.rglob("*")) == before
